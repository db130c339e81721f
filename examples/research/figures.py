"""The look that the plots of the benchmarks share. Needs no screen."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from gsedit.storage.atomic import atomic_path

DPI = 120


def frame(axes: Any, title: str, fontsize: int) -> None:
    """Title on the left, a pale grid behind the data, no lines above and on the right."""
    axes.set_title(title, fontsize=fontsize, loc="left")
    axes.grid(which="major", color="#dddddd", linewidth=0.7)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def plain_ticks(axes: Any) -> None:
    """Plain numbers along a logarithmic x axis, also between powers of ten if there are few."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    low, high = axes.get_xlim()
    subs = (1.0,) if high / low > 300 else (1.0, 3.0) if high / low > 20 else (1.0, 2.0, 5.0)
    axes.xaxis.set_major_locator(LogLocator(subs=subs))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())


def save_png(figure: Any, path: Path, *, overwrite: bool) -> None:
    """Write the figure, all of it or nothing."""
    with atomic_path(path, overwrite=overwrite) as temporary:
        figure.savefig(temporary, format="png", dpi=DPI)
