"""Staged scenes: named things on a setting, and exact pictures without one or with it changed."""

from bench.staged.sets import stage, stages
from bench.staged.stage import Labelled, Rig, Stage
from bench.staged.thing import Thing

__all__ = ["Labelled", "Rig", "Stage", "Thing", "stage", "stages"]
