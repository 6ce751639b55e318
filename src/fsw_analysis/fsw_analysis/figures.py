"""The paper's figures from the signals of one or more welds, as PNG, SVG or PDF."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fsw_analysis.changes import changes, marks
from fsw_analysis.figure_style import (
    CONTROLLERS,
    STYLE,
    Look,
    label_time,
    legend_below,
    looks_of,
    shade_phases,
    sheet,
)
from fsw_analysis.kpi import DEAD_BAND_DEPTH_MM, DEAD_BAND_TEMPERATURE_C
from fsw_analysis.phase_kpi import Span
from fsw_analysis.weld_signals import FloatArray, WeldSignals
from fsw_control.contract import Limits
from fsw_control.sensors import SENSORS

_REFERENCE: dict[str, Any] = {"color": "black", "linewidth": 1.2, "linestyle": (0, (1, 1))}
_LIMIT: dict[str, Any] = {"color": "firebrick", "linewidth": 1.0, "linestyle": (0, (9, 2, 1, 2))}
_SWAP: dict[str, Any] = {"color": "dimgray", "linewidth": 0.9, "linestyle": "-."}
#: what happens in a weld, on the upper edge of every axis
_MARKS: dict[str, dict[str, Any]] = {
    "set-point": {"marker": "v", "color": "black", "markersize": 7.0},
    "disturbance": {"marker": "d", "color": "darkorange", "markersize": 5.5},
    "fault on, off": {
        "marker": "x",
        "color": "firebrick",
        "markersize": 6.0,
        "markeredgewidth": 1.6,
    },
}
#: height of the strip that shows the active controller, as a share of the axis
_STRIP = 0.035
#: more marks of one kind would hide the axis
_MOST_MARKS = 20
#: widths of the lowest and the uppermost of several lines, so that each is seen where they
#: coincide
_LINE_WIDTHS = (2.4, 1.1)
#: page: width of one column, height of one panel, of the title and of a row of the legend [inch]
_WIDTH, _PANEL, _TITLE, _LEGEND = 9.0, 2.25, 0.6, 0.6
#: width of a change's size, as a share of the axis; rows of them below the marks, and their height
#: [points]
_SIZE_WIDTH, _SIZE_ROWS, _SIZE_HEIGHT = 0.12, 3, 9.0
#: share of the data's span that is left free above and below
_MARGIN = 0.07
#: a limit is drawn when it is nearer to the data than this share of their span
_NEAR = 0.4


@dataclass(frozen=True, slots=True)
class Run:
    """A weld to draw, with its name in the legend."""

    label: str
    signals: WeldSignals


@dataclass(frozen=True, slots=True)
class _Panel:
    """One axis: a quantity and its properties.

    ``error`` has the dead-band, the half-height and the factor of an axis that shows the error of
    an output instead, at a scale at which the dead-band is visible.
    """

    title: str
    ylabel: str
    quantity: str
    smallest_span: float = 0.0
    sensor: str = ""
    reference: str = ""
    limits: tuple[float, float] | None = None
    error: tuple[float, float, float] | None = None

    @property
    def is_input(self) -> bool:
        """Whether it is a manipulated variable, which is held for a tick."""
        return self.quantity in ("force_kn", "speed_rpm")


_LIMITS = Limits()
_DEAD_BANDS = f"dead-band (±{1e3 * DEAD_BAND_DEPTH_MM:g} µm, ±{DEAD_BAND_TEMPERATURE_C:g} °C)"
_FREE_DEPTH = _Panel("Shoulder depth", "depth [mm]", "depth_mm", 0.02, sensor="depth_mm")
_FREE_TEMPERATURE = _Panel(
    "Stir-zone temperature", "temperature [°C]", "temperature_c", 1.0, sensor="temperature_c"
)
_DEPTH = replace(_FREE_DEPTH, reference="reference_depth_mm")
_TEMPERATURE = replace(_FREE_TEMPERATURE, reference="reference_temperature_c")
_DEPTH_ERROR = replace(
    _DEPTH,
    title="Depth error, close up",
    ylabel="error [µm]",
    error=(DEAD_BAND_DEPTH_MM, 20.0, 1e3),
)
_TEMPERATURE_ERROR = replace(
    _TEMPERATURE,
    title="Temperature error, close up",
    ylabel="error [°C]",
    error=(DEAD_BAND_TEMPERATURE_C, 1.0, 1.0),
)
_FORCE = _Panel(
    "Axial force",
    "force [kN]",
    "force_kn",
    0.5,
    limits=(_LIMITS.force_min_kn, _LIMITS.force_max_kn),
)
_SPEED = _Panel(
    "Spindle speed",
    "speed [rpm]",
    "speed_rpm",
    2.0,
    limits=(_LIMITS.speed_min_rpm, _LIMITS.speed_max_rpm),
)
_TORQUE = _Panel(
    "Spindle motor torque", "torque [N·m]", "motor_torque_nm", 10.0, sensor="torque_nm"
)
_POWER = _Panel("Power into the copper", "power [kW]", "process_power_kw", 0.5)
_OUTPUTS = (_DEPTH, _DEPTH_ERROR, _TEMPERATURE, _TEMPERATURE_ERROR)
_INPUTS = (_FORCE, _SPEED, _POWER)
#: as the paper draws open-loop experiments: the response above, force and speed below
_OPEN_LOOP = (_FREE_DEPTH, _TORQUE, _POWER, _FREE_TEMPERATURE, _FORCE, _SPEED)
_OVERVIEW = (_DEPTH, _TEMPERATURE, _FORCE, _SPEED, _TORQUE, _POWER)
#: title, panels and columns of each page by the number of its figure; None: the overview
_FIGURES: dict[int | None, tuple[str, tuple[_Panel, ...], int]] = {
    4: ("Fig. 4: axial force steps, open loop", _OPEN_LOOP, 1),
    5: ("Fig. 5: axial force and spindle speed steps, open loop", _OPEN_LOOP, 1),
    6: ("Fig. 6: reference tracking, controlled outputs", _OUTPUTS, 1),
    7: ("Fig. 7: reference tracking, manipulated variables", _INPUTS, 1),
    8: ("Fig. 8: output disturbances, controlled outputs", _OUTPUTS, 1),
    9: ("Fig. 9: output disturbances, manipulated variables", _INPUTS, 1),
    None: ("Overview", _OVERVIEW, 2),
}
#: numbers of the paper's figures that `page` draws
PAPER_FIGURES = tuple(filter(None, _FIGURES))
_WHOLE_WELD = (
    _DEPTH,
    _TEMPERATURE,
    replace(_DEPTH_ERROR, error=(DEAD_BAND_DEPTH_MM, 60.0, 1e3)),
    replace(_TEMPERATURE_ERROR, error=(DEAD_BAND_TEMPERATURE_C, 2.0, 1.0)),
    *_OVERVIEW[2:],
)


def draw(
    runs: Sequence[Run],
    numbers: Sequence[int],
    folder: Path,
    name: str = "",
    ending: str = "png",
) -> list[Path]:
    """Draw figures of the paper (``numbers``, 4 to 9) and an overview; returns the files.

    At least one run is needed; they are overlaid, with the references of the first. ``name``, of
    the scenario, goes into the titles and before the files' names; ``ending``: png, svg or pdf.
    """
    prefix, suffix = (f"{name}_", f" ({name})") if name else ("", "")
    stems = {number: f"fig{number}" for number in numbers} | {None: "overview"}
    paths = {number: folder / f"{prefix}{stem}.{ending}" for number, stem in stems.items()}
    for number, path in paths.items():
        page(runs, number, _FIGURES[number][0] + suffix, path)
    return [*paths.values()]


def page(
    runs: Sequence[Run], number: int | None = None, title: str = "", path: Path | None = None
) -> Figure:
    """A figure of the paper (4 to 9) or an overview, shown or in a file; see :func:`draw`."""
    name, panels, columns = _FIGURES[number]
    return _draw_page(runs, title or name, panels, columns, path)


def draw_whole_weld(runs: Sequence[Run], phases: Sequence[Span], title: str, path: Path) -> None:
    """Draw a weld in phases on one page: outputs, their errors, inputs, torque and power."""
    _draw_page(runs, title, _WHOLE_WELD, 2, path, phases)


def _draw_page(
    runs: Sequence[Run],
    title: str,
    panels: Sequence[_Panel],
    columns: int,
    path: Path | None = None,
    phases: Sequence[Span] = (),
) -> Figure:
    rows = -(-len(panels) // columns)
    width = _WIDTH * (1.35 if columns > 1 else 1.0)
    with sheet(width, _TITLE + _LEGEND + _PANEL * rows, path) as figure:
        grid = figure.subplots(rows, columns, sharex=True, squeeze=False)
        axes = list(grid.flat)
        figure.suptitle(title, fontsize=12.0, fontweight="bold")
        for axis, panel in zip(axes, panels, strict=True):
            axis.set_title(panel.title, loc="left", fontsize=10.0)
            axis.set_ylabel(panel.ylabel)
            draw_runs = _draw_panel if panel.error is None else _draw_error
            draw_runs(axis, panel, runs)
        _mark_events(axes, runs)
        for axis, panel in zip(axes, panels, strict=True):
            _mark_sizes(axis, panel, runs[0].signals)
        if len(runs) == 1:
            _mark_swaps(axes, runs[0].signals)
        shade_phases(axes, phases)
        for axis in grid[-1]:
            label_time(axis, axis.get_xlim()[1])
        legend_below(figure)
    return figure


def _draw_panel(axis: Axes, panel: _Panel, runs: Sequence[Run]) -> None:
    shown: list[FloatArray] = []
    first = runs[0].signals
    reference = getattr(first, panel.reference) if panel.reference else np.empty(0)
    if np.isfinite(reference).any():
        axis.step(first.time_s, reference, where="post", label="reference", **_REFERENCE)
        shown.append(reference)
    pale: dict[str, Any] = {"linewidth": 0.7}
    if len(runs) == 1:
        for label, values in _others(first, panel).items():
            axis.plot(first.time_s, values, alpha=0.7, label=label, **pale)
            shown.append(values)
        sensed = _sensed(first, panel)
        if sensed is not None and _values(first, panel) is not None:
            pale |= {"alpha": 0.35, "label": "sensor", "color": _looks(runs)[0].colour}
            axis.plot(first.time_s, sensed, **pale)
            shown.append(sensed)
    curves = [_curve(run.signals, panel) for run in runs]
    _draw_curves(axis, panel, runs, curves)
    _scale(axis, panel, shown + curves)


def _sensed(signals: WeldSignals, panel: _Panel) -> FloatArray | None:
    return getattr(signals, panel.sensor) if panel.sensor else None


def _curve(signals: WeldSignals, panel: _Panel) -> FloatArray:
    """True values if the bag has them, else the sensor's; NaN without either."""
    known = (_values(signals, panel), _sensed(signals, panel))
    return next((c for c in known if c is not None), np.full(signals.n_ticks, np.nan))


