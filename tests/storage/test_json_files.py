"""JSON from anybody: each damage is one line that names the file and the place."""

import json
import os

import pytest
from bad_files import dataset, write

from gsedit import load_dataset
from gsedit.editing.folder import history_of
from gsedit.errors import InputError
from gsedit.run.json_files import (
    MAX_BYTES,
    list_of,
    number,
    numbers,
    object_of,
    parse_json,
    read_json,
    text,
)
from gsedit.views.cameras_json import read_cameras
from gsedit.views.export_frame import applied_by, read_dataparser
from gsedit.views.view_list_files import read_view_list

FRAMES = object_of({"frames": list_of(object_of({"fl_x": number(1.0, 9.0)}, {"name": text()}))})
CAMERA = {
    "id": 0, "img_name": "a", "width": 8, "height": 6, "position": [0, 0, 0],
    "rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "fx": 9.0, "fy": 9.0,
}  # fmt: skip


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        ('{"frames": [{"fl_x": 2}, {"fl_x": "2"}]}', r"frames\[1\]\.fl_x is '2', not a number"),
        ('{"frames": [{"fl_x": true}]}', r"frames\[0\]\.fl_x is True, not a number"),
        ('{"frames": [{"fl_x": NaN}]}', r"frames\[0\]\.fl_x is nan, not a number"),
        ('{"frames": [{"fl_x": 10}]}', r"frames\[0\]\.fl_x is 10, not from 1 to 9"),
        ('{"frames": [{"fl_x": ' + "9" * 5000 + "}]}", r"frames\[0\]\.fl_x is inf, not a number"),
        ('{"frames": [{"fl_x": 1' + "0" * 400 + "}]}", r"frames\[0\]\.fl_x is inf, not a number"),
        ('{"frames": [{}]}', r"frames\[0\] has no fl_x"),
        ('{"frames": [{"fl_x": 2, "name": "a\\u0000"}]}', r"frames\[0\]\.name is .*not a text"),
        ('{"frames": [{"fl_x": 2, "name": "\\ud800"}]}', r"frames\[0\]\.name is .*not a text"),
        ('{"frames": {}}', "frames is no list"),
        ("[]", "the file is no object"),
        ('{"frames":\n 1 2}', "line 2, column 4"),
        ("[" * 100_000, "RecursionError"),
        (b"\xff\xfe{", "not JSON"),
        ("", "0 bytes"),
    ],
)
def test_each_damage_is_named_with_its_place(tmp_path, content, problem):
    path = tmp_path / "a.json"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(InputError, match=rf"a\.json:? (.|\n)*{problem}.*do this") as error:
        read_json(path, FRAMES, advice="do this")
    assert len(str(error.value)) < 300
    assert str(error.value).isprintable()


def test_values_come_back_as_the_reader_needs_them():
    found = parse_json('{"frames": [{"fl_x": 2, "name": null, "w": 3}]}', "a", FRAMES)
    assert found == {"frames": [{"fl_x": 2.0, "w": 3}]}
    assert parse_json("[[1, 2], [3, 4]]", "a", numbers(2, 2)).tolist() == [[1, 2], [3, 4]]
    for wrong in ("[[1, 2], [3]]", "[[1, 2], [3, 1e999]]", '"ab"'):
        with pytest.raises(InputError, match=r"^a: .* is not"):
            parse_json(f'{{"m": {wrong}}}', "a", object_of({"m": numbers(2, 2)}))


def test_a_file_has_a_largest_size(tmp_path):
    (tmp_path / "a.json").write_text(" " * 99 + "1")
    assert read_json(tmp_path / "a.json") == 1
    os.truncate(tmp_path / "a.json", MAX_BYTES + 1)  # sparse
    with pytest.raises(InputError, match=r"a\.json has more than"):
        read_json(tmp_path / "a.json")


@pytest.mark.parametrize(
    "change",
    [
        {"fx": 1e308}, {"fx": 1e-300}, {"fx": 10**400}, {"width": 1e300}, {"width": 0},
        {"position": [0, 0, 1e300]}, {"img_name": "a\0"}, {"img_name": 7}, {"rotation": 1},
        {"height": None}, {"rotation": [[1e200] * 3] * 3},
    ],
)  # fmt: skip
def test_absurd_cameras_are_refused(tmp_path, change):
    path = tmp_path / "cameras.json"
    path.write_text(json.dumps([CAMERA, {**CAMERA, **change}]))
    with pytest.raises(InputError, match=r"cameras\.json: \[1\]"):
        read_cameras(path)


@pytest.mark.parametrize(
    "change",
    [
        {"fl_x": 1e308}, {"cx": 1e300}, {"w": 10**400}, {"fl_x": 10**400}, {"k1": 1e300},
        {"transform_matrix": [[1, 0, 0, 1e300], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]},
        {"fl_x": None, "camera_angle_x": 3.141592653589793}, {"fl_x": -1}, {"camera_model": 7},
        {"file_path": "images/0.png"},
    ],
)  # fmt: skip
def test_absurd_frames_are_refused(tmp_path, change):
    record = dataset(tmp_path / "set")
    record.pop("fl_x")
    for index, frame in enumerate(record["frames"]):
        frame.update({"fl_x": 9.0} | (change if index == 1 else {}))
    with pytest.raises(InputError, match=r"transforms\.json: (frames\[1\]|two frames)"):
        load_dataset(write(tmp_path / "set", record))
    if "file_path" not in change:
        with pytest.raises(InputError, match=r"transforms\.json: frames"):
            read_view_list(tmp_path / "set" / "transforms.json")


def test_absurd_transforms_of_an_export_are_refused(tmp_path):
    path = tmp_path / "transforms.json"
    for scale, entry in ((10**400, 1), (1, 10**400), ("1", 1), (0, 1), (1, None)):
        matrix = [[entry, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]
        path.write_text(json.dumps({"transform": matrix, "scale": scale}))
        with pytest.raises(InputError, match="transforms"):
            read_dataparser(path)
        path.write_text(json.dumps({"applied_transform": matrix, "applied_scale": scale}))
        with pytest.raises(InputError, match="transforms"):
            applied_by(path)


@pytest.mark.parametrize("content", ['{"history": 7}', "[]", "{" * 9, '{"measured": []}'])
def test_an_edit_with_a_damaged_record_is_refused(tmp_path, content):
    (tmp_path / "edit.json").write_text(content)
    (tmp_path / "scene.ply").touch()
    with pytest.raises(InputError, match=r"edit\.json"):
        history_of(tmp_path / "scene.ply")
