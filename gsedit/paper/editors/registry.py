"""2D editors and mask providers by name, those of this package and of others.

A package adds one by an entry point (`plugins` in this folder): of the group `gsedit.editors` a
callable that makes an Editor, whose options may be `model`, `runtime`, `run`, `timeout` and
`folder`, and whose attribute `capabilities` (gsedit.paper.editors.Capabilities) declares everything
optional; of the group `gsedit.masks` one that makes a MaskProvider, whose options may be `run`,
`model` and `sam`. `examples/write_an_editor.py` shows an editor. Listing loads no torch.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import wraps
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gsedit.errors import GseditError, UsageError
from gsedit.paper.editors.plugins import EXAMPLE, MASK_EXAMPLE, Listing, Plugins

if TYPE_CHECKING:
    from gsedit.paper.diffusion.settings import Precision
    from gsedit.paper.editors.protocol import Editor
    from gsedit.select.masked import MaskProvider

DEFAULT = "painter"

# ---- ours: each factory's docstring is its line in the list -------------------------------------


def _painter(
    like: Path | None = None, strength: float | None = None, keep_colors: bool | None = None
) -> Editor:
    """Published networks, come with gsedit: painting styles by name, or that of a picture."""
    from gsedit.paper.editors.painter.editor import make_painter

    return make_painter(like, strength, keep_colors)


def _closed_form() -> Editor:
    """Built in, no weights: fixed looks with a known ground truth, to measure the method by."""
    from gsedit.paper.editors.closed_form import ClosedForm
    from gsedit.paper.editors.sampling import DiffusionEditor

    return DiffusionEditor(ClosedForm())


def _diffusers(
    model: str | Path | None = None, precision: Precision = "auto", runtime: str = "auto"
) -> Editor:
    """2D editing models in diffusers' layout, a folder or hub id: any sentence."""
    from gsedit.paper.editors.sampling import DiffusionEditor
    from gsedit.paper.models.loading import load_model
    from gsedit.paper.models.runtime import make_runtime

    if model is None:
        raise UsageError(f"the diffusers editor needs a model: add {_models()}")
    run = make_runtime(runtime)
    loaded = load_model(model, precision=precision)
    return DiffusionEditor(replace(loaded, run=run))


@wraps(_diffusers, assigned=())
def _pix2pix(model: str | Path | None = None, **options: Any) -> Editor:
    """InstructPix2Pix, by default the authors' weights of Stable Diffusion 1.5: any sentence."""
    from gsedit.paper.models.hub import DEFAULT as DEFAULT_MODEL

    return _diffusers(model or DEFAULT_MODEL, **options)


def _models() -> str:
    """The option, with a model of every family."""
    from gsedit.paper.models.hub import PIPELINES

    families = dict.fromkeys(PIPELINES.values())
    examples = ", ".join(f"{each.example} ({each.gigabytes:.0f} GB)" for each in families)
    return f"--model FOLDER_OR_ID, such as {examples}"


def _libraries_missing() -> Iterable[str]:
    needed = ("accelerate", "diffusers", "transformers")
    if absent := [name for name in needed if find_spec(name) is None]:
        yield f"{', '.join(absent)}: pip install 'gsedit[diffusers]'"


def _pix2pix_missing() -> Iterable[str]:
    from gsedit.paper.models import hub

    yield from _libraries_missing()
    try:
        hub.require(hub.inspect(hub.find(hub.DEFAULT)))
    except GseditError:
        yield f"weights: add --model FOLDER_OR_ID; {hub.download_advice(hub.DEFAULT)}"


def _command(
    run: str | None = None, timeout: float | None = None, folder: Path | None = None
) -> Editor:
    """Any program that reads a folder of pictures and fills another; made consistent afterwards."""
    from gsedit.paper.editors.command import Command

    if run is None:
        raise UsageError(f"the command editor needs to know the program: add {EXAMPLE}")
    return Command(run, timeout, folder)


def _mask_command(run: str | None = None) -> MaskProvider:
    """A program of yours: --masks-run "my_segmenter {input} {output} {phrase}"."""
    from gsedit.paper.editors.command import MaskCommand

    if run is None:
        raise UsageError(f"--masks command needs to know the program: add {MASK_EXAMPLE}")
    return MaskCommand(run)


def _clipseg(model: str | None = None) -> MaskProvider:
    """CLIPSeg, soft masks: --masks-model FOLDER; gsedit[diffusers]."""
    if model is None:
        raise UsageError("--masks clipseg needs its weights: add --masks-model FOLDER")
    for name in ("diffusers", "transformers"):
        if find_spec(name) is None:
            raise UsageError(f"masks by networks need {name}: pip install 'gsedit[diffusers]'")
    from gsedit.paper.models.mask_networks import load_clipseg

    return load_clipseg(model)


EDITORS = Plugins(
    "gsedit.editors",
    "editor",
    {
        "painter": (_painter, tuple),
        "closed-form": (_closed_form, tuple),
        "pix2pix": (_pix2pix, _pix2pix_missing),
        "diffusers": (_diffusers, lambda: (*_libraries_missing(), f"a model: add {_models()}")),
        "command": (_command, lambda: (f"a program of yours: {EXAMPLE}",)),
    },
    parts=("name", "cell", "check", "edit", "capabilities"),
)
MASKS = Plugins(
    "gsedit.masks",
    "masks",
    {"command": (_mask_command, tuple), "clipseg": (_clipseg, tuple)},
    parts=("name", "check", "masks"),
    prefix="--masks-",
)


def make_editor(name: str = DEFAULT, **options: Any) -> Editor:
    """The editor of that name; `options` that are None are as if they were not given.

    `model`, `precision` and `runtime` are for pix2pix and diffusers (see load_model, make_runtime),
    `run`, `timeout` (seconds) and `folder` for command (see Command). Raises UsageError for a name
    or an option that there is not, GseditError where a third party's editor cannot be made.
    """
    return EDITORS.make(name, options)


def list_editors() -> tuple[Listing, ...]:
    """Every editor with what it needs. What cannot be imported is listed too; nothing is raised."""
    return EDITORS.list()


def make_masks(name: str, **options: Any) -> MaskProvider:
    """The mask provider of that name; `options` that are None are as if they were not given.

    `run` is the program of command (see MaskCommand), `model` the folder of clipseg. Raises
    as `make_editor`.
    """
    return MASKS.make(name, options)