def _others(signals: WeldSignals, panel: _Panel) -> dict[str, FloatArray]:
    """Optional sensors of the panel's quantity that the weld has, by title."""
    rows = (row for row in SENSORS.values() if row.quantity.signal == panel.sensor)
    return {
        row.title: signals.optional[row.signal] for row in rows if row.signal in signals.optional
    }


def _looks(runs: Sequence[Run]) -> list[Look]:
    """Look of each run: by its label if it names a controller, else by the active controller."""
    names = []
    for run in runs:
        sources = set(run.signals.command_source) - {""}
        names.append(run.label if run.label in CONTROLLERS or len(sources) != 1 else sources.pop())
    return looks_of(names)


def _draw_curves(
    axis: Axes, panel: _Panel, runs: Sequence[Run], curves: Sequence[FloatArray]
) -> None:
    """Draw a curve of each run, the most active lowest and widest, so that all stay visible."""
    widths = np.linspace(*_LINE_WIDTHS, len(runs)) if len(runs) > 1 else [STYLE["lines.linewidth"]]
    ranks = np.argsort(np.argsort([-_restlessness(run.signals) for run in runs], kind="stable"))
    for run, values, look, rank in zip(runs, curves, _looks(runs), ranks.tolist(), strict=True):
        style = {
            **look.line,
            "label": run.label,
            "linewidth": widths[rank],
            "zorder": 2.0 + 0.1 * rank,
        }
        _line(axis, panel, run.signals.time_s, values, **style)


