"""An editor on several ranks: its views are shared out, or rank 0 edits for all.

`v` views of `h w` pixels, `c y x` latents; `n` of the views are this rank's.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, NamedTuple, TypeVar, cast

import torch
from jaxtyping import Float
from torch import Tensor

from gsedit.errors import UsageError
from gsedit.paper.diffusion.guidance import Branches, Need, Predictor, needed
from gsedit.paper.diffusion.guided import predict_guided
from gsedit.paper.diffusion.memory import peak_bytes, views_at_once
from gsedit.paper.diffusion.precision import InBfloat16, with_precision
from gsedit.paper.diffusion.settings import SamplerSettings
from gsedit.paper.protocol import (
    Capabilities,
    Denoiser,
    EditBatch,
    Editor,
    EditProgress,
    levels_for,
)
from gsedit.run.ranks import Ranks

D = TypeVar("D", bound=Denoiser)


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


def shared_out(denoiser: D, ranks: Ranks) -> D:
    """The denoiser with its views shared out over ranks.

    Itself on one, and where it runs no network (it declares no with_micro_batch): all ranks then do
    the same, in less time than a message takes.
    """
    if ranks.size == 1 or denoiser.capabilities.with_micro_batch is None:
        return denoiser
    return cast(D, SharedDenoiser(denoiser, ranks))


class SharedDenoiser:
    """A Denoiser of which each rank encodes, predicts and decodes its share of the views, and all
    get all of them. Its condition is that of this rank's views; None where it has none."""

    def __init__(self, denoiser: Any, ranks: Ranks) -> None:
        self._denoiser: Denoiser = denoiser
        self._ranks = ranks

    def __getattr__(self, name: str) -> Any:
        return getattr(self._denoiser, name)

    @property
    def capabilities(self) -> Capabilities:
        """The denoiser's, and the denoiser itself, for who computes the same on all ranks."""
        return replace(self._denoiser.capabilities, denoiser=self._denoiser)

    def encode(self, images: Float[Tensor, "v h w 3"]) -> Float[Tensor, "v c y x"]:
        return self._ranks.rows(self._denoiser.encode, images)

    def encode_edited(
        self, images: Float[Tensor, "v h w 3"], originals: Float[Tensor, "v h w 3"], prompt: str
    ) -> Float[Tensor, "v c y x"]:
        encode = self._denoiser.encode_edited
        return self._ranks.rows(lambda *mine: encode(*mine, prompt=prompt), images, originals)

    def decode(self, latents: Float[Tensor, "v c y x"]) -> Float[Tensor, "v h w 3"]:
        return self._ranks.rows(self._denoiser.decode, latents)

    def condition(
        self, originals: Float[Tensor, "v h w 3"], prompt: str, generator: torch.Generator
    ) -> Any:
        mine = self._mine(originals)
        return self._denoiser.condition(mine, prompt, generator) if len(mine) else None

    def branches(
        self, x: Float[Tensor, "v c y x"], t: float, condition: Any, need: Need
    ) -> Branches:
        def predict(mine: Float[Tensor, "n c y x"]) -> Float[Tensor, "n b c y x"]:
            predicted = self._denoiser.branches(mine, t, condition, need)
            return torch.stack([branch for branch in predicted if branch is not None], 1)

        predicted = iter(self._ranks.rows(predict, x).unbind(1))
        return Branches(*(next(predicted) if needed else None for needed in need))

    def prepared(
        self,
        x: Float[Tensor, "v c y x"],
        originals: Float[Tensor, "v h w 3"],
        prompt: str,
        settings: SamplerSettings,
        known: dict[Any, Fit],
    ) -> Prepared:
        """See `prepared`. Ranks of one machine share its memory, and all compute in the precision
        that rank 0 finds, and count its evaluations."""
        own = Prepared(self._denoiser, 0)
        if len(mine := self._mine(x)):
            originals, local = self._mine(originals), self._ranks.local
            own = prepared(self._denoiser, mine, originals, prompt, settings, known, local)
        network = own.predictor.network if isinstance(own.predictor, InBfloat16) else own.predictor
        found = isinstance(own.predictor, InBfloat16), own.evaluations
        rounded, evaluations = self._ranks.first(found)
        shared: Any = SharedDenoiser(InBfloat16(network) if rounded else network, self._ranks)
        return Prepared(shared, evaluations)

    def _mine(self, rows: Tensor) -> Tensor:
        return rows[self._ranks.share(len(rows))]


@dataclass(frozen=True)
class Fit:
    """How a denoiser fits this machine."""

    view_bytes: int
    """The most memory that a pass or a decoding of one view takes."""
    rounded: bool
    """Whether it is exact enough in bfloat16, and faster."""


class Prepared(NamedTuple):
    """A predictor for a batch, and the evaluations that it took to find it."""

    predictor: Predictor
    evaluations: int


def prepared(
    denoiser: Denoiser,
    x: Float[Tensor, "v c y x"],
    originals: Float[Tensor, "v h w 3"],
    prompt: str,
    settings: SamplerSettings,
    known: dict[Any, Fit],
    sharers: int = 1,
) -> Prepared:
    """The denoiser with as many views in a pass as fit in memory, which so many processes share,
    and in bfloat16 if that is exact enough (see gsedit.paper.diffusion.precision).

    A denoiser that runs a network (with_micro_batch is declared) is measured on the first view:
    the memory of a pass and of a decoding, and the error of bfloat16. `known` keeps what was
    measured, for other batches of the same size and settings. Others are left alone.
    """
    if isinstance(denoiser, SharedDenoiser):
        return denoiser.prepared(x, originals, prompt, settings, known)
    with_micro_batch = denoiser.capabilities.with_micro_batch
    if with_micro_batch is None:
        return Prepared(denoiser, 0)
    key, evaluations = (x.shape[1:], settings), 0
    if key not in known:
        known[key], evaluations = _fit(denoiser, x, originals, prompt, settings)
    fit = known[key]
    sized = with_micro_batch(views_at_once(len(x), fit.view_bytes * sharers, settings.memory))
    return Prepared(InBfloat16(sized) if fit.rounded else sized, evaluations)


def _fit(
    denoiser: Denoiser,
    x: Float[Tensor, "v c y x"],
    originals: Float[Tensor, "v h w 3"],
    prompt: str,
    settings: SamplerSettings,
) -> tuple[Fit, int]:
    """Measure a denoiser on the first view, see `prepared`; the evaluations that it takes."""
    rows, columns = x.shape[2:]
    first = levels_for(denoiser, settings, (rows, columns))[0]
    condition = denoiser.condition(originals[:1], prompt, torch.Generator())
    predictions = 0

    def predict(predictor: Predictor) -> Tensor:
        nonlocal predictions
        predictions += 1
        return predict_guided(predictor, condition, x[:1], first, settings)

    is_auto = settings.precision == "auto"
    asked = denoiser if is_auto else with_precision(denoiser, predict, settings.precision)
    once = cache(lambda: predict(asked))

    def guided(predictor: Predictor) -> Tensor:
        return once() if predictor is asked else predict(predictor)

    held = max(peak_bytes(once), peak_bytes(lambda: denoiser.decode(x[:1])))
    chosen = with_precision(denoiser, guided, settings.precision) if is_auto else asked
    return Fit(held, chosen is not denoiser), predictions * sum(needed(*settings.scales))
