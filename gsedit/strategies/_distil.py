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
from gsedit.reports.events import Event
from gsedit.session.edit_views import find_ground_truth, request_of
from gsedit.session.fit_targets import MEASURE_EVERY
from gsedit.session.quality import measure
from gsedit.session.session import Session
from gsedit.strategies._random_views import RandomViews
from gsedit.views.padding import pad_to_multiple
from rasterizer.camera import Camera

SMALLEST_VARIANCE = 1e-12
"""Of latents: those of a picture of one colour may be 0."""


@dataclass(frozen=True)
class Distil(RandomViews):
    """Steps of score distillation, from noise levels drawn anew."""

    least_noise: float
    most_noise: float

    def camera(self, session: Session, view: int) -> Camera:
        """At the size at which the view is edited."""
        return session.edit_camera(view)

    def loss(
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

    def report(self, session: Session, step: int, value: float) -> Iterator[Event]:
        """The residual now and then, and how near the scene is to the true edit, if it is known."""
        if step % MEASURE_EVERY and step != self.round_steps:
            yield from super().report(session, step, value)
            return
        if session.request.editor.capabilities.find_ground_truth is not None:
            views = session.surveyed.plan.views
            renders = session.render(session.views[i].camera for i in views)
            find_ground_truth(session, dict(zip(views, renders)))
        seconds = session.stopwatch.seconds
        yield measure(session).event("update", seconds, step, self.round_steps, value)


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
