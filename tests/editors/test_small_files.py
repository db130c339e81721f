"""Files of weights of the small editor: written, read, and refused where they are not right."""

from __future__ import annotations

import json
from dataclasses import asdict

import pytest
import torch
from small_networks import TINY, random_network

from gsedit.editors.small.denoiser import Small, load_small, save_small
from gsedit.errors import InputError


def test_weights_come_back_in_half_precision(tmp_path):
    small = Small(random_network(), looks=("bronze", "snow"), words=frozenset({"bronze", "snowy"}))
    save_small(small, tmp_path / "tiny.safetensors", {"seed": "3"})
    loaded = load_small(tmp_path / "tiny.safetensors")
    assert loaded.network.architecture == TINY
    assert (loaded.looks, loaded.words) == (small.looks, small.words)
    for name, value in small.network.state_dict().items():
        assert torch.equal(loaded.network.state_dict()[name], value.half().float())


def test_weights_that_are_missing_say_where(tmp_path):
    with pytest.raises(InputError, match=r"nowhere\.safetensors: no such file; leave --model out"):
        load_small(tmp_path / "nowhere.safetensors")


def test_a_folder_is_no_file_of_weights(tmp_path):
    with pytest.raises(InputError, match=r"is a folder and no file.*need --editor pix2pix"):
        load_small(tmp_path)


def test_weights_that_were_written_anew_are_read_anew(tmp_path):
    path = tmp_path / "tiny.safetensors"
    for seed in (0, 1):
        save_small(Small(random_network(seed=seed)), path)
        weight = load_small(path).network.state_dict()["residual_head.weight"]
        assert torch.equal(weight, random_network(seed=seed).residual_head.weight.half().float())


def test_a_broken_file_is_named(tmp_path):
    path = tmp_path / "broken.safetensors"
    path.write_bytes(b"not weights at all")
    with pytest.raises(InputError, match=r"broken\.safetensors does not hold the weights"):
        load_small(path)


def test_weights_of_another_network_are_refused(tmp_path):
    from safetensors.torch import save_file

    path = tmp_path / "other.safetensors"
    metadata = {"architecture": json.dumps(asdict(TINY)), "looks": "[]", "words": "[]"}
    save_file({"a": torch.zeros(1)}, path, metadata)
    with pytest.raises(InputError, match="does not hold the weights of the small editor"):
        load_small(path)
