"""What a sentence says stays never changes: templates over things, materials, tones and looks."""

from __future__ import annotations

import itertools

import pytest

from gsedit.words.instruction import Change
from gsedit.words.lexicon import LIGHTS_OF, materials, rows_of, styles, TABLE
from gsedit.words.read import read_instruction
