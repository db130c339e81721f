"""Autoencoders are differentiable in the pictures: score distillation descends through them.

That of pix2pix is in test_pix2pix.py, beside its tiny model.
"""

from closeness import slope_error

from gsedit.paper.editors.closed_form import ClosedForm


def test_closed_form():
    assert slope_error(ClosedForm().encode, 1e-2) < 1e-3
