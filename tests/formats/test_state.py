"""Checkpoints come from anywhere: what they hold is checked before it is used."""

import json

import pytest
import torch
from safetensors.torch import save_file

from gsedit.errors import GseditError, InputError, UsageError
from gsedit.run.state import FORMAT, KEY, State, load_state, restoring, save_state

DEEP = "[" * 100000 + "]" * 100000
RECORDS = ["null", "[]", "3", '"text"', "{", DEEP] + [
    json.dumps({"format": FORMAT, **wrong})
    for wrong in (
        {"events": {}}, {"request": []}, {"source": "scene.ply"}, {"source": {"scene": 7}},
        {"seconds": "1"}, {"seconds": float("nan")}, {"step": -1}, {"view_plan": None}, {"work": 3},
        {"seconds": 1e308}, {"events": [[]]},
        {"loss": []}, {"region": 5}, {"voted": 1}, {"threads": True}, {"undone": 1.5},
    )
]  # fmt: skip


@pytest.mark.parametrize("record", RECORDS, ids=range(len(RECORDS)))
def test_a_record_of_other_types_is_refused(record, tmp_path):
    path = tmp_path / "checkpoint.safetensors"
    save_file({"a": torch.zeros(1)}, path, metadata={KEY: record})
    with pytest.raises(InputError, match=r"checkpoint\.safetensors.*remove it"):
        load_state(path)


def test_what_a_state_lacks_is_told_with_its_file(tmp_path):
    path = tmp_path / "checkpoint.safetensors"
    save_state(State({"plan": {}}, {"a": torch.zeros(1)}), path)
    state = load_state(path)
    with pytest.raises(InputError, match=r"checkpoint\.safetensors is damaged"), restoring(state):
        state.record["plan"]["rounds"]


def test_a_full_disk_is_a_failure_of_the_disk(tmp_path, monkeypatch):
    from safetensors import SafetensorError
    from safetensors import torch as writer

    def full(*_, **__):
        raise SafetensorError("I/O error: No space left on device (os error 28)")

    path = tmp_path / "checkpoint.safetensors"
    save_state(State({"step": 1}, {}), path)
    monkeypatch.setattr(writer, "save_file", full)
    with pytest.raises(GseditError, match="No space left on device") as raised:
        save_state(State({"step": 2}, {}), path)
    assert not isinstance(raised.value, UsageError)
    assert load_state(path).record["step"] == 1
    assert len(list(tmp_path.iterdir())) == 1
