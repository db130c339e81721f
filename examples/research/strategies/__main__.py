"""Edit a scene by a baseline: Vox-E's score distillation, or NeRF-Art's losses with --clip.

python -m research.strategies bear.ply bear/ "turn the bear into bronze" -o out/sds
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import torch
import typer

from gsedit import EditResult, edit_steps, load, load_dataset, write_edit
from gsedit.paper.editors import make_editor
from research.command import Output, collect, print_result, require_new, run
from research.strategies.clip import Clip
from research.strategies.sds import Sds


def main(
    scene: Path,
    data: Path,
    sentence: str,
    output: Output,
    clip: Annotated[Path | None, typer.Option(help="Folder of a CLIPModel.")] = None,
    editor: Annotated[str, typer.Option(help="Whose score is distilled.")] = "closed-form",
    steps: Annotated[int, typer.Option(min=1)] = 1000,
) -> None:
    """Write the folder of the edit, which `gsedit metrics` measures."""
    require_new(output)
    descent: Any = Sds(steps) if clip is None else Clip(steps, folder=clip)
    steps_of = edit_steps(
        load(scene), sentence, editor=make_editor(editor), views=load_dataset(data),
        generator=torch.Generator().manual_seed(0), strategy=descent,
    )  # fmt: skip
    result = collect(steps_of)[-1]
    assert isinstance(result, EditResult)
    write_edit(output, result, request={"scene": scene, "instruction": sentence}, overwrite=False)
    print_result(result.metrics.describe())


if __name__ == "__main__":
    run(main)
