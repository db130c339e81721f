"""Write a model to time edits with: `python -m research.random_pix2pix FOLDER`.

It has the size of InstructPix2Pix of Stable Diffusion 1.5, in diffusers' layout, and random weights
(4 GB). Its text encoder reads letters. `gsedit edit ... --editor pix2pix --model FOLDER` takes it.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, cast

import diffusers
import typer

from gsedit.errors import UsageError
from research.command import print_result, run
from research.random_text import text_encoder, tokenizer
from research.study_editor_cost import full_size


def main(folder: Annotated[Path, typer.Argument(help="New folder of the model.")]) -> None:
    """Write InstructPix2Pix of Stable Diffusion 1.5's size with random weights."""
    if folder.exists():
        raise UsageError(f"{folder} exists: name a new folder")
    model, library = full_size(), cast("Any", diffusers)
    schedule = {"beta_start": 0.00085, "beta_end": 0.012, "beta_schedule": "scaled_linear"}
    ends = {"clip_sample": False, "set_alpha_to_one": False, "steps_offset": 1}
    library.StableDiffusionInstructPix2PixPipeline(
        unet=model.unet,
        vae=model.vae,
        text_encoder=text_encoder(),
        tokenizer=tokenizer(),
        scheduler=library.DDIMScheduler(**schedule, **ends),
        safety_checker=None,
        feature_extractor=None,
        requires_safety_checker=False,
    ).save_pretrained(folder)
    print_result(f"{folder}")


if __name__ == "__main__":
    run(main)
