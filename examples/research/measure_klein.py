"""Seconds and memory of FLUX.2-klein 4B's networks, with random weights: no picture is judged.

    python -m research.measure_klein PART SIDE

Parts, each in a process of its own so that its peak is its own: transformer, vae, text. To edit a
view takes one reading of the text, two encodings of a picture (the condition and the start), four
evaluations of the transformer and a decoding. torch's threads: OMP_NUM_THREADS.
"""

from __future__ import annotations

import os
import resource
import sys
from collections.abc import Callable
from time import perf_counter, process_time
from typing import Any

import torch
from accelerate import init_empty_weights
from diffusers.models.autoencoders.autoencoder_kl_flux2 import AutoencoderKLFlux2
from diffusers.models.transformers.transformer_flux2 import Flux2Transformer2DModel
from torch import Tensor
from transformers import Qwen3Config, Qwen3ForCausalLM

from gsedit.bench.provenance import provenance
from gsedit.diffusion.flow import FlowScheduler
from gsedit.diffusion.guidance import Need
from gsedit.models.klein import LAYERS, LENGTH, Condition, Klein
from gsedit.models.tokens import packed
from research.command import print_message, print_result

FEATURES = 7680  # numbers of a text token: three layers of 2560
BLOCK = 1 << 20  # weights drawn; the others repeat them, since drawing billions takes minutes
TEXT_ONLY = Need(image=False, none=False)


def filled(make: Callable[[], Any]) -> Any:
    """The network that this makes, in bfloat16, its weights drawn from a small normal law."""
    with init_empty_weights():
        network = make()
    network = network.to(torch.bfloat16).to_empty(device="cpu").eval().requires_grad_(False)
    drawn = (0.02 * torch.randn(BLOCK, generator=torch.Generator().manual_seed(0))).bfloat16()
    for weight in network.parameters():
        for part in weight.view(-1).split(BLOCK):
            part.copy_(drawn[: len(part)])
    weights = sum(each.numel() for each in network.parameters())
    print_message(f"{weights / 1e9:.3f} billion weights")
    return network


def timed(name: str, work: Callable[[], Tensor]) -> str:
    """A row: wall clock and processor seconds of one run, and the process's peak until then."""
    wall, cpu = perf_counter(), process_time()
    finite = bool(work().isfinite().all())
    wall, cpu = perf_counter() - wall, process_time() - cpu
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9
    print_message(f"{name}: {wall:.1f} s, {cpu:.1f} CPU s, peak {peak:.1f} GB, finite: {finite}")
    return f"| {name} | {wall:.1f} | {cpu:.1f} | {peak:.1f} | {os.getloadavg()[0]:.0f} |"


def klein(**networks: Any) -> Klein:
    """The model of these networks; those that are missing are never called."""
    flow = FlowScheduler(dynamic=True)
    missing = dict.fromkeys(("transformer", "vae", "text_encoder", "tokenizer"))
    return Klein(**{**missing, **networks}, flow=flow, schedule=flow.schedule)


def transformer() -> Any:
    """The transformer of klein 4B."""
    return filled(
        lambda: Flux2Transformer2DModel(
            num_layers=5,
            num_single_layers=20,
            num_attention_heads=24,
            joint_attention_dim=FEATURES,
            guidance_embeds=False,
        )
    )


def language_model(layers: int) -> Any:
    """Qwen3 4B with so many layers."""
    config = Qwen3Config(
        hidden_size=2560,
        intermediate_size=9728,
        num_hidden_layers=layers,
        num_attention_heads=32,
        num_key_value_heads=8,
        vocab_size=151936,
        tie_word_embeddings=True,
    )
    network = filled(lambda: Qwen3ForCausalLM(config))
    network.model.rotary_emb = type(network.model.rotary_emb)(config)  # its numbers are no weights
    return network


def of_transformer(side: int) -> list[str]:
    """An evaluation of one view, with the tokens of its unedited picture."""
    network = transformer()
    latents = torch.randn(1, 32, side // 8, side // 8)
    text = torch.randn(1, LENGTH, FEATURES).bfloat16()
    condition = Condition(packed(latents).bfloat16(), text, None)
    model = klein(transformer=network)
    return [
        timed(
            f"transformer, {side} pixels, bfloat16",
            lambda: model.predict(latents, 700.0, condition, TEXT_ONLY)[0],
        )
    ]


def of_vae(side: int) -> list[str]:
    """An encoding and a decoding of one view."""
    model = klein(vae=AutoencoderKLFlux2().eval().requires_grad_(False))
    picture, latents = torch.rand(1, side, side, 3), torch.randn(1, 32, side // 8, side // 8)
    return [
        timed(f"encode, {side} pixels, float32", lambda: model.encode(picture)),
        timed(f"decode, {side} pixels, float32", lambda: model.decode(latents)),
    ]


def of_text() -> list[str]:
    """A reading of one instruction by Qwen3 4B, without the layers that are not looked at."""
    network = language_model(LAYERS[-1] + 1).model
    ids = torch.randint(0, 150_000, (1, LENGTH), generator=torch.Generator().manual_seed(0))
    return [timed("text encoder, bfloat16", lambda: network(ids, use_cache=False)[0])]


@torch.no_grad()
def main() -> None:
    """Print the table of one part."""
    part, side = sys.argv[1], int(sys.argv[2])
    rows = {"transformer": of_transformer, "vae": of_vae, "text": lambda _: of_text()}[part](side)
    of = provenance()
    print_result(f"{of.date}, commit {of.commit}. {of.machine}, {of.threads} threads.")
    head = ("| | s a view | CPU s | peak GB | load |", "|---|---|---|---|---|")
    print_result("\n".join((*head, *rows)))


if __name__ == "__main__":
    main()
