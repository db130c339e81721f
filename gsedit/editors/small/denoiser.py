"""`small` as a denoiser. `v` views of `h w` pixels, `y x` cells of 4x4, `d` of an instruction."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor

from gsedit.diffusion import Branches, Need, Prediction, Schedule, Suits
from gsedit.editors.small.network import (
    CELL,
    CHANNELS,
    Architecture,
    Network,
    Seen,
    from_cells,
    to_cells,
)
from gsedit.editors.small.text import WORDS, tokenise, words_of
from gsedit.errors import InputError, UsageError
from gsedit.files.atomic import atomic_path

WEIGHTS = Path(__file__).with_name("small.safetensors")
REINSTALL = "they come with gsedit: install it again, or check the file out again in a clone"
ANEW = (
    "leave --model out for the weights that come with gsedit; "
    "InstructPix2Pix weights need --editor pix2pix"
)
NOISE = 4.0  # sigma in the middle of the schedule
STEPS = 1000
SUITS = Suits(guidance_text=1.4, guidance_image=1.0, temperature=0.2)
"""Its sentences have one right answer, not a thousand: it is looked for near the middle."""


def schedule() -> Schedule:
    """sigma = NOISE tan(pi t / 2): a cosine schedule moved towards the noise.

    A cell's pixels are alike, and so are neighbouring cells: their mean shows through noise that
    hides each of them, the more so the larger the picture (Hoogeboom et al. 2023, section 2.1).
    The default 20 steps start at sigma 37, where a render still shows through by its mean colour;
    training takes care of that (see train_small.training.noised).
    """
    t = torch.arange(1, STEPS + 1, dtype=torch.float64) / (STEPS + 1)
    return Schedule(1 / (1 + sigma_at(t) ** 2))


def sigma_at(t: Float[Tensor, " t"]) -> Float[Tensor, " t"]:
    """Of times from 0 to 1, both excluded."""
    return NOISE * (t * torch.pi / 2).tan()


class Condition(NamedTuple):
    """What the network is told at every step."""

    pictures: Float[Tensor, "v c y x"]
    """Latents of the unedited pictures."""
    seen: Seen
    """What there is to see in them."""
    unseen: Seen
    """What there is to see in a picture that is not shown; of one view."""
    text: Float[Tensor, "1 d"]
    null: Float[Tensor, "1 d"]
    """The empty instruction."""


@dataclass(frozen=True, eq=False)
class Small:
    """The Denoiser over our own network. Its latent is the picture: an isometry, cell by cell."""

    network: Network
    schedule: Schedule = field(default_factory=schedule)
    micro_batch: int = 4
    """Views in one pass of the network; the result is the same."""
    suits: Suits = SUITS
    looks: tuple[str, ...] = ()
    """Names of what it was taught."""
    words: frozenset[str] = frozenset()
    """That name one of them."""
    predicts: Prediction = "v"
    name: str = "small"
    cell: int = CELL
    channels: int = CHANNELS

    @property
    def multiple(self) -> int:
        """Pixels: sides that the network can halve to the end without a rest."""
        return CELL * self.network.architecture.multiple

    def check(self, prompt: str) -> None:
        """Raise UsageError for an instruction without words, or with more than are read."""
        words = len(words_of(prompt))
        if not words:
            raise UsageError('the instruction is empty: say what to change, e.g. "make it snow"')
        if words > WORDS:
            raise UsageError(
                f"the instruction has {words} words and this editor reads {WORDS}: "
                "say it in fewer words"
            )

    def advise(self, prompt: str) -> str:
        """What whoever asks should know before it works: nothing, or that the result is a guess."""
        if not self.words or self.words.intersection(words_of(prompt)):
            return ""
        return (
            f"no word of {prompt.strip()!r} names a look that the {self.name} editor was taught, "
            f"so the result is a guess; it was taught {', '.join(self.looks)}. "
            "For any sentence: --editor pix2pix --model FOLDER (InstructPix2Pix weights)"
        )

    def encode(self, images: Float[Tensor, "v h w 3"]) -> Float[Tensor, "v c y x"]:
        """Values in [-1, 1]; a cell's 4x4 pixels become channels."""
        return to_cells(images.float())

    def encode_edited(
        self, images: Float[Tensor, "v h w 3"], originals: Float[Tensor, "v h w 3"], prompt: str
    ) -> Float[Tensor, "v c y x"]:
        """As any picture."""
        return self.encode(images)

    def decode(self, latents: Float[Tensor, "v c y x"]) -> Float[Tensor, "v h w 3"]:
        """The exact inverse of encode."""
        return from_cells(latents)

    @torch.no_grad()
    def condition(
        self, originals: Float[Tensor, "v h w 3"], prompt: str, generator: torch.Generator
    ) -> Condition:
        """Looked at and read once, whatever the number of steps."""
        text, null = self.network.text(tokenise([prompt, ""])).split(1)
        pictures = self.encode(originals)
        looks = [self._look(part, 1.0) for part in pictures.split(self.micro_batch)]
        seen = Seen(*(torch.cat(parts) for parts in zip(*looks)))
        return Condition(pictures, seen, self._look(pictures[:1], 0.0), text, null)

    @torch.no_grad()
    def branches(
        self, x: Float[Tensor, "v c y x"], t: float, condition: Condition, need: Need
    ) -> Branches:
        """One pass for (text, picture), (null, picture), (null, nothing), as far as in need."""
        parts = torch.arange(len(x)).split(self.micro_batch)
        chunks = [self._answers(x, rows, t, condition, need) for rows in parts]
        predicted = iter(torch.cat(branch) for branch in zip(*chunks))
        return Branches(*(next(predicted) if wanted else None for wanted in need))

    def _answers(
        self, x: Tensor, rows: Int[Tensor, " n"], t: float, condition: Condition, need: Need
    ) -> tuple[Tensor, ...]:
        """v of some views under each condition in need, in one pass."""
        level, n = self.schedule.level(t), len(rows)
        pictures, seen, unseen, text, null = condition
        here = Seen(*(part[rows] for part in seen))
        blind = Seen(*(part.expand(n, -1, -1, -1) for part in unseen))
        branches = [(text, 1.0, here), (null, 1.0, here), (null, 0.0, blind)]
        told, shown, sights = zip(*(each for each, wanted in zip(branches, need) if wanted))
        noised = x[rows].float().repeat(len(told), 1, 1, 1)
        x0 = self.network(
            noised,
            noised.new_full((len(noised),), level.sigma),
            pictures[rows].repeat(len(told), 1, 1, 1),
            noised.new_tensor(shown).repeat_interleave(n),
            Seen(*(torch.cat(parts) for parts in zip(*sights))),
            torch.cat([each.expand(n, -1) for each in told]),
        )
        return ((level.a * noised - x0) / level.b).chunk(len(told))

    def _look(self, pictures: Tensor, shown: float) -> Seen:
        return self.network.look(pictures, pictures.new_full((len(pictures),), shown))

    def answer(self, prompt: str, edited: Tensor, originals: Tensor) -> None:
        """Nobody knows what a network should have answered."""


