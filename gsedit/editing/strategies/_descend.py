"""Steps down CLIP's losses."""

from __future__ import annotations

from dataclasses import dataclass, field

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.editing.session.session import Session
from gsedit.editing.strategies._clip_losses import ClipLosses
from gsedit.editing.strategies._random_views import RandomViews
from gsedit.formats.pictures import fitted_size
from gsedit.scene.picture import render_picture
from rasterizer.camera import Camera


@dataclass(frozen=True, eq=False)
class UneditedVectors:
    """The losses, and CLIP's vectors of the unedited scene by view, made when they are needed."""

    losses: ClipLosses
    vectors: dict[int, Float[Tensor, " d"]] = field(default_factory=dict)

    def camera(self, session: Session, view: int) -> Camera:
        """The view's at up to twice CLIP's size: patches are half as wide as a picture."""
        camera = session.request.every_view[view].camera
        return camera.resized(*fitted_size(camera.width, camera.height, 2 * self.losses.clip.size))

    @torch.no_grad()
    def of(self, session: Session, view: int) -> Float[Tensor, " d"]:
        """The vector of the unedited scene at that view."""
        if view not in self.vectors:
            execution = session.request.settings.execution
            camera = self.camera(session, view)
            picture = render_picture(session.request.scene, camera, execution)
            self.vectors[view] = self.losses.clip.images(picture[None])[0]
        return self.vectors[view]


@dataclass(frozen=True, eq=False)
class Descend(RandomViews):
    """Steps down CLIP's losses."""

    unedited: UneditedVectors

    def camera(self, session: Session, view: int) -> Camera:
        """At up to twice CLIP's size."""
        return self.unedited.camera(session, view)

    def loss(
        self, session: Session, view: int, image: Float[Tensor, "h w 3"]
    ) -> tuple[Float[Tensor, ""], float]:
        """The sum of the losses, beside the unedited scene at the same view."""
        before = self.unedited.of(session, view)
        loss = self.unedited.losses(image.clamp(0, 1), before, session.request.generator)
        return loss, float(loss.detach())
