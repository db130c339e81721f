"""Presets: values of many settings of an edit under one name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

from gsedit.diffusion.settings import SamplerDefaults, SamplerSettings
from gsedit.errors import UsageError
from gsedit.fitting.settings import UpdateSettings
from gsedit.paper.settings import EditSettings


@dataclass(frozen=True)
class Preset:
    """Settings, and values of the fields of strategies that have them."""

    meaning: str
    settings: EditSettings = field(default_factory=EditSettings)
    strategy: Mapping[str, Any] = field(default_factory=dict)

    def applied_to(self, strategy: Any) -> Any:
        """The strategy with the preset's values in those of its fields."""
        own = {each.name for each in fields(strategy)}
        return replace(strategy, **{k: v for k, v in self.strategy.items() if k in own})


PRESETS = {
    "default": Preset("What gsedit does."),
    "quick": Preset(
        "Half of the evaluations of a 2D model (docs/measurements/editors.md).",
        EditSettings(sampler=SamplerSettings(guidance_every=3, guidance_end=1.0)),
    ),
    "paper": Preset(
        "Efficient-NeRF2NeRF as printed (docs/concepts/differences.md).",
        EditSettings(
            sampler=SamplerSettings(
                steps=50, solver="ddim", spacing="leading", strength=1.0, target="xt",
                noise="independent", temperature=1.0, t_end=SamplerDefaults().t_end,
                harmonise=False,
            ),
            update=UpdateSettings(loss="mse+0.1*gram"),
            views_per_batch=4, view_plan="random", anchors=0, geometry="full", region="all",
        ),
        {"update_steps": 200},
    ),
}  # fmt: skip


def find_preset(name: str) -> Preset:
    """Find a preset by its name. Raises UsageError for any other."""
    if name not in PRESETS:
        raise UsageError(f"preset must be one of {', '.join(PRESETS)}, not {name!r}")
    return PRESETS[name]
