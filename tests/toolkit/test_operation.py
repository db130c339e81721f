"""Operations: the same in parts as at once, on tables and on scenes of tensors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from splat_tables import random_table

from gsedit.formats.streams import SceneHeader, gather, in_blocks
from gsedit.scene.table import SplatTable
from gsedit.toolkit import Operation, ReduceSH, Whole, apply
from gsedit.toolkit.operation import run


@dataclass(frozen=True)
class Opaque(Operation):
    """Keep the rows of an opacity of one half or more."""

    removes: ClassVar[bool] = True

    def apply(self, table: SplatTable, say) -> SplatTable:
        return table[table.logit_opacities >= 0]


@dataclass(frozen=True)
class Backwards(Whole):
    """Turn the order of the rows round."""

    def apply(self, table: SplatTable, say) -> SplatTable:
        say("turned")
        return table[::-1]


def test_parts_give_what_the_whole_gives():
    table, said = random_table(10, 2).replace(extra={"label": np.arange(10)}), []
    header = SceneHeader(table.degree, {"label": table.extra["label"].dtype})
    steps = (Opaque(), Backwards(), ReduceSH(1))
    after, blocks, counts = run(header, in_blocks(table, 3), steps, said.append)
    parts = gather(blocks, after, 4)
    whole = apply(table, *steps)
    keep = np.flatnonzero(table.logit_opacities >= 0)[::-1]
    assert 0 < len(keep) < len(table)
    for each in (parts, whole):
        np.testing.assert_array_equal(each.means, table.means[keep])
        np.testing.assert_array_equal(each.sh, table.sh[keep][:, :4])
        np.testing.assert_array_equal(each.extra["label"], keep)
    assert after.degree == 1
    assert said[0] == "turned"
    assert "colors change by" in said[1]
    assert str(counts[0][1]) == f"kept {len(keep)} of 10 ({10 * (len(keep) - 10):+.1f} %)"
