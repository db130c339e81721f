"""Edit a scene by a baseline: Vox-E's score distillation.

python -m research.strategies bear.ply bear/ "turn the bear into bronze" -o out/sds
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import torch
import typer

from gsedit import EditResult, edit_steps, load, load_dataset, write_edit
from gsedit.paper.editors import make_editor
from research.command import Output, collect, print_result, require_new, run
from research.strategies.sds import Sds


def main(
    scene: Path,
    data: Path,
    sentence: str,
    output: Output,
    editor: Annotated[str, typer.Option(help="Whose score is distilled.")] = "closed-form",
    steps: Annotated[int, typer.Option(min=1)] = 1000,
) -> None:
    """Write the folder of the edit, which `gsedit metrics` measures."""
    require_new(output)
    steps_of = edit_steps(
        load(scene), sentence, editor=make_editor(editor), views=load_dataset(data),
        generator=torch.Generator().manual_seed(0), strategy=Sds(steps),
    )  # fmt: skip
    result = collect(steps_of)[-1]
    assert isinstance(result, EditResult)
    write_edit(output, result, request={"scene": scene, "instruction": sentence}, overwrite=False)
    print_result(result.metrics.describe())


if __name__ == "__main__":
    run(main)
