"""Edit a capture with and without shared noise and consensus; print what each costs and reaches.

python examples/edit_capture.py bear.ply photos/ "turn the bear into a bronze statue"
"""

from __future__ import annotations

import sys
from dataclasses import replace
from itertools import product

import torch

import gsedit
from gsedit.paper.diffusion.settings import SamplerSettings
from gsedit.paper.editors import make_editor


def run(path: str, data: str, prompt: str, seeds: int = 3) -> None:
    """One line a run: seed, noise, consensus, dB to the ground truth, seconds, matched cells."""
    scene, dataset = gsedit.load(path), gsedit.load_dataset(data, size=256)
    together = gsedit.EditSettings(coverage=1.0)  # all rounds, whatever is covered
    for seed in range(seeds):
        for noise, consensus in product(("independent", "shared"), (False, True)):
            sampler = SamplerSettings(noise=noise, consensus=consensus)
            settings = replace(together, sampler=sampler)
            result = gsedit.edit(
                scene,
                prompt,
                editor=make_editor("closed-form"),  # it knows the ground truth
                views=dataset,
                settings=settings,
                generator=torch.Generator().manual_seed(seed),
            )
            quality = result.metrics
            sys.stdout.write(
                f"seed {seed} {noise:11s} noise, consensus {consensus!s:5s} "
                f"{quality.psnr_to_ground_truth:.2f} dB to the truth, "
                f"{quality.psnr_to_targets:.2f} dB to the targets, "
                f"changed by {quality.rmse_to_unedited:.3f}, {result.timings['total']:.0f} s, "
                f"{len(result.targets)} views, covering {result.view_plan.coverage[-1]:.0%}, "
                f"{quality.matched:.0%} matched\n"
            )
            sys.stdout.flush()


if __name__ == "__main__":
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    run(*sys.argv[1:])
