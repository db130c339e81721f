"""Training of `small`: a generator that yields as it goes, reproducible from its settings.

`b` lessons a step.
"""

from __future__ import annotations

import copy
import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from gsedit.editors.small.denoiser import sigma_at
from gsedit.editors.small.network import PRIOR_STD, EncodedImage, SmallNetwork, to_cells
from gsedit.editors.small.text import tokenise
from gsedit.errors import GseditError, UsageError
from train_small.batches import SMALLEST, Lessons, lessons
from train_small.sources import Stored

WEIGHT_MOST = 10.0
"""Of a lesson: where there is hardly any noise, nearly all of the answer is given."""
BETAS = (0.9, 0.99)
CLIP = 1.0
"""Of the gradient's norm."""
PARTS = ("network", "average", "optimiser")
LOWEST, HIGHEST = 0.003, 0.993
"""Of the times, as shares of the schedule."""
HIGH, OFTEN = 0.8, 0.6
"""A share of the lessons lies above HIGH, where the noise hides what the edit is."""
START = 0.9
"""Above this noise an edit may start from a noised render of what is unedited; see `noised`."""


@dataclass(frozen=True)
class Phase:
    """Some steps at one size."""

    size: int
    """Pixels."""
    steps: int
    batch: int
    """Pictures a step."""
    edits: int = 2
    """Of each picture: it is looked at once."""
    rate: float = 1.0
    """Share of the settings' rate."""
    pictures: int | None = None
    """Only the first so many of those that there are."""
    strange: float = 0.0
    """Share of sentences in a stranger's words (see phrases.garbled)."""
    borrowed: float = 0.0
    """Share of those words that other sentences have; the others are nonsense."""


@dataclass(frozen=True)
class TrainSettings:
    """How it is trained."""

    rate: float = 1e-3
    """Of AdamW at its highest."""
    warm_up: int = 200
    """Steps of a round in which the rate rises; in the others it falls as half a cosine."""
    decay: float = 0.01
    keep: float = 0.999
    """Of the moving average of the weights, which is what is used in the end."""
    drop: float = 0.05
    """Share of pictures that are not shown with their text, and the same without; and of what is
    shown, the share without text (InstructPix2Pix drops 5 % of each)."""
    sight: float = 0.1
    """Weight of what the eye missees: about that of the edit's error at the start."""
    precision: torch.dtype = torch.bfloat16
    """Of the products; float32 where the processor has no bfloat16."""

    def __post_init__(self) -> None:
        if not 0 <= self.drop <= 1 / 3:
            raise UsageError(f"drop {self.drop} is not in [0, 1/3]")


class Trained(NamedTuple):
    """After a step."""

    step: int
    steps: int
    loss: float
    seconds: float


