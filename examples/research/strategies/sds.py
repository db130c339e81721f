"""Score distillation (Poole et al. 2023), with the regularizer of Vox-E (Sella et al. 2023)."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.errors import UsageError
from gsedit.paper.diffusion.guidance import Guided, as_pair
from gsedit.paper.diffusion.sampler import add_noise
from gsedit.paper.edit_views import batch_of
from gsedit.paper.editors.sampling import Counted, padded
from gsedit.paper.session import Session
from gsedit.views.image_ops import pad_to_multiple
from rasterizer.camera import Camera
from research.strategies.descent import Descent

LEAST_NOISE, MOST_NOISE = 0.02, 0.98
"""Bounds of the noise level, as fractions of the schedule."""
MIN_LATENT_VARIANCE = 1e-12
"""Floor of the latents' variance as a divisor: that of a picture of one color may be 0."""


@dataclass(frozen=True)
class Sds(Descent):
    """Descend the denoiser's score: w (eps_hat - eps) on the latents, with w = b^2.

    The denoiser is not differentiated. The gradient is divided by the number of latents and by
    their variance. Raises UsageError where the editor is no diffusion model.
    """

    total_steps: int = 1000

    def camera(self, session: Session, view: int) -> Camera:
        """The view's camera at the size at which the view is edited."""
        return session.unedited.edit_camera(view)

    def loss(
        self, session: Session, view: int, image: Float[Tensor, "h w 3"]
    ) -> tuple[Float[Tensor, ""], float]:
        """(loss with the gradient of score distillation, mean of w(t) (eps_hat - eps)^2)."""
        request, generator = session.request, session.request.generator
        denoiser = request.editor.capabilities.denoiser
        if denoiser is None:
            raise UsageError(f"score distillation needs a diffusion model: {request.editor.name}")
        sampler = request.settings.sampler.with_defaults(denoiser.capabilities.defaults)
        whole = padded(batch_of(session, (view,), start={view: image.detach()}), denoiser)
        z = denoiser.encode(pad_to_multiple(image[None], denoiser.multiple, denoiser.padding))
        share = LEAST_NOISE + (MOST_NOISE - LEAST_NOISE) * float(
            torch.rand((), generator=generator)
        )
        level = denoiser.schedule.level(share * (len(denoiser.schedule.alphas_cumprod) - 1))
        noise = torch.randn(z.shape, generator=generator, dtype=z.dtype)
        with torch.no_grad():
            x = add_noise(z, noise, level)
            condition = denoiser.condition(whole.originals, whole.prompt, generator)
            counted = Counted(denoiser)
            guided = Guided(counted, condition, sampler)(x, level)
            error = as_pair(denoiser.predicts, guided, x, level).eps - noise
        session.progress.work.evaluations += counted.evaluations
        weight, variance = level.b**2, z.detach().var().clamp_min(MIN_LATENT_VARIANCE)
        return weight * (error * z).mean() / variance, weight * error.square().mean().item()
