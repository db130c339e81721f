"""Autoencoders are differentiable in the pictures: score distillation descends through them.

That of pix2pix is in test_pix2pix.py, beside its tiny model.
"""

from __future__ import annotations

from closeness import slope_error
from small_networks import random_network

from gsedit.paper.editors.closed_form import ClosedForm
from gsedit.paper.editors.small.editor import Small


def test_closed_form():
    assert slope_error(ClosedForm().encode, 1e-2) < 1e-3


def test_small():
    assert slope_error(Small(random_network()).encode, 1e-2) < 1e-3
