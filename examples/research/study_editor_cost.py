"""Compare the cost that an edit states with its time: `python -m research.study_editor_cost`.

A model of InstructPix2Pix's size (Stable Diffusion 1.5) with random weights edits three views.
"""

from __future__ import annotations

import json
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from string import ascii_lowercase
from typing import Any

import torch
import transformers
from diffusers.models.autoencoders.autoencoder_kl import AutoencoderKL
from diffusers.models.unets.unet_2d_condition import UNet2DConditionModel

from gsedit.diffusion.schedules import Schedule
from gsedit.editing.session.presets import find_preset
from gsedit.editor_protocol import Cost, EditBatch
from gsedit.editors.sampling import DiffusionEditor
from gsedit.models.runtime import make_runtime
from gsedit.models.stable_diffusion import Pix2Pix, TextEncoder
from research.command import print_result, run

SIZE = 256  # pixels
LETTERS = [*ascii_lowercase, *(f"{letter}</w>" for letter in ascii_lowercase)]
ENDS = ["<|startoftext|>", "<|endoftext|>"]
START, END = len(LETTERS), len(LETTERS) + 1
PROMPT = "turn it into a bronze statue"
ALLOWED = 0.2
"""Relative error that an estimate may have."""


def text_encoder() -> Any:
    """CLIP's text encoder of Stable Diffusion 1.5, with initial weights."""
    ends = {"bos_token_id": START, "eos_token_id": END, "pad_token_id": END}
    sizes = {"hidden_size": 768, "intermediate_size": 3072}
    library: Any = transformers
    config = library.CLIPTextConfig(num_hidden_layers=12, num_attention_heads=12, **sizes, **ends)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(1)
        return library.CLIPTextModel(config)


def tokenizer() -> Any:
    """CLIP's tokenizer with the letters as its words."""
    with tempfile.TemporaryDirectory() as folder:
        words, merges = Path(folder) / "vocab.json", Path(folder) / "merges.txt"
        words.write_text(json.dumps({word: i for i, word in enumerate([*LETTERS, *ENDS])}))
        merges.write_text("#version: 0.2\n")
        library: Any = transformers
        return library.CLIPTokenizer(str(words), str(merges), model_max_length=77)


def full_size(runtime: str = "torch") -> Pix2Pix:
    """InstructPix2Pix of Stable Diffusion 1.5, with torch's initial weights."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)
        unet: Any = UNet2DConditionModel.from_config(
            {"in_channels": 8, "cross_attention_dim": 768, "attention_head_dim": 8}
            | {"sample_size": 64}
        )
        vae: Any = AutoencoderKL.from_config(
            {"block_out_channels": (128, 256, 512, 512), "layers_per_block": 2}
            | {"down_block_types": ("DownEncoderBlock2D",) * 4}
            | {"up_block_types": ("UpDecoderBlock2D",) * 4, "sample_size": 512}
        )
    return Pix2Pix(
        unet=unet.eval().requires_grad_(False),
        vae=vae.eval().requires_grad_(False),
        text_encoders=(TextEncoder(text_encoder().eval().requires_grad_(False), tokenizer()),),
        schedule=Schedule.scaled_linear(),
        predicts="eps",
        run=make_runtime(runtime),
        zeros_for_empty=False,
    )


def picture() -> torch.Tensor:
    """A smooth picture with an edge, which has colors as a photo has them."""
    y, x = torch.meshgrid(*[torch.linspace(0, 1, SIZE)] * 2, indexing="ij")
    disc = ((x - 0.5) ** 2 + (y - 0.5) ** 2 < 0.09).float()
    colors = torch.stack((0.3 + 0.4 * x, 0.6 - 0.3 * y, 0.5 - 0.2 * x * y), -1)
    return (colors * (1 - disc[..., None]) + torch.tensor((0.6, 0.4, 0.25)) * disc[..., None])[None]


def estimated(model: Pix2Pix, precision: str) -> tuple[Cost, float]:
    """(the cost that is stated before, the seconds that a batch of three views then takes)."""
    shades = torch.tensor((1.0, 0.9, 0.8))[:, None, None, None]
    views = picture() * shades
    settings = replace(find_preset("quick").settings.sampler, steps=10, precision=precision)  # pyright: ignore[reportArgumentType]
    editor, batch = DiffusionEditor(model), EditBatch(views, views, PROMPT)
    cost = editor.measure(batch, settings)
    brighter = replace(batch, images=views * 1.1, originals=views * 1.1)  # not encoded before
    started = time.monotonic()
    list(editor.edit(brighter, settings, torch.Generator().manual_seed(0)))
    return cost, time.monotonic() - started


def main(runtime: str = "openvino", precision: str = "bfloat16") -> None:
    """Print the estimate beside the time."""
    cost, seconds = estimated(full_size(runtime), precision)
    ratio = cost.seconds(3) / seconds
    verdict = "right" if abs(ratio - 1) <= ALLOWED else "WRONG"
    print_result(
        f"estimate of three views: {cost.seconds(3):.1f} s, they took {seconds:.1f} s "
        f"({verdict}: {ratio - 1:+.0%}, {ALLOWED:.0%} is allowed); "
        f"{cost.evaluation_s:.2f} s an evaluation, encoding {cost.encode_s:.2f} s, decoding "
        f"{cost.decode_s:.2f} s, {cost.peak_bytes / 1e9:.1f} GB"
    )


if __name__ == "__main__":
    run(main)
