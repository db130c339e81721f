"""`small` as an editor: one pass of sampling for each look that an instruction asks for."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import torch

from gsedit.diffusion.settings import SamplerSettings
from gsedit.editor_protocol import Capabilities, EditBatch, EditProgress
from gsedit.editors.ranked import shared_out
from gsedit.editors.sampling import DiffusionEditor
from gsedit.editors.small.denoiser import Small


@dataclass(frozen=True, eq=False)
class SmallEditor:
    """An Editor. Of two looks the subject's is applied first: its result is the original of the
    scene's pass. The network was trained on both at once too, and mostly applies only one."""

    small: Small

    @property
    def name(self) -> str:
        return self.small.name

    @property
    def cell(self) -> int:
        return self.small.cell

    @property
    def capabilities(self) -> Capabilities:
        return replace(
            self._sampler.capabilities,
            measure=None,  # seconds
            with_ranks=lambda ranks: replace(self, small=shared_out(self.small, ranks)),
        )

    def check(self, prompt: str) -> None:
        """Raise UsageError if it cannot follow the instruction."""
        self.small.check(prompt)

    def edit(
        self, batch: EditBatch, settings: SamplerSettings, generator: torch.Generator
    ) -> Iterator[EditProgress]:
        """Every pass is one of DiffusionEditor, with the same correspondences.

        Anchored views come with the result of the last pass, so only the last is tied to them; the
        earlier ones edit them again, together with the others, as originals for the last.
        """
        self.check(batch.prompt)
        *earlier, last = self.small.wordings(batch.prompt)
        passes = len(earlier) + 1
        originals, images, spent = batch.originals, batch.images, 0
        for k, wording in enumerate(earlier):
            unedited = replace(batch, images=originals, originals=originals, anchored=None)
            one_look = replace(unedited, prompt=wording)
            for progress in self._sampler.edit(one_look, settings, generator):
                if progress.images is not None:
                    originals = progress.images
                step, steps = progress.step + k * progress.steps, passes * progress.steps
                evaluations = spent + progress.evaluations
                yield EditProgress(min(step, steps - 1), steps, None, evaluations)
            spent = evaluations
        if earlier:
            images = originals.clone()
            if batch.anchored is not None:
                images[batch.anchored] = batch.images[batch.anchored]
        final = replace(batch, prompt=last, images=images, originals=originals)
        for progress in self._sampler.edit(final, settings, generator):
            step = progress.step + len(earlier) * progress.steps
            evaluations = spent + progress.evaluations
            steps = passes * progress.steps
            yield EditProgress(step, steps, progress.images, evaluations)

    @cached_property
    def _sampler(self) -> DiffusionEditor:
        return DiffusionEditor(self.small)
