"""NeRF-Art (Wang et al. 2023): the scene is pulled towards a text through CLIP."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.editing.session.actions import MAX_STEPS_AT_ONCE, Action
from gsedit.editing.session.session import Session
from gsedit.editing.strategies._clip_losses import ClipLosses, clip_losses
from gsedit.editing.strategies._dataset import DatasetViews, check_positive, dataset_views
from gsedit.editing.strategies._random_views import RandomViews
from gsedit.editing.strategies.sds import VOX_E_WEIGHT
from gsedit.errors import UsageError
from gsedit.formats.pictures import fitted_size
from gsedit.measures.clip import load_clip
from gsedit.scene.picture import render_picture
from rasterizer.camera import Camera

NO_WEIGHTS = (
    "the strategy clip needs the weights of CLIP: add --clip DIR, a CLIPModel folder of "
    "transformers such as a copy of openai/clip-vit-base-patch32, or choose another --strategy"
)


@dataclass(frozen=True)
class Clip:
    """Descend NeRF-Art's CLIP losses on random views: no 2D editor is asked.

    Raises UsageError for a value out of range; where no weights are given, as the edit begins.
    """

    asks_editor: ClassVar[bool] = False
    """Any instruction will do: the editor need not follow it."""

    fits_pictures: ClassVar[bool] = False
    """It renders the scene itself, with gradients."""

    clip: Path | None = None
    """Folder of a CLIPModel of transformers (config.json, model.safetensors, tokenizer)."""
    source_caption: str = "a photo"
    """A caption of the unedited scene."""
    target_caption: str | None = None
    """A caption of the edited scene; None for the instruction."""
    unlike: str = ""
    """Further texts that pictures should not look like, separated by semicolons."""
    total_steps: int = 400
    """Steps, a view each."""
    global_weight: float = 0.2
    """Weight of the contrastive loss of whole pictures, beside 1 of the directional loss."""
    local_weight: float = 0.1
    """Weight of the contrastive loss of patches."""
    local_patches: int = 4
    """Patches of a picture for that loss, half as wide as the picture."""
    structure_weight: float = VOX_E_WEIGHT
    """Weight that keeps opacities and base colors correlated with the unedited scene's; 0 for
    none."""
    dataset_views: DatasetViews = "all"
    """Views that are rendered: all, or those of the plan."""

    def __post_init__(self) -> None:
        check_positive(total_steps=self.total_steps, local_patches=self.local_patches)
        for name in ("global_weight", "local_weight", "structure_weight"):
            if not getattr(self, name) >= 0:
                raise UsageError(f"{name.replace('_', ' ')} {getattr(self, name)} is not 0 or more")

    def check(self) -> None:
        """Raise UsageError where no weights are given, InputError where they cannot be read."""
        if self.clip is None:
            raise UsageError(NO_WEIGHTS)
        load_clip(self.clip)

    def schedule(self, session: Session) -> Iterator[Action]:
        """A few steps at a time."""
        if self.clip is None:
            raise UsageError(NO_WEIGHTS)
        losses = clip_losses(
            load_clip(self.clip),
            self.target_caption or session.request.prompt,
            self.source_caption,
            [text.strip() for text in self.unlike.split(";") if text.strip()],
            global_weight=self.global_weight,
            local_weight=self.local_weight,
            patches=self.local_patches,
        )
        views, unedited = dataset_views(session, self.dataset_views), UneditedVectors(losses)
        for first in range(0, self.total_steps, MAX_STEPS_AT_ONCE):
            last = min(first + MAX_STEPS_AT_ONCE, self.total_steps)
            yield Descend(views, first, last, self.total_steps, self.structure_weight, unedited)


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