def save_small(small: Small, path: Path, metadata: Mapping[str, str] | None = None) -> None:
    """Write the weights in half precision, with what is needed to make the editor again.

    `metadata` says how they came about (seed, steps, ...). Raises what writing a file raises.
    """
    from safetensors.torch import save

    told = {
        "architecture": json.dumps(asdict(small.network.architecture)),
        "looks": json.dumps(small.looks),
        "words": json.dumps(sorted(small.words)),
        **(metadata or {}),
    }
    state = small.network.state_dict()
    halves = {name: value.half().contiguous() for name, value in state.items()}
    with atomic_path(path, overwrite=True) as temporary:
        temporary.write_bytes(save(halves, told))


def load_small(path: Path | None = None) -> Small:
    """The editor of these weights; None: those that come with gsedit.

    Raises InputError for a file that is missing, broken or of another network.
    """
    path, move = (WEIGHTS, REINSTALL) if path is None else (path, ANEW)
    if path.is_dir():
        raise InputError(f"{path} is a folder and no file of weights of the small editor: {move}")
    if not path.exists():
        raise InputError(f"{path}: no such file; {move}")
    try:
        return _load(path.resolve(), path.stat().st_mtime_ns)
    except Exception as error:  # safetensors, json and torch raise their own, without a common base
        reason = next(iter(str(error).strip().splitlines()), type(error).__name__)
        raise InputError(
            f"{path} does not hold the weights of the small editor ({reason}): {move}"
        ) from error


@lru_cache(maxsize=2)
def _load(path: Path, written: int) -> Small:
    """`written` tells one file from the next of its name."""
    from safetensors import safe_open

    with safe_open(path, framework="pt") as file:
        told = file.metadata() or {}
        state = {name: file.get_tensor(name).float() for name in file.keys()}  # noqa: SIM118
    sizes = json.loads(told["architecture"])
    lists = {name: tuple(size) for name, size in sizes.items() if isinstance(size, list)}
    network = Network(Architecture(**sizes | lists))
    network.load_state_dict(state)
    return Small(
        network.eval().requires_grad_(False),
        looks=tuple(json.loads(told["looks"])),
        words=frozenset(json.loads(told["words"])),
    )
