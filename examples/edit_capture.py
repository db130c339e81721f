"""Edit a capture with noise and consensus shared, and with neither, and print what each costs and how near it comes.

python examples/edit_capture.py bear.ply photos/ "turn the bear into a bronze statue"
"""

from __future__ import annotations

import sys
from dataclasses import replace

import torch

import gsedit
from gsedit.diffusion import SamplerSettings
from gsedit.editors import make_editor


def run(path: str, data: str, prompt: str, seeds: int = 3) -> None:
    """One line a run: seed, consensus, dB to the ground truth, seconds, matched cells."""
    scene, dataset = gsedit.load(path), gsedit.load_dataset(data, size=256)
    together = gsedit.EditSettings(coverage=1.0)  # all rounds, whatever is covered
    apart = replace(together, sampler=SamplerSettings(consensus=False, noise="independent"))
    for seed in range(seeds):
        for name, settings in (("consensus", together), ("independent", apart)):
            result = gsedit.edit(
                scene,
                prompt,
                editor=make_editor("closed-form"),  # it knows the ground truth
                dataset=dataset,
                settings=settings,
                generator=torch.Generator().manual_seed(seed),
            )
            quality = result.quality
            sys.stdout.write(
                f"seed {seed} {name:11s} {quality.psnr_to_ground_truth:.2f} dB to the truth, "
                f"{quality.residual_to_targets_db:.2f} dB to the targets, "
                f"strength {quality.strength:.3f}, {result.timings['total']:.0f} s, "
                f"{len(result.targets)} views, covering {quality.coverage:.0%}, "
                f"{quality.matched:.0%} matched\n"
            )
            sys.stdout.flush()


if __name__ == "__main__":
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    run(*sys.argv[1:])
