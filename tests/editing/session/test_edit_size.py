"""Views of another size than the editor's are edited at its size, and their change is carried."""

import pytest
import torch
from tiny_edits import painted, steps

from gsedit import Dataset, EditSettings, Event
from gsedit.bench.synthetic import demo_scene, ring_cameras
from gsedit.capture.fitting.settings import UpdateSettings
from gsedit.measures.formulas import psnr
from gsedit.paper.editors import Capabilities, EditProgress
from gsedit.paper.strategies.single_pass import SinglePass
from gsedit.views.dataset import capture

QUICK = EditSettings(update=UpdateSettings(patches=1, patch=16), views_per_batch=2, coverage=1.0)


class Swapped:
    """Red and blue change places; keeps the batches it was given."""

    name, cell = "swapped", 4

    def __init__(self, best_size, enlarges):
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
    return painted(2000)


@pytest.mark.parametrize("best", [36, 144])
def test_views_are_edited_at_the_size_of_the_editor_and_the_targets_are_as_the_views(scene, best):
    cameras = [camera.resized(72, 48) for camera in ring_cameras(demo_scene(), 16, 72)]
    data = Dataset(capture(scene, cameras, [f"{i:02d}" for i in range(16)]))
    editor = Swapped(best, enlarges=best > 72)
    *items, result = steps(scene, data, QUICK, SinglePass(1), editor, "swap")
    assert len(editor.batches) > 1
    for batch in editor.batches:
        shape = (best * 48 // 72, best)
        assert batch.images.shape[1:] == batch.originals.shape[1:] == (*shape, 3)
        if batch.correspondences is None:  # a held-out view, edited alone
            assert len(batch.images) == 1
            continue
        labels = batch.correspondences.labels
        assert labels.shape == (len(batch.images), shape[0] // 4, shape[1] // 4)
        known = batch.images[batch.anchored]
        if len(known):  # finished views are resized with the detail of the picture
            assert psnr(known, batch.originals[batch.anchored].flip(-1)) > 30
    assert editor.batches[1].anchored.any()
    for original, target in zip(result.originals, result.targets):
        assert target.image.shape == (48, 72, 3)
        assert psnr(target.image, original.image.flip(-1)) > 30
    assert result.settings.edit_size == best
    notes = " ".join(item.note for item in items if isinstance(item, Event))
    assert f"edited at {best}x{best * 48 // 72} pixels" in notes
