"""The losses of NeRF-Art (Wang et al. 2023, "NeRF-Art: Text-Driven Neural Radiance Fields
Stylization") on pictures, through CLIP.

    L = L_dir + global_weight L_con(whole picture) + local_weight mean L_con(patch)
    L_dir = 1 - cos(E(I) - E(I_0), E(target) - E(source))
    L_con(I) = -log(exp(E(I).E(target) / tau) / sum_t exp(E(I).E(t) / tau))

I is the render, I_0 the unedited one of the same view, and t runs over the target and every text
that pictures should not look like. E has unit length. Theirs keep the content with features of VGG;
here the strategy's regulariser does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from gsedit.editing.session.session import Session
from gsedit.editing.strategies._random_views import RandomViews
from gsedit.formats.pictures import fitted_size
from gsedit.measures.clip import Clip, direction
from gsedit.scene.picture import render_picture
from rasterizer.camera import Camera

TEMPERATURE = 0.07
"""tau of the contrastive loss, as in NeRF-Art."""
PATCH_SIDE_SHARE = 0.5
"""Side of a local patch, of the picture's shorter side."""


@dataclass(frozen=True, eq=False)
class ClipLosses:
    """The losses of one instruction. `t` texts."""

    clip: Clip
    target: Float[Tensor, " d"]
    source: Float[Tensor, " d"]
    negatives: Float[Tensor, "t d"]
    """Texts that pictures should not look like, the source among them."""
    global_weight: float
    local_weight: float
    patches: int
    """Local patches of a picture."""

    def __call__(
        self,
        image: Float[Tensor, "h w 3"],
        unedited: Float[Tensor, " d"],
        generator: torch.Generator,
    ) -> Float[Tensor, ""]:
        """The loss of a render, differentiable; `unedited` is the vector of the unedited one."""
        whole = self.clip.images(image[None])
        loss = 1 - direction(whole, unedited[None], self.target, self.source)[0]
        if self.global_weight:
            loss = loss + self.global_weight * self.contrast(whole).mean()
        if self.local_weight and self.patches:
            side = max(1, round(PATCH_SIDE_SHARE * min(image.shape[:2])))
            cuts = torch.stack([_patch(image, side, generator) for _ in range(self.patches)])
            loss = loss + self.local_weight * self.contrast(self.clip.images(cuts)).mean()
        return loss

    def contrast(self, vectors: Float[Tensor, "n d"]) -> Float[Tensor, " n"]:
        """InfoNCE of the target against the negatives, 0 or more."""
        texts = torch.cat((self.target[None], self.negatives))
        logits = vectors @ texts.mT / TEMPERATURE
        return F.cross_entropy(
            logits, torch.zeros(len(vectors), dtype=torch.long), reduction="none"
        )


def _patch(
    image: Float[Tensor, "h w 3"], side: int, generator: torch.Generator
) -> Float[Tensor, "s s 3"]:
    """A random square inside the picture."""
    top, left = (
        int(torch.randint(length - side + 1, (), generator=generator)) for length in image.shape[:2]
    )
    return image[top : top + side, left : left + side]


def clip_losses(
    clip: Clip,
    target: str,
    source: str,
    negatives: Sequence[str],
    *,
    global_weight: float,
    local_weight: float,
    patches: int,
) -> ClipLosses:
    """The losses of these texts; the source is one of the negatives."""
    vectors = clip.texts([target, source, *negatives])
    return ClipLosses(
        clip, vectors[0], vectors[1], vectors[1:], global_weight, local_weight, patches
    )


@dataclass(frozen=True, eq=False)
class Descend(RandomViews):
    """Steps down CLIP's losses."""

    losses: ClipLosses
    unedited: dict[int, Float[Tensor, " d"]]
    """CLIP's vectors of the unedited scene by view, made when they are needed."""

    def camera(self, session: Session, view: int) -> Camera:
        """The view's camera at up to twice CLIP's size: patches are half as wide as a picture."""
        camera = session.request.every_view[view].camera
        return camera.resized(*fitted_size(camera.width, camera.height, 2 * self.losses.clip.size))

    def loss(
        self, session: Session, view: int, image: Float[Tensor, "h w 3"]
    ) -> tuple[Float[Tensor, ""], float]:
        """The sum of the losses, beside the unedited scene at the same view."""
        if view not in self.unedited:
            request, camera = session.request, self.camera(session, view)
            before = render_picture(request.scene, camera, request.settings.execution)
            self.unedited[view] = self.losses.clip.images(before[None])[0].detach()
        loss = self.losses(image.clamp(0, 1), self.unedited[view], session.request.generator)
        return loss, float(loss.detach())