def _restlessness(signals: WeldSignals) -> float:
    """Change of the moves of both manipulated variables from tick to tick, in their limits."""
    moves = (signals.force_kn / _LIMITS.force_step_kn, signals.speed_rpm / _LIMITS.speed_step_rpm)
    return float(sum(np.nansum(np.abs(np.diff(values, n=2))) for values in moves))


def _mark_events(axes: Sequence[Axes], runs: Sequence[Run]) -> None:
    """Mark the events of all runs: a sign on the upper edge of each axis and a thin line."""
    marks_of_runs = [marks(run.signals) for run in runs]
    for kind, style in _MARKS.items():
        times_s = sorted(
            {round(time_s, 3) for by_kind in marks_of_runs for time_s in by_kind[kind]}
        )
        if not 0 < len(times_s) <= _MOST_MARKS:
            continue
        for axis in axes:
            across: dict[str, Any] = {
                "transform": axis.get_xaxis_transform(),
                "clip_on": False,
                "zorder": 4.0,
            }
            axis.plot(
                times_s, [1.0] * len(times_s), linestyle="none", label=kind, **style, **across
            )
            for time_s in times_s:
                axis.axvline(time_s, color=style["color"], alpha=0.4, linewidth=0.8, zorder=1.0)


def _mark_sizes(axis: Axes, panel: _Panel, signals: WeldSignals) -> None:
    """Write the size of each change of the panel's set-point or disturbance below its mark.

    Where changes crowd their sizes stand in rows below each other; the axis gets room for them.
    """
    quantity = panel.quantity.rpartition("_")[0]
    unit = panel.ylabel.partition("[")[2].rstrip("]")
    if panel.error is not None or not panel.reference:
        return
    sizes = [
        change
        for change in changes(signals)
        if change.quantity == f"{quantity}_reference"
        or (change.is_step and change.quantity == f"{quantity}_disturbance")
    ]
    begin_s, span_s = signals.time_s[0], signals.time_s[-1] - signals.time_s[0]
    ends = [-1.0] * _SIZE_ROWS
    for change in sizes if len(sizes) <= _MOST_MARKS else ():
        at_s = float(signals.time_s[change.begin])
        place = (at_s - begin_s) / span_s
        is_late = place > 1.0 - _SIZE_WIDTH
        begin = place - _SIZE_WIDTH if is_late else place
        row = next((row for row, end in enumerate(ends) if begin >= end), None)
        if row is None:
            continue
        ends[row] = begin + _SIZE_WIDTH
        text = f"{change.size:+.3g} {unit}".replace("-", "−")
        offset = -4.0 if is_late else 4.0, -5.0 - _SIZE_HEIGHT * row
        style: dict[str, Any] = {
            "xycoords": ("data", "axes fraction"),
            "va": "top",
            "ha": "right" if is_late else "left",
            "fontsize": 7.5,
            "bbox": {"facecolor": "white", "alpha": 0.7, "linewidth": 0.0, "pad": 0.5},
        }
        axis.annotate(text, (at_s, 1.0), offset, textcoords="offset points", **style)
    if rows := sum(end >= 0.0 for end in ends):  # room above the curves
        low, high = axis.get_ylim()
        share = _SIZE_HEIGHT * (1 + rows) / (72.0 * _PANEL)
        axis.set_ylim(low, high + share * (high - low))


