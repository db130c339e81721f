"""The state that tabs share: steps by commands, undo, cancelling, restarts."""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from pages import COMMAND, make_page, until

from gsedit.app import document as documents
from gsedit.app.document import Pending
from gsedit.app.opening import make_scene, open_path, receive
from gsedit.app.worker import Worker
from gsedit.errors import GseditError, UsageError, on_page
from gsedit.select.saved import save_named, saved_names


class Ear:
    """Hears what a page says, as a tab does."""

    def __init__(self, page):
        self.told: list[str] = []
        page.say, page.fail = self.told.append, lambda error: self.told.append(on_page(error))


def idle(page):
    until(lambda: page.busy is None and page.document.pending is None)


def step(page, title, *arguments, verb="clean"):
    page.step(verb, *arguments, title=title)
    idle(page)


@pytest.fixture
def opened(page, scene):
    open_path(page, scene)
    return page


def test_steps_follow_each_other_and_can_be_undone(opened, scene):
    step(opened, "snow", verb="edit")
    first = opened.scene_file
    step(opened, "clean it")
    assert [each.title for each in opened.document.steps] == ["bear.ply", "snow", "clean it"]
    assert first.parent.name == "001-snow"
    assert opened.scene_file.parent.name == "002-clean-it"
    assert opened.document.steps[2].command[:2] == ("clean", str(first))
    assert (opened.scene_file.parent / "cameras.json").is_file()
    assert len(opened.loaded.recorded) == 6
    opened.undo()
    assert opened.scene_file == first
    opened.go_to(0)
    assert opened.scene_file == scene
    opened.redo()
    assert opened.scene_file == first


def test_a_selection_ends_with_the_edit_that_it_was_made_for_or_with_its_gaussians(opened):
    flags = torch.arange(len(opened.scene)) < 10
    opened.select(flags, "ten")
    save_named(flags.numpy(), opened.scene.means.numpy(), opened.scene_file, "paw")
    step(opened, "clean it", verb="clean")
    assert opened.selection is flags
    assert saved_names(opened.scene_file) == ("paw",)
    assert opened.selection_file().is_file()
    with pytest.raises(UsageError, match="once more"):
        opened.select(flags[:5])
    step(opened, "paint it", verb="edit")
    assert opened.selection is None
    assert opened.selection_file() is None


def test_a_failing_command_is_told_by_its_sentence_and_changes_nothing(opened):
    ear, before = Ear(opened), opened.document.steps
    step(opened, "bad", "--fail")
    until(lambda: ear.told)
    assert ear.told == ["no such thing: use the camera's own files with EXIF"]
    assert opened.document.steps == before


def test_one_command_at_a_time_which_can_be_cancelled(opened):
    ear, before = Ear(opened), opened.document.steps
    opened.step("clean", "--seconds", "30", title="slow")
    for action in (lambda: opened.step("clean", title="more"), opened.undo):
        with pytest.raises(UsageError, match="slow"):
            action()
    time.sleep(0.3)
    opened.worker.cancel()
    idle(opened)
    until(lambda: ear.told)
    assert "cancelled" in ear.told[0]
    assert opened.document.steps == before
    step(opened, "after it")
    assert opened.document.current.title == "after it"


def test_a_killed_page_is_reopened_where_it_was(opened, scene, tmp_path):
    step(opened, "snow")
    step(opened, "more")
    opened.undo()
    opened.step("clean", "--seconds", "1", title="slow")
    until(lambda: documents.load(opened.folder).pending)
    written = (opened.folder / documents.NAME).read_text()
    with pytest.raises(UsageError, match="open in another gsedit app"):
        open_path(make_page(tmp_path), scene)
    opened.worker.cancel()
    idle(opened)
    opened.close()
    (opened.folder / documents.NAME).write_text(written)  # as it was when all was killed
    again = make_page(tmp_path)
    open_path(again, scene)
    assert again.document.current.title == "snow"
    assert again.document.pending.title == "slow"
    again.resume()
    idle(again)
    assert again.document.current.title == "slow"
    again.close()


@pytest.mark.parametrize(
    "command",
    [
        ("edit", "SCENE", "snow", "--editor", "command", "-o", "OUT"),
        ("edit", "SCENE", "snow", "-o", "/tmp/elsewhere"),
        ("transform", "SCENE", "--save", "/tmp/x.json", "-o", "OUT/scene.ply"),
        ("convert", "SCENE", "/tmp/x.ply"), ("clean", "SCENE", "--set=save=x", "-o", "OUT/s.ply"),
        ("edit",),
    ],
)  # fmt: skip
def test_work_of_a_foreign_session_is_not_begun(command, opened):
    places = {"SCENE": str(opened.scene_file), "OUT": str(opened.folder / "steps" / "1")}
    for name, place in places.items():
        command = tuple(each.replace(name, place) for each in command)
    opened.change(replace(opened.document, pending=Pending("a step", command)))
    with pytest.raises(UsageError, match="a step"):
        opened.resume()


