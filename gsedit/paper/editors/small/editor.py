"""`small` as a denoiser and as an editor.

`v` views of `h w` pixels, `y x` cells of 4x4 pixels, `c` channels a cell, `d` channels of a look's
vector.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from copy import deepcopy
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from gsedit.errors import InputError, UsageError
from gsedit.paper.diffusion.guidance import Branches, Need
from gsedit.paper.diffusion.predictions import Prediction
from gsedit.paper.diffusion.schedules import Schedule
from gsedit.paper.diffusion.settings import SamplerDefaults, SamplerSettings
from gsedit.paper.editors.ranked import Fit, shared_out
from gsedit.paper.editors.sampling import DiffusionEditor
from gsedit.paper.editors.small import REINSTALL, WEIGHTS
from gsedit.paper.editors.small.network import (
    CELL_PIXELS,
    Architecture,
    EncodedImage,
    PreparedImage,
    SmallNetwork,
    from_cells,
    to_cells,
)
from gsedit.paper.protocol import Capabilities, EditBatch, EditProgress
from gsedit.run.ranks import ALONE, Ranks
from gsedit.views.padding import PadMode, pad_to_multiple
from gsedit.words.asked import looks_asked
from gsedit.words.looks import LOOKS

LOG_ODDS = 6.0
"""Log-odds of the subject where it is told, about those of the network where it is sure."""
MID_SIGMA = 4.0  # in the middle of the schedule
STEPS = 1000
DEFAULTS = SamplerDefaults(
    steps=10, spacing="middle", guidance_text=1.4, guidance_image=1.0, temperature=0.2, t_end=4.0
)
"""Each of its instructions has one correct result, so little of the starting noise is used. Ten
steps in the middles of their parts equal the twenty of the leading spacing to 51 dB
(docs/measurements/sampler.md).
Consensus acts for half of the steps: later ones lose strength (docs/measurements/sampler.md),
and the coarse colors that views still differ in are brought to agreement after sampling."""
BEST_SIZE = 192
"""Pixels, the largest of its training. Of larger pictures it leaves parts unedited, and it stains
others (docs/measurements/editing.md)."""


def schedule() -> Schedule:
    """sigma = MID_SIGMA tan(pi t / 2): a cosine schedule shifted towards the noise.

    Neighboring pixels and cells are alike: their mean is visible through noise that hides each of
    them, the more so the larger the image (Hoogeboom et al. 2023, section 2.1). The default steps
    start at sigma 37, where a render's mean color is still visible; the training accounts for
    that (research.train_small.loss.noisy_targets at commit d3b2212).
    """
    t = torch.arange(1, STEPS + 1, dtype=torch.float64) / (STEPS + 1)
    return Schedule(1 / (1 + sigma_at(t) ** 2))


def sigma_at(t: Float[Tensor, " t"]) -> Float[Tensor, " t"]:
    """sigma at times in (0, 1)."""
    return MID_SIGMA * (t * torch.pi / 2).tan()


def with_subject(encoded: EncodedImage, subject: Float[Tensor, "v h w"]) -> EncodedImage:
    """Features of these views with the subject replaced by a given probability."""
    log_odds = torch.logit(subject.clamp(0, 1), eps=1e-6).clamp(-LOG_ODDS, LOG_ODDS)
    told = log_odds[:, None].to(encoded.pixels)
    return encoded._replace(pixels=torch.cat((told, encoded.pixels[:, 1:]), 1))


class Condition(NamedTuple):
    """Condition of the network at every step."""

    shown: PreparedImage
    """The unedited images, encoded."""
    dropped: PreparedImage
    """One view whose image is dropped."""
    text: Float[Tensor, "1 d"]
    """Vector of the look that is asked for."""
    null_text: Float[Tensor, "1 d"]
    """The vector of no look."""


@dataclass(frozen=True, eq=False)
class Small:
    """A Denoiser with SmallNetwork. Its latents are the pixels, rearranged: an isometry."""

    network: SmallNetwork
    schedule: Schedule = field(default_factory=schedule)
    micro_batch: int = 4
    """Views in one pass of the network; it changes no result."""
    subject: Float[Tensor, "v h w"] | None = None
    """The probability of the subject in the unedited images. None: as the network sees it."""
    predicts: Prediction = "v"
    name: str = "small"
    cell: int = CELL_PIXELS
    padding: PadMode = "mirror"

    @property
    def multiple(self) -> int:
        """Pixels: sides that the network can halve at every level without a remainder."""
        return CELL_PIXELS * self.network.architecture.multiple

    @property
    def capabilities(self) -> Capabilities:
        """Its own defaults and size, and that it runs a network."""
        return Capabilities(
            defaults=DEFAULTS,
            with_micro_batch=lambda views: replace(self, micro_batch=views),
            best_size=BEST_SIZE,
        )

    def check(self, prompt: str) -> None:
        """Raise UsageError for an instruction that asks for anything but its looks."""
        looks_asked(prompt)

    def encode(self, images: Float[Tensor, "v h w 3"]) -> Float[Tensor, "v c y x"]:
        """Latents in [-1, 1] of images in [0, 1]: a cell's 4x4 pixels become channels."""
        return to_cells(images.float())

    def encode_edited(
        self, images: Float[Tensor, "v h w 3"], originals: Float[Tensor, "v h w 3"], prompt: str
    ) -> Float[Tensor, "v c y x"]:
        """As `encode`: an edit is encoded like any image."""
        return self.encode(images)

    def decode(self, latents: Float[Tensor, "v c y x"]) -> Float[Tensor, "v h w 3"]:
        """The exact inverse of encode."""
        return from_cells(latents)

    @torch.no_grad()
    def condition(
        self, originals: Float[Tensor, "v h w 3"], prompt: str, generator: torch.Generator
    ) -> Condition:
        """Encode the unedited images, once for all steps. Raises UsageError for two looks, which
        `SmallEditor` draws one after the other."""
        look, *more = looks_asked(prompt)
        if more:
            raise UsageError(f"{prompt!r} asks for two looks, and one pass draws one: say one")
        rows = torch.tensor([list(LOOKS).index(look.name), len(LOOKS)])
        text, null_text = self.network.looks(rows).split(1)
        latents = self.encode(originals)
        encoded = _cat([self._encode(part, 1.0) for part in latents.split(self.micro_batch)])
        if self.subject is not None:
            encoded = with_subject(encoded, self.subject[: len(latents)])
        one, ones = latents[:1], latents.new_ones(len(latents))
        shown = self.network.prepare(latents, ones, encoded)
        dropped = self.network.prepare(one, 0 * ones[:1], self._encode(one, 0.0))
        return Condition(shown, dropped, text, null_text)

    @torch.no_grad()
    def branches(
        self, x: Float[Tensor, "v c y x"], t: float, condition: Condition, need: Need
    ) -> Branches:
        """v under (text, image), (null, image) and (null, null), as far as in need."""
        parts = [
            slice(start, start + self.micro_batch) for start in range(0, len(x), self.micro_batch)
        ]
        chunks = [self._predictions(x, rows, t, condition, need) for rows in parts]
        predicted = iter(torch.cat(branch) for branch in zip(*chunks))
        return Branches(*(next(predicted) if wanted else None for wanted in need))

    def _predictions(
        self,
        x: Float[Tensor, "v c y x"],
        rows: slice,
        t: float,
        condition: Condition,
        need: Need,
    ) -> tuple[Float[Tensor, "n c y x"], ...]:
        """v of these views under each condition in need, in one pass of the network."""
        level, network, x_t = self.schedule.level(t), self.network, x[rows].float()
        if torch.is_autocast_enabled("cpu"):
            network = _in_bfloat16(network)
        sigma = x_t.new_full((len(x_t),), level.sigma)

        def predict(image: PreparedImage, texts: Sequence[Tensor]) -> tuple[Tensor, ...]:
            text = torch.cat([each.expand(len(x_t), -1) for each in texts])
            clean = network.denoise(x_t, sigma, image, text).chunk(len(texts))
            return tuple((level.a * x_t - x0) / level.b for x0 in clean)

        texts = [t for t, wanted in zip((condition.text, condition.null_text), need) if wanted]
        predicted: tuple[Tensor, ...] = ()
        if texts:
            predicted = predict(PreparedImage(*(part[rows] for part in condition.shown)), texts)
        if need.none:
            dropped = (part.expand(len(x_t), *part.shape[1:]) for part in condition.dropped)
            predicted += predict(PreparedImage(*dropped), [condition.null_text])
        return predicted

    def _encode(self, latents: Float[Tensor, "n c y x"], mask: float) -> EncodedImage:
        return self.network.encode_image(latents, latents.new_full((len(latents),), mask))


