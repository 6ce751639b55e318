"""Style of all figures: the table of the controllers' looks, sheets, legends and time axes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple
from zlib import crc32

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MultipleLocator

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
    "hatch.linewidth": 0.6,
    "svg.hashsalt": "fsw",
}
#: written by format, without what differs from run to run: the same figure, the same bytes
_METADATA: dict[str, dict[str, Any]] = {
    "png": {"Software": None},
    "svg": {"Date": None},
    "pdf": {"CreationDate": None},
}
#: from this duration [s] on, a time axis counts minutes; steps of its ticks [min]
_LONG_S = 600.0
_TICKS_MIN = (1, 2, 5, 10, 15, 30, 60, 120, 240)
_MOST_TICKS = 10
_LEGEND_ROW, _LEGEND_COLUMNS = 0.3, 4
#: width of an upright phase's name and the room below the curves for it, as shares of the axis
_PHASE_WIDTH, _PHASE_ROOM = 0.022, 0.4


class Look(NamedTuple):
    """How a controller, or whatever else is compared, is drawn; also without colour distinct."""

    colour: str
    dashes: str | tuple[float, ...]
    marker: str
    hatch: str

    @property
    def line(self) -> dict[str, Any]:
        """Of a curve."""
        style = self.dashes if isinstance(self.dashes, str) else (0.0, self.dashes)
        return {"color": self.colour, "linestyle": style}

    @property
    def point(self) -> dict[str, Any]:
        """Of single points."""
        return {"color": self.colour, "marker": self.marker, "linestyle": "none"}

    @property
    def bar(self) -> dict[str, Any]:
        """Of a bar or an area."""
        return {
            "facecolor": self.colour,
            "edgecolor": "white",
            "hatch": self.hatch,
            "linewidth": 0.0,
        }


#: what is shown, what is wrong, what else happens: in figures that compare nothing
BLUE, RED, GREEN = "#0b62a4", "#d1495b", "#2e8540"
_DEFAULT = Look(BLUE, "-", "o", "")
_CONSERVATIVE = Look(RED, (5.0, 1.2), "s", "////")
#: Of our controllers, in every figure: blue NMPC, red, orange and violet decentralized.
CONTROLLERS = {
    "nmpc": _DEFAULT,
    "nmpc:default": _DEFAULT,
    "nmpc:paper": Look("#41b6c4", (6.0, 1.5, 1.5, 1.5), "^", "|||"),
    "decentral": _CONSERVATIVE,
    "decentral:conservative": _CONSERVATIVE,
    "decentral:tight": Look("#e8a33d", (2.0, 1.0), "D", "..."),
    "decentral:smith": Look("#7a4a9e", (7.0, 1.2, 1.2, 1.2, 1.2, 1.2), "v", "\\\\\\\\"),
}
#: Of everything else.
OTHERS = (
    Look(GREEN, (12.0, 1.5, 4.0, 1.5), "X", "++"),
    Look("#8d5fd3", (4.0, 2.0), "<", "//"),
    Look("#8c564b", (8.0, 2.0, 2.0, 2.0), ">", "\\\\"),
    Look("#444444", (1.5, 1.5), "h", "--"),
    Look("#c2569f", (5.0, 1.0, 1.0, 1.0), "*", "oo"),
    Look("#7a8b00", (3.0, 1.0), "p", "||"),
)
#: colours of OTHERS, for curves that are no comparison
COLOURS = tuple(look.colour for look in OTHERS)


def looks_of(names: Sequence[str]) -> list[Look]:
    """A distinct look for each name in a figure; the same for a controller in all figures."""
    looks: list[Look] = []
    for name in names:
        own = CONTROLLERS.get(name, OTHERS[crc32(name.encode()) % len(OTHERS)])
        candidates = (own, *OTHERS, *CONTROLLERS.values())
        looks.append(next((look for look in candidates if look not in looks), own))
    return looks


@contextmanager
def sheet(
    width: float, height: float, path: Path | None = None, **options: Any
) -> Iterator[Figure]:
    """A figure of this size [inch] to draw in the block; saved at its end if ``path`` is given.

    The format follows from the name: PNG, SVG or PDF.
    """
    with rc_context(STYLE):
        figure = Figure(figsize=(width, height), layout="constrained", **options)
        yield figure
        if path is not None:
            _save(figure, path)


def _save(figure: Figure, path: Path) -> None:
    kind = path.suffix.lower().lstrip(".") or "png"
    with replacing(path) as part:
        figure.savefig(part, format=kind, metadata=_METADATA[kind])


def png(figure: Figure, dpi: float, beside: Path | None = None) -> bytes:
    """A figure as PNG, for a page.

    Also as the file ``beside`` the page, in the format of its name.
    """
    with BytesIO() as file:  # first: the layout of a figure that is drawn again differs
        figure.savefig(file, format="png", dpi=dpi, metadata=_METADATA["png"])
        drawn = file.getvalue()
    if beside is not None:
        beside.parent.mkdir(parents=True, exist_ok=True)
        _save(figure, beside)
    return drawn


def legend_below(
    figure: Figure, axes: Sequence[Axes] = (), most: int = _LEGEND_COLUMNS, **options: Any
) -> None:
    """Add one legend for axes (default: all), below them."""
    named: dict[str, Any] = {}
    for axis in axes or figure.axes:
        named |= {
            label: line for line, label in zip(*axis.get_legend_handles_labels(), strict=True)
        }
    if named:
        # matplotlib before 3.7 cannot place a legend outside by itself
        rows = -(-len(named) // most)
        below = _LEGEND_ROW * rows / figure.get_figheight()
        figure.set_layout_engine("constrained", rect=(0.0, below, 1.0, 1.0 - below))
        places = {"loc": "lower center", "ncols": -(-len(named) // rows), "frameon": False}
        figure.legend(named.values(), named.keys(), handlelength=3.0, **places, **options)


def label_time(axis: Axes, end_s: float) -> None:
    """Label a horizontal axis whose data are in seconds: in minutes where they are many."""
    if end_s < _LONG_S:
        axis.set_xlabel("time [s]")
        return
    fewest = end_s / 60.0 / _MOST_TICKS
    step_s = 60.0 * next((step for step in _TICKS_MIN if step >= fewest), _TICKS_MIN[-1])
    axis.xaxis.set_major_locator(MultipleLocator(step_s))
    axis.xaxis.set_major_formatter(FuncFormatter(lambda time_s, _: f"{time_s / 60.0:g}"))
    axis.set_xlabel("time [min]")


def shade_phases(axes: Sequence[Axes], phases: Iterable[tuple[str, float, float]]) -> None:
    """Shade every other phase of a weld: name, begin and end of each in the axes' unit.

    The last axis has the names below its curves, side by side where phases are short.
    """
    last, right = axes[-1], float("-inf")
    low, high = last.get_ylim()
    style: dict[str, Any] = {
        "rotation": 90,
        "fontsize": 7.0,
        "ha": "center",
        "color": "dimgray",
    }
    for number, (name, begin, end) in enumerate(phases):
        for axis in axes:
            axis.axvspan(begin, end, color="black", alpha=0.06 * (number % 2), linewidth=0.0)
        right = max(0.5 * (begin + end), right + _PHASE_WIDTH * np.ptp(last.get_xlim()))
        across = last.get_xaxis_transform()
        last.text(right, 0.03, name.replace("_", " "), transform=across, **style)
        last.set_ylim(low - _PHASE_ROOM * (high - low), high)