def _line(axis: Axes, panel: _Panel, time_s: FloatArray, values: FloatArray, **style: Any) -> None:
    axis.plot(time_s, values, drawstyle="steps-post" if panel.is_input else "default", **style)


def _draw_error(axis: Axes, panel: _Panel, runs: Sequence[Run]) -> None:
    band, span, factor = panel.error or (0.0, 1.0, 1.0)
    curves = [
        factor * (_curve(run.signals, panel) - getattr(run.signals, panel.reference))
        for run in runs
    ]
    _draw_curves(axis, panel, runs, curves)
    axis.axhspan(
        -factor * band, factor * band, color="black", alpha=0.15, linewidth=0.0, label=_DEAD_BANDS
    )
    axis.set_ylim(-span, span)
    axis.margins(x=0.01)


def _mark_swaps(axes: Sequence[Axes], signals: WeldSignals) -> None:
    """Mark swaps by lines, and the active controller by a coloured strip."""
    source, time_s = signals.command_source, signals.time_s
    names = [name for name in dict.fromkeys(source) if name]
    if len(names) < 2:
        return
    swaps = np.flatnonzero(source[1:] != source[:-1]) + 1
    for axis in axes:
        for name, look in zip(names, looks_of(names), strict=True):
            across: dict[str, Any] = {"transform": axis.get_xaxis_transform(), **look.bar}
            axis.fill_between(
                time_s,
                0.0,
                _STRIP,
                where=source == name,
                step="post",
                label=f"{name} commands",
                **across,
            )
        for tick in swaps if swaps.size <= _MOST_MARKS else ():
            axis.axvline(time_s[tick], label="swap", **_SWAP)


