"""Views larger than the editor's size are edited small, and their change is carried up."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from gsedit_cli.options.editing import at_size

from gsedit import Dataset, EditSettings, Event, edit_steps
from gsedit.datasets.dataset import capture
from gsedit.editors import Capabilities, EditProgress
from gsedit.errors import UsageError
from gsedit.fitting.settings import UpdateSettings
from gsedit.measures.metrics import psnr
from gsedit.paper.strategies.single_pass import SinglePass
from gsedit.synthetic import demo_scene, ring_cameras, surface_gaussians

QUICK = EditSettings(update=UpdateSettings(patches=1, patch=16), views_per_batch=2, coverage=1.0)


class Swapped:
    """Red and blue change places; keeps the batches it was given."""

    name, cell = "swapped", 4

    def __init__(self, best_size=None, enlarges=False):
        self.capabilities = Capabilities(best_size=best_size, enlarges=enlarges)
        self.batches = []

    def check(self, prompt):
        pass

    def edit(self, batch, settings, generator):
        self.batches.append(batch)
        anchored = batch.anchored[:, None, None, None]
        yield EditProgress(1, 1, torch.where(anchored, batch.images, batch.originals.flip(-1)))


@pytest.fixture(scope="module")
def scene():
    return surface_gaussians(demo_scene(), 2000, torch.Generator().manual_seed(0))


@pytest.fixture(scope="module")
def data(scene):
    cameras = [camera.resized(72, 48) for camera in ring_cameras(demo_scene(), 16, 72)]
    return Dataset(capture(scene, cameras, [f"{i:02d}" for i in range(16)]))


def run(scene, data, editor, **settings):
    settings = replace(QUICK, **settings)
    strategy, generator = SinglePass(1), torch.Generator().manual_seed(0)
    return list(
        edit_steps(
            scene,
            "swap",
            editor=editor,
            generator=generator,
            views=data,
            settings=settings,
            strategy=strategy,
        )
    )


def test_the_editor_is_given_small_pictures_and_the_targets_are_large(scene, data):
    editor = Swapped(best_size=36)
    *items, result = run(scene, data, editor)
    assert len(editor.batches) > 1
    for batch in editor.batches:
        assert batch.images.shape[1:] == batch.originals.shape[1:] == (24, 36, 3)
        assert batch.correspondences.labels.shape == (len(batch.images), 6, 9)
    assert editor.batches[1].anchored.any()
    for original, target in zip(result.originals, result.targets):
        assert target.image.shape == (48, 72, 3)
        assert psnr(target.image, original.image.flip(-1)) > 30
    assert result.settings.edit_size == 36
    notes = " ".join(item.note for item in items if isinstance(item, Event))
    assert "edited at 36x24 pixels" in notes
    assert "72x48" in notes


def test_the_setting_overrules_the_editor_and_nothing_is_made_larger(scene, data):
    for editor, settings in (
        (Swapped(), {}),
        (Swapped(best_size=512), {}),
        (Swapped(best_size=36), {"edit_size": 72}),
    ):
        *items, _ = run(scene, data, editor, batches=1, **settings)
        assert editor.batches[0].images.shape == (2, 48, 72, 3)
        assert not any("edited at" in item.note for item in items if isinstance(item, Event))


def test_small_views_are_edited_large_where_the_editor_was_made_for_that(scene, data):
    editor = Swapped(best_size=144, enlarges=True)
    *items, result = run(scene, data, editor)
    for batch in editor.batches:
        assert batch.images.shape[1:] == batch.originals.shape[1:] == (96, 144, 3)
        assert batch.correspondences.labels.shape == (len(batch.images), 24, 36)
        known = batch.images[batch.anchored]
        if len(known):  # finished views are enlarged with the detail of the large picture
            assert psnr(known, batch.originals[batch.anchored].flip(-1)) > 30
    assert editor.batches[1].anchored.any()
    for original, target in zip(result.originals, result.targets):
        assert target.image.shape == (48, 72, 3)
        assert psnr(target.image, original.image.flip(-1)) > 30
    assert result.settings.edit_size == 144
    notes = " ".join(item.note for item in items if isinstance(item, Event))
    assert "edited at 144x96 pixels" in notes


def test_photos_are_not_enlarged(scene, data):
    editor = Swapped(best_size=144, enlarges=True)
    run(scene, data, editor, batches=1, condition="photo")
    assert editor.batches[0].images.shape[1:] == (48, 72, 3)


@pytest.mark.parametrize(("size", "expected"), [(256, 256), (1024, 512), (None, None)])
def test_an_explicit_size_is_the_editor_s_too(capsys, size, expected):
    editor = Swapped(best_size=512, enlarges=True)
    assert at_size(EditSettings(), editor, size).edit_size == expected
    assert ("made for 512 pixels" in capsys.readouterr().err) == (size == 256)
    assert at_size(EditSettings(), Swapped(best_size=512), size).edit_size is None


def test_a_size_in_which_nothing_is_seen_is_refused():
    with pytest.raises(UsageError, match="16 or more"):
        EditSettings(edit_size=8)
