"""A network as a mask provider, against transformers' own classes run directly on tiny weights."""

import pytest
import torch
import transformers
from PIL import Image
from tiny_models import tiny_tokenizer

from gsedit.paper.editors import make_masks

PHRASE = "the red chair"
VIT = getattr(transformers, "ViTImageProcessorPil", transformers.ViTImageProcessor)
"""The processor of pictures that needs no torchvision, by either name."""


def seeded(kind, config):
    """A network of random weights, large enough that outputs differ from pixel to pixel."""
    with torch.random.fork_rng():
        torch.manual_seed(0)
        network = kind(config).eval()
        for weight in network.parameters():
            if weight.ndim > 1:
                weight.data += 0.2 * torch.randn_like(weight)
    return network


def tiny_clipseg(place):
    """CLIPSeg of random weights and its processor, for pictures of 32 pixels."""
    sizes = {"hidden_size": 32, "intermediate_size": 37, "num_attention_heads": 4}
    ends = {"bos_token_id": 53, "eos_token_id": 54, "pad_token_id": 54}
    config = transformers.CLIPSegConfig(
        text_config={**sizes, **ends, "vocab_size": 55, "num_hidden_layers": 2},
        vision_config={**sizes, "num_hidden_layers": 3, "image_size": 32, "patch_size": 8},
        projection_dim=16,
        extract_layers=[0, 1],
        reduce_dim=16,
        decoder_num_attention_heads=2,
        decoder_intermediate_size=16,
    )
    pictures = VIT(size={"height": 32, "width": 32})
    processor = transformers.CLIPSegProcessor(pictures, tiny_tokenizer(place))
    return seeded(transformers.CLIPSegForImageSegmentation, config), processor


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
    model = tiny_clipseg(place / "words")
    for part in model:
        part.save_pretrained(place / "model")
    return model, place / "model"


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