def _values(signals: WeldSignals, panel: _Panel) -> FloatArray | None:
    """True values if the bag has them; else applied commands of inputs, None of others."""
    if panel.is_input:
        command: FloatArray = getattr(signals, panel.quantity)
        return command
    values = getattr(signals.truth, panel.quantity) if signals.truth is not None else np.empty(0)
    return values if np.isfinite(values).any() else None


def _scale(axis: Axes, panel: _Panel, shown: list[FloatArray]) -> None:
    """Scale to the data, but not so far that noise fills the axis.

    Limits are drawn if they are near.
    """
    known = (
        np.concatenate([values[np.isfinite(values)] for values in shown]) if shown else np.empty(0)
    )
    if not known.size:
        axis.text(
            0.5,
            0.5,
            "not in this bag",
            transform=axis.transAxes,
            ha="center",
            va="center",
            color="gray",
        )
        return
    span = max(float(np.ptp(known)), panel.smallest_span)
    middle = 0.5 * float(known.min() + known.max())
    low, high = middle - (0.5 + _MARGIN) * span, middle + (0.5 + _MARGIN) * span
    axis.ticklabel_format(axis="y", useOffset=False)
    for limit in panel.limits or ():
        if low - _NEAR * span <= limit <= high + _NEAR * span:
            axis.axhline(limit, label="limit", **_LIMIT)
            low, high = min(low, limit - _MARGIN * span), max(high, limit + _MARGIN * span)
    if panel.limits and not any(low <= limit <= high for limit in panel.limits):
        text = f"limits {panel.limits[0]:g} and {panel.limits[1]:g} out of view"
        axis.set_title(text, loc="right", fontsize=8.0, color="firebrick")
    axis.set_ylim(low, high)
    axis.margins(x=0.01)
