"""An editor on several ranks: its views are shared out, or rank 0 edits for all."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import torch

from gsedit.diffusion.settings import SamplerSettings
from gsedit.editors.protocol import Capabilities, EditBatch, Editor, EditProgress
from gsedit.errors import UsageError
from gsedit.runs.ranks import Ranks


def with_ranks(editor: Editor, ranks: Ranks) -> Editor:
    """The editor on these ranks; itself on one."""
    if ranks.size == 1:
        return editor
    share = editor.capabilities.with_ranks
    return share(ranks) if share else OnRankZero(editor, ranks)


@dataclass(frozen=True, eq=False)
class OnRankZero:
    """An Editor that only rank 0 asks; it sends the others what it yields, as it comes.

    For programs and editors of other packages, of which nothing is known: a program that is given
    some of the views may edit them differently.
    """

    editor: Editor
    ranks: Ranks

    @property
    def name(self) -> str:
        return self.editor.name

    @property
    def cell(self) -> int:
        return self.editor.cell

    @property
    def capabilities(self) -> Capabilities:
        return self.editor.capabilities

    def check(self, prompt: str) -> None:
        """Raise UsageError, on every rank, where it cannot follow the instruction on rank 0."""
        refusal = None
        if not self.ranks.rank:
            try:
                self.editor.check(prompt)
            except UsageError as error:
                refusal = str(error)
        if refusal := self.ranks.first(refusal):
            raise UsageError(refusal)

    def edit(
        self, batch: EditBatch, settings: SamplerSettings, generator: torch.Generator
    ) -> Iterator[EditProgress]:
        """As the editor's on rank 0; the generator is left in the same state on every rank."""
        asked = iter(() if self.ranks.rank else self.editor.edit(batch, settings, generator))
        while True:
            item = next(asked, None)
            sent = self.ranks.first(item and (item.step, item.steps, item.images, item.evaluations))
            if sent is None:
                break
            yield EditProgress(*sent)
        generator.set_state(self.ranks.first(generator.get_state()))
