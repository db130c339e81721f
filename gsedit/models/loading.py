"""A model of any family, from a folder, a single file or a hub id."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

from gsedit.diffusion.settings import Precision
from gsedit.errors import UsageError
from gsedit.models.hub import Consent, find, settings_for
from gsedit.models.model import Model
from gsedit.models.parts import Parts


def load_model(
    model: str | Path,
    *,
    weights_dir: str | Path | None = None,
    micro_batch: int = 1,
    precision: Precision = "auto",
    yes: Consent = False,
) -> Model:
    """The model of a folder, file or hub id, looked for on this machine before the hub is asked.

    In order: `model` as a folder, `weights_dir`/`model`, the hub's local cache, the hub. Only what
    `families` lists is fetched and loaded, from safetensors alone. `yes` agrees to a download, or
    is asked with its size and licence. Raises UsageError without diffusers, agreement, or memory,
    InputError for a model that is missing, incomplete, a pickle or of another kind.
    """
    if micro_batch < 1:
        raise UsageError(f"micro_batch must be 1 or more, not {micro_batch}")
    place = find(str(model), weights_dir, yes=yes)
    parts = Parts.of(place, precision, settings_for(place, yes=yes))
    try:
        for library in ("accelerate", "diffusers", "transformers"):
            import_module(library)
        family = import_module(f"gsedit.models.{parts.family.module}")
    except ImportError as error:
        raise UsageError(
            f"the editors pix2pix and diffusers need {error.name}: pip install 'gsedit[diffusers]'"
        ) from error
    parts.check_memory()
    return family.load(parts, micro_batch=micro_batch)
