"""Weights that do not fit into memory are refused before they are read."""

from __future__ import annotations

import gc
import weakref

import pytest
import torch

from gsedit.errors import UsageError
from gsedit.models import parts
from gsedit.models.loading import load_model

pytestmark = pytest.mark.usefixtures("offline")


def test_weights_that_would_be_converted_must_fit(folder, monkeypatch):
    monkeypatch.setattr(parts, "free_bytes", lambda: 1000)
    with pytest.raises(UsageError, match=r"GB of memory in bfloat16, and 0\.0 GB are free"):
        load_model(folder, precision="bfloat16")
    parts.Parts.of(folder).check_memory()  # as stored: mapped from the disk
    monkeypatch.setattr(parts, "free_bytes", lambda: 10**12)
    parts.Parts.of(folder, "bfloat16").check_memory()


@pytest.mark.parametrize("kind", ["folder", "xl_folder"])
def test_text_encoders_are_freed_once_a_text_is_read_and_loaded_for_another(kind, request):
    folder = request.getfixturevalue(kind)
    model, picture = load_model(folder), torch.rand(1, 32, 32, 3)
    networks = [weakref.ref(each.network) for each in model.text_networks]
    first = model.condition(picture, "make it snow", torch.Generator())
    gc.collect()
    assert [each() for each in networks] == [None] * len(networks)
    model.condition(picture, "make it snow", torch.Generator())
    assert not any(each.in_memory for each in model.text_networks)
    second = model.condition(picture, "it snows", torch.Generator())
    again = load_model(folder).condition(picture, "it snows", torch.Generator())
    torch.testing.assert_close(second.text.tokens, again.text.tokens)
    assert not torch.equal(second.text.tokens, first.text.tokens)
