"""NeRF-Art (Wang et al. 2023): the scene is pulled towards a text through CLIP."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from gsedit.editing.strategies._settings import VOX_E_WEIGHT, DatasetViews, check_positive
from gsedit.errors import UsageError

if TYPE_CHECKING:
    from gsedit.editing.session.actions import Action
    from gsedit.editing.session.session import Session

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
        from gsedit.measures.clip import load_clip

        if self.clip is None:
            raise UsageError(NO_WEIGHTS)
        load_clip(self.clip)

    def schedule(self, session: Session) -> Iterator[Action]:
        """A few steps at a time."""
        from gsedit.editing.session.actions import MAX_STEPS_AT_ONCE
        from gsedit.editing.strategies._clip_losses import Descend, clip_losses
        from gsedit.editing.strategies._dataset import dataset_views
        from gsedit.measures.clip import load_clip

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
        views, structure = dataset_views(session, self.dataset_views), self.structure_weight
        unedited = {}
        for first in range(0, self.total_steps, MAX_STEPS_AT_ONCE):
            last = min(first + MAX_STEPS_AT_ONCE, self.total_steps)
            yield Descend(views, first, last, self.total_steps, structure, losses, unedited)