@lru_cache(maxsize=2)
def _in_bfloat16(network: SmallNetwork) -> SmallNetwork:
    """A copy whose convolutions and linear layers hold their weights in bfloat16, laid out as the
    processor multiplies them: autocast would convert them again at every step."""
    rounded = deepcopy(network)
    for layer in rounded.modules():
        if isinstance(layer, nn.Conv2d | nn.Linear):
            layer.to(torch.bfloat16)
        if isinstance(layer, nn.Conv2d):
            layer.weight.data = layer.weight.contiguous(memory_format=torch.channels_last)
    return rounded


def cell_colors(change: Float[Tensor, "v c y x"]) -> Float[Tensor, "v c y x"]:
    """The change of each cell's mean color, interpolated from cell to cell: what is finer than a
    cell stays each view's own, and no seam shows between a cell that changes and the next."""
    means, scale = change.unflatten(1, (3, CELL_PIXELS**2)).mean(2), float(CELL_PIXELS)
    pixels = F.interpolate(means, scale_factor=scale, mode="bilinear", align_corners=False)
    return F.pixel_unshuffle(pixels, CELL_PIXELS)


def _cat(parts: Sequence[EncodedImage]) -> EncodedImage:
    """All views of all parts."""
    return EncodedImage(*(torch.cat(tensors) for tensors in zip(*parts)))


