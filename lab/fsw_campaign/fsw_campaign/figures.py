"""Figures of a campaign's report, as PNG for its page; also as the file ``beside``, if given."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import ceil
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from fsw_analysis.figure_style import Look, legend_below, looks_of, png, sheet
from fsw_analysis.kpi_table import ROWS
from fsw_campaign.statistics import MAIN, Results, Vector

#: ratios of a figure of merit: 5 % quantile, median, 95 % quantile, share below 1 [%]
Spread = tuple[float, float, float, float]
_COLUMNS = 3
#: times outside are drawn up to this multiple of what is allowed, or up to this share of the welds
_WIDEST, _SHOWN_SHARE = 2.0, 0.98
_DPI = 110


def _panels(count: int, draw: Callable[[Axes, int], None], beside: Path | None) -> bytes:
    columns = min(count, _COLUMNS)
    rows = ceil(count / columns)
    with sheet(4.0 * columns, 3.0 * rows + 0.4) as figure:
        for i in range(count):
            draw(figure.add_subplot(rows, columns, i + 1), i)
        legend_below(figure, figure.axes[:1], 2 * columns)
        return png(figure, _DPI, beside)


def _steps(axes: Axes, values: Vector, label: str, look: Look) -> None:
    """Share of the welds up to each value."""
    if values.size:
        shares = np.linspace(0.0, 100.0, values.size)
        axes.step(np.sort(values), shares, where="post", label=label, **look.line)


def ratios(
    spreads: Mapping[str, Mapping[str, Spread]], first: str, beside: Path | None = None
) -> bytes:
    """Ratios to the first controller's figures: median, and 5 to 95 % of the plants."""
    labels = list(dict.fromkeys(label for of in spreads.values() for label in of))
    with sheet(8.0, 1.2 + 0.42 * len(spreads)) as figure:
        axes = figure.subplots()
        for i, (label, look) in enumerate(zip(labels, looks_of(labels), strict=True)):
            rows = [row for row, of in enumerate(spreads.values()) if label in of]
            quantiles = np.array([of[label][:3] for of in spreads.values() if label in of])
            low, middle, high = quantiles.T
            axes.errorbar(
                middle,
                np.add(rows, 0.22 * (i - 0.5 * (len(labels) - 1))),
                xerr=(middle - low, high - middle),
                label=label,
                capsize=2.0,
                **look.point | {"linestyle": "none", "markersize": 5.0},
            )
        axes.axvline(1.0, color="0.4", lw=0.8)
        axes.set_yticks(range(len(spreads)), list(spreads))
        axes.set(
            xscale="log",
            xlabel=f"ratio to {first} on the same plant",
            ylim=(len(spreads) - 0.5, -0.5),
        )
        axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0), numticks=8))
        axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axes.xaxis.set_minor_formatter(NullFormatter())
        legend_below(figure)
        return png(figure, _DPI, beside)


def times_outside(results: Results, beside: Path | None = None) -> bytes | None:
    """Distributions of the time outside each limit that any weld leaves; None if there is none."""
    times_of = {
        signal: [results.numbers(f"outside_{signal}_s", label) for label in results.labels]
        for signal in results.campaign.limits
    }
    signals = [signal for signal, times in times_of.items() if np.max(times) > 0.0]

    def draw(axes: Axes, i: int) -> None:
        signal = signals[i]
        at_most_s = results.campaign.limits[signal].at_most_s
        looks = looks_of(results.labels)
        for label, times, look in zip(results.labels, times_of[signal], looks, strict=True):
            _steps(axes, times, label, look)
        shown_s = max(_WIDEST * at_most_s, float(np.quantile(times_of[signal], _SHOWN_SHARE)))
        axes.set_xlim(0.0, shown_s or None)
        axes.axvline(at_most_s, color="0.4", lw=0.8)
        axes.set(title=signal, xlabel="time outside [s]", ylabel="welds up to [%]")
        axes.title.set_fontsize("medium")

    return _panels(len(signals), draw, beside) if signals else None


def sensitivities(results: Results, beside: Path | None = None) -> bytes | None:
    """Rank correlations and first-order indices of the main figures.

    None where no parameter is a number.
    """
    cases = [(key, label) for key in MAIN for label in results.labels]
    indices = [results.sensitivities(key, label) for key, label in cases]
    if not indices[0]:
        return None
    values = np.array([list(case.values()) for case in indices]).T  # (2, parameters, cases)
    names = [name.removeprefix("plant.") for name in indices[0]]
    bounds = results.chance
    titles = ("rank correlation", "share of the variance (first-order index)")
    rows = (names, [*names, "together"])
    panels = [values[0], np.vstack([values[1], values[1].sum(axis=0)])]
    with sheet(3.6 + 1.15 * len(cases), 1.8 + 0.34 * len(names)) as figure:
        for i, (axes, panel) in enumerate(zip(figure.subplots(1, 2), panels, strict=True)):
            axes.imshow(
                panel,
                cmap="RdBu_r" if i == 0 else "Reds",
                vmin=-1.0 if i == 0 else 0.0,
                vmax=1.0,
                aspect="auto",
            )
            axes.grid(visible=False)
            labels = [f"{ROWS[key][0]}, {label}" for key, label in cases]
            axes.set_xticks(range(len(cases)), labels, rotation=35, ha="right")
            axes.set_yticks(range(len(panel)), rows[i])
            axes.tick_params(labelsize="small")
            axes.set_title(titles[i], fontsize="medium")
            for (row, column), value in np.ndenumerate(panel):
                if np.isfinite(value):
                    shade = (
                        "white"
                        if abs(value) > 0.6
                        else "black"
                        if abs(value) > bounds[i]
                        else "0.7"
                    )
                    axes.text(
                        column,
                        row,
                        f"{value:.2f}",
                        ha="center",
                        va="center",
                        fontsize=7,
                        color=shade,
                    )
        return png(figure, _DPI, beside)
