"""Ways to lift noisy masks to Gaussians, on staged scenes: `python -m research.study_masks`.

Each thing of each stage gets exact masks in the views of its stage (96 pixels), wrong in nine ways.
IoU with the thing's true Gaussians, of those that are seen. Two minutes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import torch
from bench.staged import Stage, stages
from torch import Tensor
from torch.nn.functional import avg_pool2d, max_pool2d

from gsedit.select.graph import neighbors
from gsedit.select.lift import MIN_SEEN_PIXELS, find_drawn, lift, smoothed
from gsedit.select.masked import lift_masks
from research.command import print_result, run

SIZE, COUNT = 96, 6000
BIASES = (-0.6, -0.4, -0.2, 0.2)
"""FlashSplat's bias against the background; a mean above (1 + bias) / 2 is inside."""
Noise = Callable[[Tensor, Tensor, float], Tensor]
"""(mask, another thing's, a random number in [0, 1]) -> wrong mask."""


def wide(mask: Tensor, radius: int = 3) -> Tensor:
    """The mask, dilated by so many pixels."""
    return max_pool2d(mask[None], 2 * radius + 1, 1, radius)[0]


def soft(mask: Tensor, radius: int = 5) -> Tensor:
    """The mask, blurred twice by a box."""
    for _ in range(2):
        mask = avg_pool2d(mask[None], 2 * radius + 1, 1, radius, count_include_pad=False)[0]
    return mask


def mixed(mask: Tensor, other: Tensor, draw: float) -> Tensor:
    """Wide in 40 % of the views, missed in 20, with another thing in 15; all soft and faint."""
    if draw < 0.4:
        mask = wide(mask, 2)
    elif draw < 0.6:
        mask = 0 * mask
    elif draw < 0.75:
        mask = torch.maximum(mask, other)
    return 0.8 * soft(mask, 2)


NOISES: dict[str, Noise] = {
    "exact": lambda mask, other, draw: mask,
    "3 pixels wide": lambda mask, other, draw: wide(mask),
    "2 pixels thin": lambda mask, other, draw: 1 - wide(1 - mask, 2),
    "missed in 35 %": lambda mask, other, draw: mask * (draw >= 0.35),
    "another thing in 35 %": lambda mask, other, draw: other if draw < 0.35 else mask,
    "and another in 35 %": lambda mask, other, draw: torch.maximum(mask, other * (draw < 0.35)),
    "soft": lambda mask, other, draw: soft(mask),
    "soft and faint": lambda mask, other, draw: 0.6 * soft(mask),
    "mixed": mixed,
}


def cases(stage: Stage, noise: Noise, seeds: int = 2) -> Iterator[dict[str, float]]:
    """IoU by the way to lift, of each thing of the stage and each seed."""
    labelled, cameras = stage.gaussians(COUNT), stage.training(SIZE)
    maps, graph = [stage.label_map(camera) for camera in cameras], neighbors(labelled.scene)
    every = [each.name for each in stage.everything]
    for thing in stage.things:
        others = [each.name for each in stage.things if each is not thing] or every[:1]
        exact, other = (
            [(each == every.index(name)).float() for each in maps]
            for name in (thing.name, others[0])
        )
        for seed in range(seeds):
            draws = torch.rand(len(maps), generator=torch.Generator().manual_seed(seed)).tolist()
            masks = [noise(*each) for each in zip(exact, other, draws)]
            lifted = lift(labelled.scene, cameras, masks)
            seen, values = lifted.weight > MIN_SEEN_PIXELS, smoothed(lifted, graph)
            ways = {"vote": lifted.mean > 0.5, "drawn": find_drawn(labelled.scene, lifted)}
            ways |= {f"bias {b}": values > (1 + b) / 2 for b in BIASES}
            ways |= {"kept": lift_masks(labelled.scene, cameras, masks)}
            true = labelled.of(thing.name)
            yield {
                way: float((found & true & seen).sum() / ((found | true) & seen).sum())
                for way, found in ways.items()
            }


def main() -> None:
    """Print a row for each kind of noise, a column for each way."""
    for number, (name, noise) in enumerate(NOISES.items()):
        found = [case for stage in stages() for case in cases(stage, noise)]
        if not number:
            print_result("| masks | " + " | ".join(found[0]) + " |")
        means = [sum(case[way] for case in found) / len(found) for way in found[0]]
        print_result(f"| {name} | " + " | ".join(f"{mean:.2f}" for mean in means) + " |")


if __name__ == "__main__":
    run(main)
