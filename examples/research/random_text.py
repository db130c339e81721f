"""CLIP's text encoder at Stable Diffusion 1.5's size, with random weights, and a tokenizer."""

from __future__ import annotations

import json
import tempfile
from pathlib import Path
from string import ascii_lowercase
from typing import Any

import torch
import transformers

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
