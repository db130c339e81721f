"""`small` as a denoiser, and its file of weights.

`v` views of `h w` pixels, `y x` cells of 4x4 pixels, `c` channels a cell, `d` channels of an
instruction's vector.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import asdict, dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from gsedit.datasets.padding import PadMode
from gsedit.diffusion.guidance import Branches, Need
from gsedit.diffusion.predictions import Prediction
from gsedit.diffusion.schedules import Schedule
from gsedit.diffusion.settings import SamplerDefaults
from gsedit.editor_protocol import Capabilities
from gsedit.editors.small.network import (
    CELL_PIXELS,
    CHANNELS,
    Architecture,
    EncodedImage,
    PreparedImage,
    SmallNetwork,
    from_cells,
    to_cells,
)
from gsedit.editors.small.shipped import REINSTALL, WEIGHTS
from gsedit.editors.small.text import MAX_WORDS, tokenise, words_of
from gsedit.errors import InputError, UsageError
from gsedit.storage.atomic import atomic_path
from gsedit.words.asked import looks_asked
from gsedit.words.looks import LOOKS
from gsedit.words.understanding import not_understood

LOG_ODDS = 6.0
"""Log-odds of the subject where it is told, about those of the network where it is sure."""


def with_subject(encoded: EncodedImage, subject: Float[Tensor, "v h w"]) -> EncodedImage:
    """Features of these views with the subject replaced by a given probability."""
    log_odds = torch.logit(subject.clamp(0, 1), eps=1e-6).clamp(-LOG_ODDS, LOG_ODDS)
    told = log_odds[:, None].to(encoded.pixels)
    return encoded._replace(pixels=torch.cat((told, encoded.pixels[:, 1:]), 1))


MODEL_HINT = (
    "leave --model out for the weights that come with gsedit; "
    "InstructPix2Pix weights need --editor pix2pix"
)
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


class Condition(NamedTuple):
    """Condition of the network at every step."""

    shown: PreparedImage
    """The unedited images, encoded."""
    dropped: PreparedImage
    """One view whose image is dropped."""
    text: Float[Tensor, "1 d"]
    null_text: Float[Tensor, "1 d"]
    """Features of the empty instruction."""


@dataclass(frozen=True, eq=False)
class Small:
    """A Denoiser with SmallNetwork. Its latents are the pixels, rearranged: an isometry."""

    network: SmallNetwork
    schedule: Schedule = field(default_factory=schedule)
    micro_batch: int = 4
    """Views in one pass of the network; it changes no result."""
    looks: tuple[str, ...] = ()
    """Names of the looks that it was trained on."""
    words: frozenset[str] = frozenset()
    """Words that name one of these looks."""
    guess: bool = False
    """Whether a sentence that asks for no known look is edited with the nearest one."""
    subject: Float[Tensor, "v h w"] | None = None
    """The probability of the subject in the unedited images. None: as the network sees it."""
    predicts: Prediction = "v"
    name: str = "small"
    cell: int = CELL_PIXELS
    channels: int = CHANNELS
    padding: PadMode = "mirror"

    @property
    def multiple(self) -> int:
        """Pixels: sides that the network can halve at every level without a remainder."""
        return CELL_PIXELS * self.network.architecture.multiple

    @property
    def capabilities(self) -> Capabilities:
        """Its own defaults and size, a remark on instructions that it can only guess at, what it
        understands, and whether that is of the whole scene."""
        return Capabilities(
            defaults=DEFAULTS,
            with_micro_batch=lambda views: replace(self, micro_batch=views),
            coarse=cell_colors,
            advice=self.advice,
            is_whole=self.is_whole if self.knows_all_looks else None,
            with_subject=lambda subject: replace(self, subject=subject),
            best_size=BEST_SIZE,
            understand=looks_asked if self.knows_all_looks else None,
        )

    @property
    def knows_all_looks(self) -> bool:
        """Whether it was trained on every look that gsedit.words knows. If not, the network reads
        the instruction itself, as it is."""
        return LOOKS.keys() <= set(self.looks)

    def check(self, prompt: str) -> None:
        """Raise UsageError for an instruction without words, and for one that asks for no look it
        knows, unless it may guess. A network that reads the words itself reads MAX_WORDS."""
        count = len(words_of(prompt))
        if not count:
            raise UsageError('the instruction is empty: say what to change, e.g. "make it snow"')
        if self.knows_all_looks:
            understood = looks_asked(prompt)
            if not (understood.known or (self.guess and understood.looks)):
                raise UsageError(not_understood(self.name, prompt, understood))
        elif count > MAX_WORDS:
            raise UsageError(
                f"the instruction has {count} words and this editor reads {MAX_WORDS}: "
                "say it in fewer words"
            )

    def advice(self, prompt: str) -> str:
        """A warning that the result is a guess, for an instruction that asks for none of the looks
        that it was trained on; else nothing."""
        if self.knows_all_looks:
            understood = looks_asked(prompt)
            return "" if understood.known else f"not understood: {understood} is a guess"
        if not self.words or self.words.intersection(words_of(prompt)):
            return ""
        return (
            f"no word of {prompt.strip()!r} names a look that {self.name} was trained on, "
            f"so the result is a guess; it was trained on {', '.join(self.looks)}. "
            "For any sentence: --editor pix2pix --model FOLDER (InstructPix2Pix weights)"
        )

    def wordings(self, prompt: str) -> tuple[str, ...]:
        """Wordings that the network is given: for each look that the instruction means, the one
        that it knows best; the instruction itself where the network reads it."""
        return looks_asked(prompt).wordings if self.knows_all_looks else (prompt,)

    def is_whole(self, prompt: str) -> bool:
        """Whether a look that the instruction means is one of the whole scene."""
        return looks_asked(prompt).scope == "scene"

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
        """Encode the unedited images and the instruction, once for all steps."""
        asked = ", ".join(self.wordings(prompt))
        text, null_text = self.network.text_encoder(tokenise([asked, ""])).split(1)
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


def save_small(small: Small, path: Path, metadata: Mapping[str, str] | None = None) -> None:
    """Write the weights as float16, with the metadata that `load_small` needs.

    `metadata` adds how they were made (seed, steps, ...). Raises OSError where the file cannot be
    written.
    """
    from safetensors.torch import save

    metadata = {
        "architecture": json.dumps(asdict(small.network.architecture)),
        "looks": json.dumps(small.looks),
        "words": json.dumps(sorted(small.words)),
        **(metadata or {}),
    }
    state = small.network.state_dict()
    halves = {name: value.half().contiguous() for name, value in state.items()}
    with atomic_path(path, overwrite=True) as temporary:
        temporary.write_bytes(save(halves, metadata))


def load_small(path: Path | None = None) -> Small:
    """The denoiser with the weights of this file; None: those that come with gsedit.

    Raises InputError for a file that is missing, damaged or of another network.
    """
    path, hint = (WEIGHTS, REINSTALL) if path is None else (path, MODEL_HINT)
    if path.is_dir():
        raise InputError(f"{path} is a folder and no file of weights of the small editor: {hint}")
    if not path.exists():
        raise InputError(f"{path}: no such file; {hint}")
    try:
        return _load(path.resolve(), path.stat().st_mtime_ns)
    except Exception as error:  # safetensors, json and torch raise their own, without a common base
        reason = next(iter(str(error).strip().splitlines()), type(error).__name__)
        raise InputError(
            f"{path} does not hold the weights of the small editor ({reason}): {hint}"
        ) from error


@lru_cache(maxsize=2)
def _load(path: Path, modified_ns: int) -> Small:
    """Kept in memory until the file changes; its time of modification is part of the cache key."""
    from safetensors import safe_open

    with safe_open(path, framework="pt") as file:
        metadata = file.metadata() or {}
        state = {name: file.get_tensor(name).float() for name in file.keys()}  # noqa: SIM118
    sizes = json.loads(metadata["architecture"])
    lists = {name: tuple(size) for name, size in sizes.items() if isinstance(size, list)}
    network = SmallNetwork(Architecture(**sizes | lists))
    network.load_state_dict(state)
    return Small(
        network.eval().requires_grad_(False),
        looks=tuple(json.loads(metadata["looks"])),
        words=frozenset(json.loads(metadata["words"])),
    )
