"""Staged scenes: named things on a setting, and exact pictures without one or with it changed."""

from gsedit.synthetic.staged.sets import stage, stages
from gsedit.synthetic.staged.stage import Labelled, Rig, Stage
from gsedit.synthetic.staged.thing import Thing

__all__ = ["Labelled", "Rig", "Stage", "Thing", "stage", "stages"]
