"""Steps of score distillation (Poole et al. 2023): a denoiser's error pulls at the scene itself.

A view is rendered with gradients and encoded to z, noised to x_t = a z + b eps, and denoised with
the instruction and the unedited picture as conditions. The gradient with respect to z is
w(t) (eps_hat - eps), w(t) = b^2; the denoiser itself is not differentiated. It is divided by the
number of values of z and by their variance (1 for Stable Diffusion), so that a weight beside it
means the same for every editor.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.diffusion import add_noise, predict_guided
from gsedit.diffusion.predictions import as_pair
from gsedit.editors.protocol import Denoiser
from gsedit.editors.sampling import Counted, padded, told
from gsedit.errors import UsageError
from gsedit.fitting.correlation import correlation_loss
from gsedit.fitting.update import FINAL_RATE
from gsedit.reports.events import Event
from gsedit.session.edit_views import find_ground_truth, request_of
from gsedit.session.fit_targets import MEASURE_EVERY, REPORT_EVERY
from gsedit.session.quality import measure
from gsedit.session.session import Session
from gsedit.views.padding import pad_to_multiple
from rasterizer.render import render

SMALLEST_VARIANCE = 1e-12
"""Of latents: those of a picture of one colour may be 0."""


@dataclass(frozen=True)
class Distil:
    """Steps `first` to `last` (not included) of all, each on a random one of the views."""

    views: tuple[int, ...]
    first: int
    last: int
    round_steps: int
    least_noise: float
    most_noise: float
    structure_weight: float

    def __call__(self, session: Session) -> Iterator[Event]:
        optimiser, stopwatch = session.optimiser, session.stopwatch
        generator = session.request.generator
        seen = session.seen_from(self.views)
        if self.first == 0:
            optimiser.raise_negative_colours(seen)
        for step in range(self.first, self.last):
            with stopwatch.stage("update"):
                view = self.views[int(torch.randint(len(self.views), (), generator=generator))]
                scene = optimiser.scene
                camera = session.edit_camera(view)
                image = render(scene, camera, execution=session.settings.execution).color
                loss, residual = self._score(session, view, image)
                if self.structure_weight:
                    held = correlation_loss(scene, session.request.scene, seen)
                    loss = loss + self.structure_weight * held
                loss.backward()
                fall = (1 - FINAL_RATE) * step / max(1, self.round_steps - 1)
                optimiser.step(1 - fall, only=seen)
            session.work.steps += 1
            yield from self._report(session, step + 1, residual)

    def _score(
        self, session: Session, view: int, image: Float[Tensor, "h w 3"]
    ) -> tuple[Float[Tensor, ""], float]:
        """(what has the gradient of score distillation, mean of w(t) (eps_hat - eps)^2)."""
        denoiser, generator = denoiser_of(session), session.request.generator
        batch = request_of(session, (view,), start={view: image.detach()})
        whole = padded(batch, denoiser)
        pixels = pad_to_multiple(image[None], denoiser.multiple, denoiser.padding)
        z = denoiser.encode(pixels)
        draw = float(torch.rand((), generator=generator))
        share = self.least_noise + (self.most_noise - self.least_noise) * draw
        level = denoiser.schedule.level(share * (len(denoiser.schedule.alphas_cumprod) - 1))
        noise = torch.randn(z.shape, generator=generator, dtype=z.dtype)
        with torch.no_grad():
            x = add_noise(z, noise, level)
            condition = denoiser.condition(whole.originals, whole.prompt, generator)
            counted = Counted(told(denoiser, whole.subject))
            guided = predict_guided(counted, condition, x, level, session.settings.sampler)
            error = as_pair(denoiser.predicts, guided, x, level).eps - noise
        session.work.evaluations += counted.evaluations
        weight = level.b**2
        variance = z.detach().var().clamp_min(SMALLEST_VARIANCE)
        return weight * (error * z).mean() / variance, weight * error.square().mean().item()

    def _report(self, session: Session, step: int, residual: float) -> Iterator[Event]:
        seconds = session.stopwatch.seconds
        if step % MEASURE_EVERY == 0 or step == self.round_steps:
            if session.request.editor.capabilities.find_ground_truth is not None:
                views = session.surveyed.plan.views
                renders = session.render(session.views[i].camera for i in views)
                find_ground_truth(session, dict(zip(views, renders)))
            yield measure(session).event("update", seconds, step, self.round_steps, residual)
        elif step % REPORT_EVERY == 0:
            yield Event("update", seconds, step, self.round_steps, residual)


def denoiser_of(session: Session) -> Denoiser:
    """The editor's diffusion model. Raises UsageError where it has none."""
    editor = session.request.editor
    denoiser = editor.capabilities.denoiser
    if denoiser is None:
        raise UsageError(
            f"the strategy sds needs the diffusion model of an editor, and {editor.name} has none: "
            "use --editor small, pix2pix or closed-form, or another strategy"
        )
    return denoiser
