"""Write a model to time edits with: `python -m research.random_pix2pix FOLDER`.

It has the size of InstructPix2Pix of Stable Diffusion 1.5, in diffusers' layout, and random weights
(4 GB). Its text encoder reads letters. `gsedit edit ... --editor pix2pix --model FOLDER` takes it.
"""

from __future__ import annotations

import json
import tempfile
from pathlib import Path
from string import ascii_lowercase
from typing import Annotated, Any, cast

import diffusers
import torch
import transformers
import typer

from gsedit.errors import UsageError
from research.command import print_result, run
from research.study_editor_cost import full_size

LETTERS = [*ascii_lowercase, *(f"{letter}</w>" for letter in ascii_lowercase)]
ENDS = ["<|startoftext|>", "<|endoftext|>"]
START, END = len(LETTERS), len(LETTERS) + 1


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
