"""Report of an identification on one page, as HTML: one figure, statistics and tables."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fsw_analysis.figure_style import COLOURS, OTHERS, label_time, png, sheet
from fsw_analysis.report import page, source
from fsw_control.weld import TICK_S
from fsw_identification.estimation import Fit
from fsw_identification.statistics import LAGS, Judgement
from fsw_identification.summary import NAMES, Summary, output_rows, parameter_rows, remarks

_BELOW: dict[str, Any] = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.3), "frameon": False}
_DPI = 110


def write(result: Summary, folder: Path, ending: str = "png") -> list[Path]:
    """Write ``report.html``, a single file, and its figure in a format; returns the paths."""
    picture, written = folder / f"report.{ending}", folder / "report.html"
    text = page(
        "fsw_identification",
        "report.html.j2",
        sources=result.sources,
        parameters=parameter_rows(result),
        outputs=output_rows(result),
        remarks=remarks(result),
        image=source(_draw(result, picture)),
    )
    written.write_text(text, encoding="utf-8")
    return [written, picture]


def _draw(result: Summary, path: Path) -> bytes:
    columns = 3 if result.validation is not None else 2
    with sheet(6.5 * columns, 13.0) as figure:
        figure.suptitle(
            f"Model identified from {result.sources}", fontsize=12.0, fontweight="bold"
        )
        grid = figure.subplots(5, columns, squeeze=False)
        _courses(list(grid[:, 0]), result.fit, result.judgement, "data")
        if result.validation is not None and result.checked is not None:
            _courses(list(grid[:, 1]), result.validation, result.checked, "validation")
        _statistics(list(grid[:3, -1]), result.judgement)
        _deviations(grid[3, -1], result.fit)
        _correlation(figure, grid[4, -1], result.fit)
        return png(figure, _DPI, path)


def _courses(axes: Sequence[Axes], fit: Fit, judgement: Judgement, what: str) -> None:
    """Measured and model outputs, force and speed, of all segments one after the other."""
    begin_s = 0.0
    for i, segment in enumerate(fit.segments):
        time_s = begin_s + TICK_S * np.arange(segment.n_ticks)
        begin_s = time_s[-1] + 10.0
        for output in range(3):
            measured = segment.measured[:, output]
            axes[output].plot(
                time_s, measured, color=COLOURS[5], alpha=0.5, linewidth=0.7, label="measured"
            )
            axes[output].plot(time_s, fit.predicted[i][:, output], color=COLOURS[0], label="model")
        axes[3].plot(time_s, segment.force_kn, color=COLOURS[1])
        axes[4].plot(time_s, segment.speed_rpm, color=COLOURS[1])
    for shift, _, _ in fit.shifts:
        axes[min(shift.output, 2)].axvline(TICK_S * shift.tick, color=COLOURS[4], linestyle="--")
    titles = [
        f"{name}, {what}: fit {judgement.fit_percent[i]:.1f} %" for i, name in enumerate(NAMES)
    ]
    for axis, title in zip(axes, [*titles, "force [kN]", "speed [rpm]"], strict=True):
        axis.set_title(title, loc="left", fontsize=10.0)
        axis.ticklabel_format(axis="y", useOffset=False)
        axis.margins(x=0.01)
    label_time(axes[4], begin_s)
    axes[4].legend(handles=axes[0].get_lines()[:2], ncols=2, **_BELOW)


def _statistics(axes: Sequence[Axes], judgement: Judgement) -> None:
    """Autocorrelation of the residuals and cross-correlation with input changes, 99 % bounds."""
    both_s = TICK_S * np.arange(-LAGS, LAGS + 1)
    for output, axis in enumerate(axes):
        axis.axhspan(-judgement.bound, judgement.bound, color="black", alpha=0.12, linewidth=0.0)
        axis.plot(
            both_s[LAGS + 1 :], judgement.auto[output], color=COLOURS[0], label="with themselves"
        )
        for which, name in enumerate(("changes of force", "changes of speed")):
            axis.plot(
                both_s,
                judgement.cross[output, which],
                **OTHERS[1 + which].line,
                linewidth=0.8,
                label=f"with {name}",
            )
        axis.set_title(
            f"{NAMES[output]}: correlation of whitened residuals, "
            "bounds of 99 % (left of 0: feedback)",
            loc="left",
            fontsize=9.0,
        )
        low, high = axis.get_ylim()
        axis.set_ylim(min(low, -0.15), max(high, 0.15))
        axis.margins(x=0.01)
    axes[-1].set_xlabel("lag [s]")
    axes[-1].legend(ncols=3, **_BELOW)


def _deviations(axis: Axes, fit: Fit) -> None:
    """Relative standard deviation of each parameter in percent."""
    share = 100.0 * np.sqrt(np.diag(fit.covariance))
    axis.barh(range(len(fit.free)), share, color=COLOURS[0])
    axis.set_yticks(range(len(fit.free)), fit.free, fontsize=8.0)
    axis.invert_yaxis()
    axis.set_title("standard deviation [%]", loc="left", fontsize=10.0)


def _correlation(figure: Figure, axis: Axes, fit: Fit) -> None:
    image = axis.imshow(fit.correlation, vmin=-1.0, vmax=1.0, cmap="RdBu_r", aspect="auto")
    axis.set_yticks(range(len(fit.free)), fit.free, fontsize=8.0)
    axis.set_xticks([])
    axis.grid(False)
    axis.set_title("correlation of the estimates, same order", loc="left", fontsize=10.0)
    figure.colorbar(image, ax=axis)
