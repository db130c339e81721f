"""Steps of score distillation."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.datasets.padding import pad_to_multiple
from gsedit.diffusion.guided import predict_guided
from gsedit.diffusion.predictions import as_pair
from gsedit.diffusion.sampler import add_noise
from gsedit.editing.session.edit_views import batch_of, find_ground_truth
from gsedit.editing.session.fit_targets import MEASURE_EVERY_STEPS
from gsedit.editing.session.measure_progress import measure_progress
from gsedit.editing.session.session import Session, render_edited
from gsedit.editing.strategies._random_views import RandomViews
from gsedit.editor_protocol import Denoiser, for_settings
from gsedit.editors.sampling import Counted, padded, with_subject_mask
from gsedit.errors import UsageError
from gsedit.runs.events import Event
from rasterizer.camera import Camera

MIN_LATENT_VARIANCE = 1e-12
"""Floor of the latents' variance as a divisor: that of a picture of one color may be 0."""


@dataclass(frozen=True)
class Distil(RandomViews):
    """Steps of score distillation, from noise levels drawn anew."""

    least_noise: float
    most_noise: float

    def camera(self, session: Session, view: int) -> Camera:
        """The view's camera at the size at which the view is edited."""
        return session.unedited.edit_camera(view)

    def loss(
        self, session: Session, view: int, image: Float[Tensor, "h w 3"]
    ) -> tuple[Float[Tensor, ""], float]:
        """(loss with the gradient of score distillation, mean of w(t) (eps_hat - eps)^2)."""
        generator = session.request.generator
        sampler = session.request.settings.sampler
        denoiser, sampler = for_settings(denoiser_of(session), sampler)
        batch = batch_of(session, (view,), start={view: image.detach()})
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
            counted = Counted(with_subject_mask(denoiser, whole.subject))
            guided = predict_guided(counted, condition, x, level, sampler)
            error = as_pair(denoiser.predicts, guided, x, level).eps - noise
        session.progress.work.evaluations += counted.evaluations
        weight = level.b**2
        variance = z.detach().var().clamp_min(MIN_LATENT_VARIANCE)
        return weight * (error * z).mean() / variance, weight * error.square().mean().item()

    def report(self, session: Session, step: int, value: float) -> Iterator[Event]:
        """Yield the residual now and then, and the distance to the true edit where it is known."""
        if step % MEASURE_EVERY_STEPS and step != self.round_steps:
            yield from super().report(session, step, value)
            return
        if session.request.editor.capabilities.find_ground_truth is not None:
            find_ground_truth(session, render_edited(session, session.surveyed.plan.views))
        seconds = session.progress.stopwatch.seconds
        yield measure_progress(session).event("update", seconds, step, self.round_steps, value)


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
