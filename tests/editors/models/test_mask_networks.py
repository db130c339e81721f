"""Networks as mask providers, against transformers' own classes run directly on tiny weights."""

import pytest
import tiny_segmenters as tiny
import torch
from PIL import Image

from gsedit.paper.editors import make_masks
from gsedit.paper.models import mask_networks as networks

PHRASE = "the red chair"


def pictures():
    """Two pictures of different size, whose values survive eight bits."""
    g = torch.Generator().manual_seed(0)
    sizes = ((24, 40), (33, 20))
    return [torch.randint(0, 256, (*size, 3), generator=g) / 255 for size in sizes]


def images():
    return [Image.fromarray((255 * each).round().byte().numpy()) for each in pictures()]


@pytest.fixture(scope="module")
def clipseg(tmp_path_factory):
    place = tmp_path_factory.mktemp("clipseg")
    model = tiny.clipseg(place / "words")
    return model, tiny.saved(place / "model", model)


@pytest.fixture(scope="module")
def grounded(tmp_path_factory):
    place = tmp_path_factory.mktemp("grounded")
    models = tiny.grounding_dino(place / "words"), tiny.sam()
    folders = [tiny.saved(place / name, model) for name, model in zip(("dino", "sam"), models)]
    return models, folders


@torch.no_grad()
def test_clipseg_is_equal_to_transformers(clipseg):
    (network, processor), folder = clipseg
    provider = make_masks("clipseg", model=str(folder))
    provider.check(PHRASE)
    found = list(provider.masks(pictures(), PHRASE))
    for mask, image in zip(found, images(), strict=True):
        inputs = processor(text=[PHRASE], images=[image], return_tensors="pt")
        logits = network(**inputs).logits.reshape(1, 1, 32, 32)
        size = (image.height, image.width)
        expected = torch.nn.functional.interpolate(logits, size, mode="bilinear")[0, 0].sigmoid()
        torch.testing.assert_close(mask, expected)
        assert expected.std() > 1e-4


@torch.no_grad()
def test_grounding_dino_and_sam_are_equal_to_transformers(grounded, monkeypatch):
    ((dino, dino_processor), (sam, sam_processor)), (first, second) = grounded
    image, picture = images()[0], pictures()[0]
    inputs = dino_processor(images=image, text=f"{PHRASE}.", return_tensors="pt")
    outputs = dino(**inputs)
    scores = outputs.logits.sigmoid().amax(-1)[0]
    threshold = float(scores.sort().values[-3:-1].mean())  # two boxes are surer
    monkeypatch.setattr(networks, "BOX_SCORE", threshold)
    (found,) = dino_processor.post_process_grounded_object_detection(
        outputs, inputs.input_ids, threshold=threshold, target_sizes=[(image.height, image.width)]
    )
    assert 0 < len(found["boxes"]) < 12
    expected = torch.zeros(image.height, image.width)
    for box in found["boxes"].tolist():
        asked = sam_processor(image, input_boxes=[[box]], return_tensors="pt").to(torch.float32)
        sizes = asked.pop("original_sizes"), asked.pop("reshaped_input_sizes")
        out = sam(**asked, multimask_output=False).pred_masks
        (logits,) = sam_processor.image_processor.post_process_masks(out, *sizes, binarize=False)
        expected = torch.maximum(expected, logits[0, 0].sigmoid())
    provider = make_masks("grounded-sam", model=str(first), sam=str(second))
    provider.check(PHRASE)
    (mask,) = provider.masks([picture], "The red chair")
    torch.testing.assert_close(mask, expected)
    assert expected.std() > 1e-4
