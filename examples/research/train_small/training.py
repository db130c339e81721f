"""Training of the small network: a generator of reports, reproducible from its settings."""

from __future__ import annotations

import copy
import math
import time
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import torch

from gsedit.editors.small.network import SmallNetwork
from gsedit.errors import GseditError, UsageError
from research.train_small.batches import SMALLEST_CROP, TrainingBatch, training_batch
from research.train_small.loss import training_loss
from research.train_small.settings import Phase, TrainSettings
from research.train_small.sources import PackedSources

BETAS = (0.9, 0.99)  # of AdamW
MAX_GRADIENT_NORM = 1.0
CHECKPOINTED = ("network", "average", "optimizer")


class StepReport(NamedTuple):
    """State of the training after a step."""

    step: int
    """Number of the step over all rounds, from 1."""
    steps: int
    """Number of steps in all."""
    loss: float
    seconds: float
    """Seconds since `train_steps` began."""


class TrainingState:
    """The network, its moving average, the optimizer and the generator: what a checkpoint holds."""

    def __init__(
        self,
        network: SmallNetwork,
        generator: torch.Generator,
        settings: TrainSettings | None = None,
    ) -> None:
        self.network, self.generator = network, generator
        self.settings = s = settings or TrainSettings()
        self.average = copy.deepcopy(network).eval().requires_grad_(False)
        self.optimizer = torch.optim.AdamW(
            network.parameters(), lr=0.0, betas=BETAS, weight_decay=s.weight_decay, fused=True
        )
        self.step = 0

    @property
    def configuration(self) -> str:
        """Architecture and settings; they must be those of the checkpoint."""
        return f"{self.network.architecture}, {self.settings}"

    def state_dict(self) -> dict[str, Any]:
        """A checkpoint, for `load_state_dict` of a state with the same configuration."""
        return {
            **{name: getattr(self, name).state_dict() for name in CHECKPOINTED},
            "step": self.step,
            "generator": self.generator.get_state(),
            "configuration": self.configuration,
        }

    def load_state_dict(self, checkpoint: dict[str, Any]) -> None:
        """Continue exactly from there. Raises UsageError for another configuration."""
        if checkpoint["configuration"] != self.configuration:
            raise UsageError(
                f"the checkpoint is of another training ({checkpoint['configuration']}, this is "
                f"{self.configuration}): delete it, or take another folder"
            )
        for name in CHECKPOINTED:
            getattr(self, name).load_state_dict(checkpoint[name])
        self.generator.set_state(checkpoint["generator"])
        self.step = checkpoint["step"]


def train_steps(
    state: TrainingState, pictures: PackedSources, *rounds: Sequence[Phase]
) -> Iterator[StepReport]:
    """Train from wherever the state is to the end of the last round; yields after every step.

    The learning rate rises and falls once a round (Loshchilov and Hutter 2017, warm restarts).
    Raises GseditError if the loss or its gradient is not finite.
    """
    began = time.monotonic()
    plan = [step for phases in rounds for step in _round_steps(phases, state.settings.warm_up)]
    remaining = plan[state.step :]
    halved = pictures.halved() if any(_use_halved(p, pictures) for p, _ in remaining) else pictures
    for phase, factor in remaining:
        batch = _batch(phase, halved if _use_halved(phase, pictures) else pictures, state.generator)
        loss = _optimize(state, batch, factor * state.settings.learning_rate)
        yield StepReport(state.step, len(plan), loss, time.monotonic() - began)


def _batch(phase: Phase, pictures: PackedSources, generator: torch.Generator) -> TrainingBatch:
    return training_batch(
        pictures.first(phase.pictures),
        phase.size,
        phase.batch,
        phase.edits,
        generator,
        augmented_prompts=phase.augmented_prompts,
        distractors=phase.distractors,
    )


def _optimize(state: TrainingState, batch: TrainingBatch, learning_rate: float) -> float:
    """One step of the optimizer; the loss before it. Nothing changes where it raises."""
    s = state.settings
    for group in state.optimizer.param_groups:
        group["lr"] = learning_rate
    loss = training_loss(state.network, batch, state.generator, s)
    state.optimizer.zero_grad()
    loss.backward()
    norm = float(torch.nn.utils.clip_grad_norm_(state.network.parameters(), MAX_GRADIENT_NORM))
    value = float(loss.detach())
    if not math.isfinite(value + norm):
        raise GseditError(
            f"the loss is {value} and its gradient's norm {norm} at step {state.step + 1}: "
            f"lower the learning rate ({s.learning_rate:g})"
        )
    state.optimizer.step()
    state.step += 1
    _update_average(state, min(s.ema_decay, (1 + state.step) / (10 + state.step)))
    return value


def _use_halved(phase: Phase, pictures: PackedSources) -> bool:
    """Whether pictures of half the size are large enough for crops of the mean size."""
    return phase.size <= (SMALLEST_CROP + 1) / 2 * pictures.image.shape[1] / 2


def _round_steps(phases: Sequence[Phase], warm_up: int) -> list[tuple[Phase, float]]:
    """A round's steps, each with its factor on the learning rate."""
    steps = [phase for phase in phases for _ in range(phase.steps)]
    return [
        (phase, phase.rate_factor * _rate_factor(i, len(steps), warm_up))
        for i, phase in enumerate(steps)
    ]


def _rate_factor(step: int, total: int, warm_up: int) -> float:
    """Linear warm-up, then half a cosine down to 0."""
    if step < warm_up:
        return (step + 1) / warm_up
    return 0.5 + 0.5 * math.cos(math.pi * (step - warm_up) / max(total - warm_up, 1))


@torch.no_grad()
def _update_average(state: TrainingState, decay: float) -> None:
    for average, parameter in zip(state.average.parameters(), state.network.parameters()):
        average.lerp_(parameter, 1 - decay)
