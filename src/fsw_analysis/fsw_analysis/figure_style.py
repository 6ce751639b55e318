"""Style of all figures, and the table of the controllers' colours."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from zlib import crc32

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fsw_control.schema.files import replacing

STYLE = {
    "font.size": 10.0,
    "axes.grid": True,
    "grid.alpha": 0.3,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "figure.dpi": 110,
    "lines.linewidth": 1.4,
    "axes.axisbelow": True,
}
#: Of our controllers, in every figure: blue NMPC, red, orange and violet decentralized.
CONTROLLER_COLOURS = {
    "nmpc": "#0b62a4",
    "nmpc:default": "#0b62a4",
    "nmpc:paper": "#41b6c4",
    "decentral": "#d1495b",
    "decentral:conservative": "#d1495b",
    "decentral:tight": "#e8a33d",
    "decentral:smith": "#7a4a9e",
}
#: Of everything else.
COLOURS = ("#2e8540", "#8d5fd3", "#8c564b", "#444444", "#c2569f", "#7a8b00")


@contextmanager
def sheet(
    width: float, height: float, path: Path | None = None, **options: Any
) -> Iterator[Figure]:
    """A figure of this size [inch] to draw in the block; saved as PNG at its end if ``path`` is given."""
    with rc_context(STYLE):
        figure = Figure(figsize=(width, height), layout="constrained", **options)
        yield figure
        if path is not None:
            with replacing(path) as part:
                figure.savefig(part, format="png")


def shade_phases(axes: Iterable[Axes], spans: Iterable[tuple[float, float]]) -> None:
    """Shade every other phase of a weld; ``spans``: begin and end of each in the axes' unit."""
    for axis in axes:
        for number, (begin, end) in enumerate(spans):
            axis.axvspan(begin, end, color="black", alpha=0.06 * (number % 2), linewidth=0.0)


def colours_of(names: Sequence[str]) -> list[str]:
    """A distinct colour for each name in a figure; the same for a controller in all figures."""
    found: list[str] = []
    for name in names:
        own = CONTROLLER_COLOURS.get(name, COLOURS[crc32(name.encode()) % len(COLOURS)])
        found.append(
            next(
                (one for one in (own, *COLOURS, *CONTROLLER_COLOURS.values()) if one not in found),
                own,
            )
        )
    return found
