"""Seconds of DreamLite-mobile's networks at full size, with random weights: no picture is judged.

    python -m research.measure_dreamlite [PART ...]

Parts: 256 and 512 (the U-Net and the autoencoder at that size), text (the text encoder, 2 billion
weights, 5 GB of memory), edit-256 and edit-512 (12 views, with everything). To edit a view takes
two encodings of a picture (the condition and the start), one reading of the text, four passes of
the U-Net and a decoding. torch's threads: OMP_NUM_THREADS.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from time import perf_counter, process_time
from typing import Any

import torch
import transformers
from diffusers.models.autoencoders.autoencoder_tiny import AutoencoderTiny
from diffusers.models.unets.unet_dreamlite import DreamLiteUNetModel
from jaxtyping import Float
from torch import Tensor
from transformers.initialization import no_init_weights

from gsedit.bench.provenance import provenance
from gsedit.diffusion.flow import FlowScheduler
from gsedit.diffusion.guidance import Need
from gsedit.diffusion.precision import relative_error
from gsedit.diffusion.settings import SamplerSettings
from gsedit.editors import EditBatch
from gsedit.editors.sampling import DiffusionEditor
from gsedit.models.dreamlite import READ_AT, Condition, DreamLite
from gsedit.models.vision_language import SYSTEM_TOKENS, Reader
from research.command import print_message, print_result

VIEWS = 12
BATCH = 2  # views in a pass
WORDS = 40  # tokens of a request besides the system's and the picture's: DreamLite's, a sentence
PATCH, MERGED = 16, 2  # pixels of a patch of Qwen3-VL; patches along a side of a token
MOBILE = Need(image=False, none=False)


def timed(
    name: str, work: Callable[[], Tensor], views: int, *, warm: bool = True
) -> tuple[str, Tensor]:
    """(a row: wall clock and processor seconds a view; the result). `warm`: of a second run."""
    if warm:
        work()
    wall, cpu = perf_counter(), process_time()
    result = work()
    wall, cpu = (perf_counter() - wall) / views, (process_time() - cpu) / views
    load = os.getloadavg()[0]
    print_message(f"{name}: {wall:.2f} s, {cpu:.2f} CPU s a view, load {load:.1f}")
    return f"| {name} | {wall:.2f} | {cpu:.2f} | {load:.0f} |", result


class OneRequest(Reader):
    """Reads one request of DreamLite's length beside every picture."""

    def excess(self, text: str) -> int:
        return 0

    def features(
        self, images: Float[Tensor, "v h w 3"], text: str, size: tuple[int, int], at_once: int
    ) -> Float[Tensor, "v l d"]:
        work = reading(self.network)
        return torch.cat([work()[:, SYSTEM_TOKENS:] for _ in images]).float()


def random_model(network: Any = None) -> DreamLite:
    """DreamLite-mobile of the classes' default sizes, with this text encoder."""
    scheduler = FlowScheduler(dynamic=True)
    return DreamLite(
        unet=DreamLiteUNetModel().eval().requires_grad_(False),
        vae=AutoencoderTiny().eval().requires_grad_(False),
        reader=OneRequest(network, None, None),
        scheduler=scheduler,
        schedule=scheduler.schedule,
        distilled=True,
        micro_batch=BATCH,
    )


def networks(side: int) -> list[str]:
    """Rows of the U-Net in both precisions, and of the autoencoder."""
    model = random_model()
    images = torch.rand(BATCH, side, side, 3, generator=torch.Generator().manual_seed(0))
    latents = model.encode(images)
    text = torch.randn(BATCH, WORDS + tokens_of_picture(), 2048)
    condition = Condition(latents, text, None, (side, side))

    def passed() -> Tensor:
        return torch.cat(model.predict(latents, 500.0, condition, MOBILE))

    full, expected = timed(f"U-Net, {side} pixels, float32", passed, BATCH)
    model.unet.to(dtype=torch.bfloat16)
    half, found = timed(f"U-Net, {side} pixels, bfloat16", passed, BATCH)
    coded, _ = timed(f"encode, {side} pixels", lambda: model.encode(images), BATCH)
    decoded, _ = timed(f"decode, {side} pixels", lambda: model.decode(latents), BATCH)
    print_message(f"bfloat16: relative error {relative_error(found, expected):.1e}")
    weights = sum(each.numel() for each in model.unet.parameters())
    print_message(f"U-Net: {weights / 1e9:.3f} billion weights")
    return [full, half, coded, decoded]