class Student:
    """A network on its way: all that a training needs to go on where it stopped."""

    def __init__(
        self,
        network: SmallNetwork,
        generator: torch.Generator,
        settings: TrainSettings | None = None,
    ) -> None:
        self.network, self.generator = network, generator
        self.settings = settings or TrainSettings()
        self.average = copy.deepcopy(network).eval().requires_grad_(False)
        self.optimiser = torch.optim.AdamW(
            network.parameters(), lr=0.0, betas=BETAS, weight_decay=self.settings.decay, fused=True
        )
        self.step = 0

    @property
    def kind(self) -> str:
        """What must not change on the way."""
        return f"{self.network.architecture}, {self.settings}"

    def state(self) -> dict[str, Any]:
        """To be saved, and given to `restore` of a student that was made alike."""
        parts = {name: getattr(self, name).state_dict() for name in PARTS}
        told = {"step": self.step, "generator": self.generator.get_state(), "kind": self.kind}
        return parts | told

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from there, exactly. Raises UsageError if that was another kind of training."""
        if state["kind"] != self.kind:
            raise UsageError(
                f"what was kept is of another training ({state['kind']}, this is {self.kind}): "
                "delete it, or take another folder"
            )
        for name in PARTS:
            getattr(self, name).load_state_dict(state[name])
        self.generator.set_state(state["generator"])
        self.step = state["step"]


def train_steps(student: Student, stored: Stored, *rounds: Sequence[Phase]) -> Iterator[Trained]:
    """Train to the end of the last round, from wherever the student is; yields every step.

    The rate rises and falls once a round (Loshchilov and Hutter 2017, warm restarts). Raises
    GseditError if the loss is no longer finite.
    """
    s, began = student.settings, time.monotonic()
    plan = [step for phases in rounds for step in _paced(phases, s.warm_up)]
    left = plan[student.step :]
    halves = stored.halved() if any(_halves_do(phase, stored) for phase, _ in left) else stored
    for phase, pace in left:
        for group in student.optimiser.param_groups:
            group["lr"] = s.rate * pace
        pictures = halves if _halves_do(phase, stored) else stored
        batch = lessons(
            pictures.first(phase.pictures),
            phase.size,
            phase.batch,
            phase.edits,
            student.generator,
            strange=phase.strange,
            borrowed=phase.borrowed,
        )
        loss = loss_of(student.network, batch, student.generator, s)
        student.optimiser.zero_grad()
        loss.backward()
        norm = torch.nn.utils.clip_grad_norm_(student.network.parameters(), CLIP)
        found = float(loss.detach())
        if not math.isfinite(found + float(norm)):  # before anything is changed by it
            raise GseditError(
                f"the loss is {found} and its gradient {float(norm)} at step {student.step + 1}: "
                f"lower the rate ({s.rate:g})"
            )
        student.optimiser.step()
        student.step += 1
        _follow(student, min(s.keep, (1 + student.step) / (10 + student.step)))
        yield Trained(student.step, len(plan), found, time.monotonic() - began)


def _halves_do(phase: Phase, stored: Stored) -> bool:
    """Whether pictures of half the size are large enough, for the mean of the parts shown."""
    return phase.size <= (SMALLEST + 1) / 2 * stored.image.shape[1] / 2


def loss_of(
    network: SmallNetwork, batch: Lessons, generator: torch.Generator, s: TrainSettings
) -> Float[Tensor, ""]:
    """Weighted squared error of x0 at random noise levels, with what is dropped dropped, and how
    badly the eye saw."""
    count, edits = len(batch.pictures), len(batch.prompts) // len(batch.pictures)
    looked, answers = to_cells(batch.pictures), to_cells(batch.answers)
    pictures = looked.repeat_interleave(edits, 0)
    sigma, x = noised(answers, pictures, generator)
    blind = torch.rand(count, generator=generator) < 2 * s.drop
    no_picture = blind.repeat_interleave(edits)
    lost = torch.rand(len(answers), generator=generator)
    no_text = lost < torch.where(no_picture, 0.5, s.drop)
    prompts = ["" if drop else prompt for drop, prompt in zip(no_text.tolist(), batch.prompts)]
    fast = s.precision != torch.float32
    with torch.autocast("cpu", dtype=s.precision, enabled=fast):
        once = network.encode_image(looked, (~blind).float())
        seen = EncodedImage(*(part.repeat_interleave(edits, 0) for part in once))
        told = network.text_encoder(tokenise(prompts))
        found = network(x, sigma, pictures, (~no_picture).float(), seen, told).float()
    weight = ((PRIOR_STD**2 + sigma**2) / sigma**2).clamp_max(WEIGHT_MOST)
    error = weight * (found - answers).square().mean((1, 2, 3))
    return error.mean() + s.sight * (~blind * _misseen(once, batch)).mean()


def _misseen(seen: EncodedImage, batch: Lessons) -> Float[Tensor, " n"]:
    """How badly the eye saw: cross entropy of the subject, squared errors of the geometry."""
    subject, *rest = seen.geometry.float().unbind(1)
    is_subject, *truly = batch.geometry.unbind(-1)
    missed = F.binary_cross_entropy_with_logits(subject, is_subject, reduction="none")
    off = torch.stack(rest).sub(torch.stack(truly)).square().sum(0)
    return (missed + off).mean((1, 2))


def noised(
    answers: Float[Tensor, "b c y x"],
    pictures: Float[Tensor, "b c y x"],
    generator: torch.Generator,
) -> tuple[Float[Tensor, " b"], Float[Tensor, "b c y x"]]:
    """(sigma, x_t) at times of the schedule, those where only the words tell more often.

    Sampling starts from a noised render of the *unedited* scene. Whoever has only ever seen noised
    answers takes what shimmers through for the answer, and edits too little: so at the highest
    levels half of the lessons start as sampling does.
    """
    u, often = torch.rand(2, len(answers), generator=generator)
    lowest = torch.where(often < OFTEN, HIGH, LOWEST)
    t = lowest + (HIGHEST - lowest) * u
    sigma = sigma_at(t)
    unedited = (t > START) & (torch.rand(len(answers), generator=generator) < 0.5)
    clean = torch.where(unedited[:, None, None, None], pictures, answers)
    a = (1 + sigma**2).rsqrt()[:, None, None, None]
    noise = torch.randn(answers.shape, generator=generator)
    return sigma, a * (clean + sigma[:, None, None, None] * noise)


def _paced(phases: Sequence[Phase], warm_up: int) -> list[tuple[Phase, float]]:
    """A round's steps, each with its share of the settings' rate."""
    steps = [phase for phase in phases for _ in range(phase.steps)]
    return [(phase, phase.rate * _pace(i, len(steps), warm_up)) for i, phase in enumerate(steps)]


def _pace(step: int, total: int, warm_up: int) -> float:
    """Up in a straight line, down as half a cosine."""
    if step < warm_up:
        return (step + 1) / warm_up
    return 0.5 + 0.5 * math.cos(math.pi * (step - warm_up) / max(total - warm_up, 1))


@torch.no_grad()
def _follow(student: Student, keep: float) -> None:
    for slow, fast in zip(student.average.parameters(), student.network.parameters()):
        slow.lerp_(fast, 1 - keep)
