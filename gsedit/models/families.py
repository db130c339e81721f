"""Table of the model families that can be edited with, by the pipeline class of diffusers.

A folder's model_index.json names its pipeline class and the class of every component. What is not
in this table is refused by name, before any weights are fetched or read. Loads no torch.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Role = Literal["network", "encoder", "words", "scheduler"]
"""network: of diffusers. encoder: of transformers. words: a tokenizer or processor, no weights."""


@dataclass(frozen=True)
class Component:
    """One folder of a model that is used."""

    name: str
    role: Role
    classes: tuple[str, ...]
    """Classes that work; of `words`, none: any."""


@dataclass(frozen=True)
class Family:
    """Models of one architecture, which one module loads."""

    title: str
    pipelines: tuple[str, ...]
    """Values of `_class_name` in model_index.json."""
    module: str
    """The module here whose `load(parts, micro_batch=...)` makes the Model."""
    components: tuple[Component, ...]
    """Everything that is fetched; the first is the denoising network."""
    example: str
    """A model of the family on the hub, with @revision where it is not in the main one."""
    licence: str
    """Licence of that model's weights."""
    gigabytes: float
    """Size of that model's files that are used, about, in GB."""

    @property
    def network(self) -> Component:
        """The network that denoises."""
        return self.components[0]


VARIANCE_PRESERVING = (
    "DDIMScheduler", "DDPMScheduler", "PNDMScheduler", "LMSDiscreteScheduler",
    "EulerDiscreteScheduler", "EulerAncestralDiscreteScheduler", "HeunDiscreteScheduler",
    "DPMSolverMultistepScheduler", "DPMSolverSinglestepScheduler", "DEISMultistepScheduler",
    "KDPM2DiscreteScheduler", "KDPM2AncestralDiscreteScheduler", "UniPCMultistepScheduler",
    "LCMScheduler",
)  # fmt: skip
"""Schedulers of Stable Diffusion's noise: they differ in how they step, which is `solver` here,
not in how much noise there is at a training step. LCMScheduler makes a consistency model."""
FLOW = ("FlowMatchEulerDiscreteScheduler",)


def _network(name: str, *classes: str) -> Component:
    return Component(name, "network", classes)


def _encoder(name: str, *classes: str) -> Component:
    return Component(name, "encoder", classes)


def _words(*names: str) -> tuple[Component, ...]:
    return tuple(Component(name, "words", ()) for name in names)


def _scheduler(*classes: str) -> Component:
    return Component("scheduler", "scheduler", classes)


SD = Family(
    title="InstructPix2Pix of Stable Diffusion 1.5",
    pipelines=("StableDiffusionInstructPix2PixPipeline",),
    module="stable_diffusion",
    components=(
        _network("unet", "UNet2DConditionModel"),
        _network("vae", "AutoencoderKL"),
        _encoder("text_encoder", "CLIPTextModel"),
        *_words("tokenizer"),
        _scheduler(*VARIANCE_PRESERVING),
    ),
    example="timbrooks/instruct-pix2pix",
    licence="MIT; its base, Stable Diffusion 1.5: CreativeML OpenRAIL-M",
    gigabytes=4.3,
)
SDXL = Family(
    title="InstructPix2Pix of SDXL, CosXL-Edit",
    pipelines=("StableDiffusionXLInstructPix2PixPipeline",),
    module="stable_diffusion",
    components=(
        *SD.components[:3],
        _encoder("text_encoder_2", "CLIPTextModelWithProjection"),
        *_words("tokenizer", "tokenizer_2"),
        _scheduler(*VARIANCE_PRESERVING, "EDMEulerScheduler"),
    ),
    example="diffusers/sdxl-instructpix2pix-768",
    licence="CreativeML OpenRAIL++-M; CosXL-Edit: Stability AI, research only",
    gigabytes=12.3,
)
DREAMLITE = Family(
    title="DreamLite, DreamLite-mobile",
    pipelines=("DreamLitePipeline", "DreamLiteMobilePipeline"),
    module="dreamlite",
    components=(
        _network("unet", "DreamLiteUNetModel"),
        _network("vae", "AutoencoderTiny"),
        _encoder("text_encoder", "Qwen3VLForConditionalGeneration"),
        *_words("tokenizer", "processor"),
        _scheduler(*FLOW),
    ),
    example="carlofkl/DreamLite-mobile@diffusers",
    licence="CC BY-NC 4.0",
    gigabytes=5.1,
)
KLEIN = Family(
    title="FLUX.2-klein, FLUX.2-klein KV",
    pipelines=("Flux2KleinPipeline", "Flux2KleinKVPipeline"),
    module="klein",
    components=(
        _network("transformer", "Flux2Transformer2DModel"),
        _network("vae", "AutoencoderKLFlux2"),
        _encoder("text_encoder", "Qwen3ForCausalLM"),
        *_words("tokenizer"),
        _scheduler(*FLOW),
    ),
    example="black-forest-labs/FLUX.2-klein-4B",
    licence="4B: Apache 2.0; 9B: FLUX non-commercial",
    gigabytes=16.0,
)
FAMILIES = (SD, SDXL, DREAMLITE, KLEIN)
PIPELINES = {name: family for family in FAMILIES for name in family.pipelines}
"""Families by the class of their pipeline."""
