"""Write a model to time edits with: `python -m research.random_klein FOLDER`.

It has the size of FLUX.2-klein 4B, in diffusers' layout, and random weights in bfloat16 (16 GB).
Its tokenizer knows letters. Making it takes 9 GB of memory.
"""

from __future__ import annotations

import json
from pathlib import Path
from string import printable
from typing import Annotated, Any

import tokenizers
import transformers
import typer
from diffusers.models.autoencoders.autoencoder_kl_flux2 import AutoencoderKLFlux2
from diffusers.schedulers.scheduling_flow_match_euler_discrete import (
    FlowMatchEulerDiscreteScheduler,
)

from gsedit.errors import UsageError
from research.command import print_result, run
from research.measure_klein import language_model, transformer

CHAT = "{% for message in messages %}{{ message.content }}{% endfor %}"
CLASSES = {
    "transformer": ("diffusers", "Flux2Transformer2DModel"),
    "vae": ("diffusers", "AutoencoderKLFlux2"),
    "text_encoder": ("transformers", "Qwen3ForCausalLM"),
    "tokenizer": ("transformers", "PreTrainedTokenizerFast"),
    "scheduler": ("diffusers", "FlowMatchEulerDiscreteScheduler"),
}
LAYERS = 36  # of Qwen3 4B, of which an edit reads 28


def letters() -> Any:
    """A tokenizer with a number for each printable letter."""
    vocabulary = {name: index for index, name in enumerate(["<pad>", *printable])}
    words = tokenizers.Tokenizer(tokenizers.models.WordLevel(vocabulary, unk_token="<pad>"))
    words.pre_tokenizer = tokenizers.pre_tokenizers.Split("", "isolated")
    library: Any = transformers
    names = {"pad_token": "<pad>", "unk_token": "<pad>", "chat_template": CHAT}
    return library.PreTrainedTokenizerFast(tokenizer_object=words, **names)


def main(folder: Annotated[Path, typer.Argument(help="New folder of the model.")]) -> None:
    """Write FLUX.2-klein's size with random weights."""
    if folder.exists():
        raise UsageError(f"{folder} exists: name a new folder")
    transformer().save_pretrained(folder / "transformer")
    language_model(LAYERS).save_pretrained(folder / "text_encoder")
    AutoencoderKLFlux2().save_pretrained(folder / "vae")
    FlowMatchEulerDiscreteScheduler(use_dynamic_shifting=True).save_pretrained(folder / "scheduler")
    letters().save_pretrained(folder / "tokenizer")
    index = {"_class_name": "Flux2KleinPipeline", "is_distilled": True} | CLASSES
    (folder / "model_index.json").write_text(json.dumps(index))
    print_result(f"{folder}")


if __name__ == "__main__":
    run(main)