@lru_cache(maxsize=1)
def load_small(path: Path = WEIGHTS) -> Small:
    """The denoiser with the weights that come with gsedit, kept in memory.

    Raises InputError where the file is missing or damaged.
    """
    from safetensors import safe_open

    try:
        with safe_open(path, framework="pt") as file:
            sizes = json.loads((file.metadata() or {})["architecture"])
            state = {name: file.get_tensor(name).float() for name in file.keys()}  # noqa: SIM118
        lists = {name: tuple(size) for name, size in sizes.items() if isinstance(size, list)}
        network = SmallNetwork(Architecture(**sizes | lists))
        network.load_state_dict(state)
    except Exception as error:  # safetensors, json and torch raise their own, without a common base
        reason = next(iter(str(error).strip().splitlines()), type(error).__name__)
        raise InputError(
            f"{path} does not hold the weights of the small editor ({reason}): {REINSTALL}"
        ) from error
    return Small(network.eval().requires_grad_(False))


@dataclass(frozen=True, eq=False)
class SmallEditor:
    """An Editor: a pass of sampling for each look that an instruction asks for.

    Of two looks the subject's is applied first: its result is the original of the scene's pass. The
    network was trained on both at once too, and mostly applies only one.
    """

    small: Small
    ranks: Ranks = ALONE
    """Processes among which its views are shared out."""
    known: dict[Any, Fit] = field(default_factory=dict, repr=False)
    """Measurements of the network, as DiffusionEditor keeps them."""
    name: str = "small"
    cell: int = CELL_PIXELS

    @property
    def capabilities(self) -> Capabilities:
        return replace(
            self.small.capabilities,
            denoiser=self.small,
            with_ranks=lambda ranks: replace(self, ranks=ranks),
        )

    def check(self, prompt: str) -> None:
        """Raise UsageError if it cannot follow the instruction."""
        self.small.check(prompt)

    def edit(
        self, batch: EditBatch, settings: SamplerSettings, generator: torch.Generator
    ) -> Iterator[EditProgress]:
        """Every pass is one of DiffusionEditor, with the same correspondences.

        Anchored views come with the result of the last pass, so only the last is tied to them; the
        earlier ones edit them again, together with the others, as originals for the last.
        """
        looks = looks_asked(batch.prompt)
        originals, images, spent = batch.originals, batch.images, 0
        for k, look in enumerate(looks):
            last = look is looks[-1]
            anchored = batch.anchored if last else None
            if anchored is not None and k:
                images = torch.where(anchored[:, None, None, None], batch.images, images)
            asked = replace(
                batch, prompt=look.wording, images=images, originals=originals, anchored=anchored
            )
            evaluations = 0
            for progress in self._sampler(asked).edit(asked, settings, generator):
                evaluations = progress.evaluations
                step, steps = progress.step + k * progress.steps, len(looks) * progress.steps
                edited = progress.images
                if edited is not None and not last:
                    images = originals = edited
                step = step if last else min(step, steps - 1)
                yield EditProgress(step, steps, edited if last else None, spent + evaluations)
            spent += evaluations

    def _sampler(self, batch: EditBatch) -> DiffusionEditor:
        """The sampler of a batch, whose network is told where the subject is."""
        small, subject = self.small, batch.subject
        if subject is not None:
            free = subject if batch.anchored is None else subject[~batch.anchored]
            told = pad_to_multiple(free, small.multiple, small.padding)
            small = replace(small, subject=told[self.ranks.share(len(told))])
        return DiffusionEditor(shared_out(small, self.ranks), self.known, cell_colors)