def tokens_of_picture() -> int:
    """Tokens of the picture that the text encoder sees."""
    return READ_AT[0] * READ_AT[1] // (PATCH * MERGED) ** 2


def text_encoder() -> transformers.Qwen3VLForConditionalGeneration:
    """Qwen3-VL 2B's shape, bfloat16. All weights are a constant: drawing them takes minutes."""
    config = transformers.Qwen3VLConfig(
        text_config={
            "hidden_size": 2048,
            "intermediate_size": 6144,
            "num_hidden_layers": 28,
            "num_attention_heads": 16,
            "num_key_value_heads": 8,
            "head_dim": 128,
            "vocab_size": 151936,
            "rope_scaling": {"mrope_section": [24, 20, 20], "rope_type": "default"},
            "rope_theta": 5e6,
        },
        vision_config={
            "depth": 24,
            "hidden_size": 1024,
            "intermediate_size": 4096,
            "num_heads": 16,
            "out_hidden_size": 2048,
            "deepstack_visual_indexes": [5, 11, 17],
        },
        tie_word_embeddings=True,
    )
    torch.set_default_dtype(torch.bfloat16)
    try:
        with no_init_weights():
            network = transformers.Qwen3VLForConditionalGeneration(config)
    finally:
        torch.set_default_dtype(torch.float32)
    for weight in network.requires_grad_(False).parameters():
        weight.fill_(1e-3)
    return network.eval()


def reading(network: transformers.Qwen3VLForConditionalGeneration) -> Callable[[], Tensor]:
    """A request of DreamLite's length beside one picture of READ_AT."""
    config = network.config
    rows, columns = (side // PATCH for side in READ_AT)
    ids = torch.full((1, SYSTEM_TOKENS + WORDS + tokens_of_picture()), 5)
    ids[:, SYSTEM_TOKENS : SYSTEM_TOKENS + tokens_of_picture()] = config.image_token_id
    pixels = torch.zeros(rows * columns, 3 * 2 * PATCH**2, dtype=network.dtype)
    grid = torch.tensor([[1, rows, columns]])

    def work() -> Tensor:
        return network.model(
            input_ids=ids,
            attention_mask=torch.ones_like(ids),
            pixel_values=pixels,
            image_grid_thw=grid,
            mm_token_type_ids=(ids == config.image_token_id).int(),
            use_cache=False,
        ).last_hidden_state

    return work


def edit(side: int) -> str:
    """A row: 12 views edited at once, by the editor itself."""
    model = random_model(text_encoder())
    model.unet.to(dtype=torch.bfloat16)  # as the weights are published
    images = torch.rand(VIEWS, side, side, 3, generator=torch.Generator().manual_seed(0))
    settings = SamplerSettings(precision="float32")  # weights keep their dtype
    batch = EditBatch(images, images, "make it snow")
    steps = DiffusionEditor(model).edit(batch, settings, torch.Generator().manual_seed(0))

    def work() -> Tensor:
        *_, last = steps
        assert last.images is not None
        return last.images

    return timed(f"whole edit, {VIEWS} views, {side} pixels", work, VIEWS, warm=False)[0]


@torch.no_grad()
def main() -> None:
    """Print a table of the parts named, or of all."""
    parts = sys.argv[1:] or ["256", "512", "text"]
    rows = []
    for part in parts:
        if part == "text":
            network = text_encoder()
            weights = sum(each.numel() for each in network.parameters())
            print_message(f"text encoder: {weights / 1e9:.2f} billion weights")
            rows.append(timed("text encoder, bfloat16", reading(network), 1)[0])
        elif part.startswith("edit-"):
            rows.append(edit(int(part.removeprefix("edit-"))))
        else:
            rows += networks(int(part))
    of = provenance()
    print_result(f"{of.date}, commit {of.commit}. {of.machine}, {of.threads} threads.")
    print_result("\n".join(("| | s a view | CPU s | load |", "|---|---|---|---|", *rows)))


if __name__ == "__main__":
    main()
