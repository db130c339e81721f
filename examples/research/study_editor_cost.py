"""Study of what an edit by a diffusion model costs: `python -m research.study_editor_cost`.

A model of InstructPix2Pix's size (Stable Diffusion 1.5) with random weights samples one view with
each way of sparing work; what is printed is the processor time, and the relative change of the
final latent against the full computation. `small` does the same with its own weights. Results are
appended to a file, so that cases can be run one by one: a loaded machine takes a minute for each.
"""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import torch
import typer
from diffusers.models.autoencoders.autoencoder_kl import AutoencoderKL
from diffusers.models.unets.unet_2d_condition import UNet2DConditionModel

from gsedit.diffusion.guidance import Need
from gsedit.diffusion.guided import branches_of
from gsedit.diffusion.precision import InBfloat16, relative_error
from gsedit.diffusion.sampler import add_noise, sample
from gsedit.diffusion.schedules import Schedule
from gsedit.diffusion.settings import SamplerSettings
from gsedit.editing.session.presets import find_preset
from gsedit.editor_protocol import Cost, Denoiser, EditBatch, levels_for
from gsedit.editors.sampling import DiffusionEditor
from gsedit.editors.small.denoiser import load_small
from gsedit.models.runtimes import make_runtime
from gsedit.models.stable_diffusion import Pix2Pix, TextEncoder
from research.command import print_message, print_result, run
from research.random_text import text_encoder, tokenizer

FULL = SamplerSettings(consensus=False, steps=20, solver="ddim", spacing="leading")
QUICK: dict[str, Any] = {"guidance_every": 3, "guidance_end": 1.0}
"""The preset, without its other values."""
CASES = {
    "full: 20 steps of DDIM": FULL,
    "12 steps of DPM-Solver++": replace(FULL, solver="dpm++2m", steps=12),
    "10 steps of DPM-Solver++": replace(FULL, solver="dpm++2m", steps=10),
    "8 steps of DPM-Solver++": replace(FULL, solver="dpm++2m", steps=8),
    "10 steps of DDIM": replace(FULL, steps=10),
    "guidance above sigma 0.5": replace(FULL, guidance_end=0.5),
    "guidance above sigma 1": replace(FULL, guidance_end=1.0),
    "guidance above sigma 2": replace(FULL, guidance_end=2.0),
    "guidance every 2nd step": replace(FULL, guidance_every=2),
    "guidance every 3rd step": replace(FULL, guidance_every=3),
    "image guidance 1": replace(FULL, guidance_image=1.0),
    "--preset quick": replace(FULL, **QUICK),
    "--preset quick --steps 10": replace(FULL, **QUICK, steps=10),
}
SIZE = 256  # pixels
PROMPT = "turn it into a bronze statue"
ALLOWED = 0.2
"""Relative error that an estimate may have."""


@dataclass(frozen=True)
class Words:
    """A stand-in for a tokenizer: a text is the sum of its letters."""

    model_max_length: int = 77

    def __call__(self, text: str, **options: Any) -> Any:
        return type("Tokens", (), {"input_ids": torch.tensor([[sum(map(ord, text))]])})


def random_features(ids: torch.Tensor) -> tuple[torch.Tensor]:
    """A stand-in for a text encoder: normal features, as CLIP's last layer norm has them."""
    generator = torch.Generator().manual_seed(int(ids.sum()))
    return (torch.randn(1, 77, 768, generator=generator),)


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
        text_encoders=(TextEncoder(random_features, Words()),),
        schedule=Schedule.scaled_linear(),
        predicts="eps",
        run=make_runtime(runtime),
        zeros_for_empty=False,
    )


def sampled(
    model: Denoiser, settings: SamplerSettings, picture: torch.Tensor, prompt: str
) -> tuple[torch.Tensor, float, int]:
    """(final latents, processor seconds, evaluations) of one view."""
    settings = settings.with_defaults(model.capabilities.defaults)
    z0 = torch.zeros_like(model.encode(picture))  # noise alone: the picture is the condition
    generator = torch.Generator().manual_seed(0)
    noise = torch.randn(z0.shape, generator=generator) * settings.noise_scale
    levels = levels_for(model, settings, (z0.shape[2], z0.shape[3]))
    condition = model.condition(picture, prompt, generator)
    rounded = settings.precision == "bfloat16"
    network = InBfloat16(model) if rounded else model
    x = add_noise(z0, noise, levels[0])
    network.branches(x, levels[0].t, condition, Need())  # compiled before it is timed
    started = time.process_time()
    with torch.no_grad():
        *_, last = sample(network, condition, x, settings, levels=levels, generator=generator)
    seconds = time.process_time() - started
    return last.x, seconds, sum(branches_of(levels, settings))