def test_a_foreign_session_shows_no_file_outside(page, scene, tmp_path_factory):
    folder, elsewhere = scene.with_name("got.session"), tmp_path_factory.mktemp("elsewhere")
    secret = scene.rename(elsewhere / "secret.ply")
    for document in (
        documents.opened(secret, secret, "nice"),
        documents.opened(scene, Path("../../../") / elsewhere.name / secret.name, "nice"),
        documents.Document(str(elsewhere)),
    ):
        documents.save(document, folder)
        with pytest.raises(UsageError, match="outside"):
            open_path(page, folder)
        assert page.folder is None


def test_a_session_that_is_moved_with_its_scene_goes_on(opened, scene, tmp_path):
    step(opened, "snow")
    opened.close()
    moved = scene.parent.rename(tmp_path / "moved")
    again = make_page(tmp_path)
    open_path(again, moved / scene.name)
    assert again.document.current.title == "snow"
    again.undo()
    assert again.scene_file == moved / scene.name
    again.close()


def test_photos_become_a_scene_that_is_opened(page, tmp_path, scene):
    photos = tmp_path / "photos"
    photos.mkdir()
    (photos / "transforms.json").write_text("{}")
    open_path(page, photos)
    assert not page.has_scene
    (tmp_path / "photos").rename(tmp_path / "gone")
    with pytest.raises(UsageError, match="photos"):
        make_scene(page)
    (tmp_path / "gone").rename(photos)
    program = f"scene = {str(scene)!r}" + COMMAND.replace("scene, *rest", "_, *rest")
    page.worker = Worker((sys.executable, "-Sc", program))
    make_scene(page)
    until(lambda: page.has_scene)
    assert page.document.source == str(photos)
    assert len(page.scene) == 600
    page.close()
    again = make_page(tmp_path)
    open_path(again, photos)
    assert len(again.scene) == 600
    again.close()


def test_dropped_files_are_opened_or_refused(page, tmp_path, scene):
    class File:
        name, content = "../../x/bear.ply", scene.read_bytes()

    with pytest.raises(GseditError, match="leaves its folder"):
        receive(page, File)
    File.name = "bear.ply"
    receive(page, File)
    assert page.scene_file == tmp_path.resolve() / "dropped" / "bear.ply"
    receive(page, File)
    assert page.scene_file.name == "bear-2.ply"
    File.name = "notes.txt"
    with pytest.raises(UsageError, match="drop one of these"):
        receive(page, File)
    File.name, File.content = "one.JPG", b"no picture"
    receive(page, File)
    assert not page.has_scene
    assert page.document.source.endswith("photos")
    photos = tmp_path / "dropped" / "photos"
    receive(page, File)
    assert [each.name for each in photos.iterdir()] == ["one.JPG"]
    File.content = b"another of the same name"
    receive(page, File)
    assert {each.read_bytes() for each in photos.iterdir()} == {b"no picture", File.content}
    File.name = "bad.ply"
    with pytest.raises(GseditError, match=r"bad\.ply"):
        receive(page, File)
    assert not (tmp_path / "dropped" / "bad.ply").exists()


def test_the_warm_program_runs_a_command_of_gsedit(scene, monkeypatch):
    worker = Worker((sys.executable, "-m", "gsedit_cli.core.warm"))
    worker.warm()
    monkeypatch.setattr(worker, "warm", lambda: None)  # no process for a next command
    record = worker.run(["info", str(scene), "--json"])
    assert record["gaussians"] == 600


def test_undone_steps_can_be_deleted_and_no_others(opened, tmp_path):
    for title in ("one", "two", "three"):
        step(opened, title)
    opened.go_to(1)
    step(opened, "other")  # now nothing names "two" and "three"
    step(opened, "last")
    opened.undo()
    files = sum(each.stat().st_size for each in opened.folder.glob("steps/00[235]*/*"))
    assert opened.undone()[1] == files > 0
    opened.discard_undone()
    names = [each.name for each in sorted((opened.folder / "steps").iterdir())]
    assert names == ["001-one", "004-other"]
    assert [each.title for each in opened.document.steps] == ["bear.ply", "one", "other"]
    assert not opened.undone()[0]
    with pytest.raises(UsageError, match="last step"):
        opened.redo()
    opened.go_to(0)
    with pytest.raises(UsageError, match="first step"):
        opened.undo()
    assert [each.name for each in opened.undone()[0]] == ["001-one", "004-other"]
    opened.go_to(2)
    assert len(opened.scene) == 600


def test_a_folder_that_is_dropped_is_opened_when_all_of_it_is_there(page, tmp_path, scene):
    class File:
        name, content = "0a1b/bear edit/scene.ply", scene.read_bytes()

    receive(page, File)
    assert not page.has_scene
    File.name, File.content = "0a1b/bear edit/", b" "
    receive(page, File)
    assert page.scene_file == tmp_path.resolve() / "dropped/0a1b/bear edit/scene.ply"
    File.name = "0a1b/../../x.ply"
    with pytest.raises(GseditError, match="leaves its folder"):
        receive(page, File)
    (tmp_path / "dropped" / "link").symlink_to("/tmp")
    File.name = "link/x/y.ply"
    with pytest.raises(UsageError, match="outside"):
        receive(page, File)
    File.name, File.content = "0a1c/empty/", b" "
    with pytest.raises(UsageError, match="no scene"):
        receive(page, File)