def picture() -> torch.Tensor:
    """A smooth picture with an edge, which has colors as a photo has them."""
    y, x = torch.meshgrid(*[torch.linspace(0, 1, SIZE)] * 2, indexing="ij")
    disc = ((x - 0.5) ** 2 + (y - 0.5) ** 2 < 0.09).float()
    colors = torch.stack((0.3 + 0.4 * x, 0.6 - 0.3 * y, 0.5 - 0.2 * x * y), -1)
    return (colors * (1 - disc[..., None]) + torch.tensor((0.6, 0.4, 0.25)) * disc[..., None])[None]


def measure(
    model: Denoiser, names: list[str], prompt: str, precision: str, file: Path
) -> Iterator[dict[str, Any]]:
    """A row for each case; the full one is computed first, and kept beside the file."""
    kept = file.with_suffix(f".{model.name}.{precision}.pt")
    for name in names:
        settings = replace(CASES[name], precision=precision)  # pyright: ignore[reportArgumentType]
        x, seconds, evaluations = sampled(model, settings, picture(), prompt)
        if name == next(iter(CASES)):
            torch.save(x, kept)
        full = torch.load(kept)
        yield {
            "model": model.name,
            "precision": precision,
            "case": name,
            "evaluations": evaluations,
            "seconds": seconds,
            "change": relative_error(x, full),
        }


def estimated(model: Pix2Pix, precision: str) -> tuple[Cost, float]:
    """(the cost that is stated before, the seconds that a batch of three views then takes)."""
    shades = torch.tensor((1.0, 0.9, 0.8))[:, None, None, None]
    views = picture() * shades
    settings = replace(find_preset("quick").settings.sampler, steps=10, precision=precision)  # pyright: ignore[reportArgumentType]
    encoder = TextEncoder(text_encoder().eval().requires_grad_(False), tokenizer())
    model = replace(model, text_encoders=(encoder,))
    editor, batch = DiffusionEditor(model), EditBatch(views, views, PROMPT)
    cost = editor.measure(batch, settings)
    brighter = replace(batch, images=views * 1.1, originals=views * 1.1)  # not encoded before
    started = time.monotonic()
    list(editor.edit(brighter, settings, torch.Generator().manual_seed(0)))
    return cost, time.monotonic() - started


def main(
    output: Annotated[Path, typer.Option("-o", help="File of results, JSON lines.")] = Path(
        "out/editor_cost.jsonl"
    ),
    model: str = "pix2pix",
    runtime: str = "openvino",
    precision: str = "bfloat16",
    case: Annotated[list[str] | None, typer.Option(help="Cases; all without.")] = None,
    estimate: Annotated[bool, typer.Option(help="Compare an estimate with the time.")] = False,
) -> None:
    """Measure cases, append them to the file and print them."""
    network = load_small() if model == "small" else full_size(runtime)
    if estimate:
        assert isinstance(network, Pix2Pix)
        cost, seconds = estimated(network, precision)
        ratio = cost.seconds(3) / seconds
        verdict = "right" if abs(ratio - 1) <= ALLOWED else "WRONG"
        return print_result(
            f"estimate of three views: {cost.seconds(3):.1f} s, they took {seconds:.1f} s "
            f"({verdict}: {ratio - 1:+.0%}, {ALLOWED:.0%} is allowed); "
            f"{cost.evaluation_s:.2f} s an evaluation, encoding {cost.encode_s:.2f} s, decoding "
            f"{cost.decode_s:.2f} s, {cost.peak_bytes / 1e9:.1f} GB"
        )
    output.parent.mkdir(parents=True, exist_ok=True)
    for row in measure(network, case or list(CASES), PROMPT, precision, output):
        row["runtime"] = runtime
        with output.open("a") as file:
            file.write(json.dumps(row) + "\n")
        print_message(f"{row['case']}: {row['seconds']:.1f} s")
        print_result(
            f"| {row['case']} | {row['evaluations']} | {row['seconds']:.1f} | {row['change']:.1%} |"
        )


if __name__ == "__main__":
    run(main)
