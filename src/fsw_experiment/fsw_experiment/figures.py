"""The paper's figures from the signals of one or more welds, as PNG files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fsw_control.contract import Limits
from fsw_experiment.kpi import DEAD_BAND_DEPTH_MM, DEAD_BAND_TEMPERATURE_C
from fsw_experiment.weld_events import experiment_time_s
from fsw_recorder.weld_signals import WeldSignals

COLOURS = ("#0b62a4", "#d1495b", "#2e8540", "#8d5fd3", "#e08214", "#444444")
_STYLE = {
    "font.size": 10.0,
    "axes.grid": True,
    "grid.alpha": 0.3,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "figure.dpi": 110,
    "lines.linewidth": 1.4,
    "axes.axisbelow": True,
}
_REFERENCE: dict[str, Any] = {"color": "black", "linewidth": 1.1, "linestyle": "--"}
_LIMIT: dict[str, Any] = {"color": "firebrick", "linewidth": 1.0, "linestyle": ":"}
_SWAP: dict[str, Any] = {"color": "dimgray", "linewidth": 0.9, "linestyle": "-."}
_MOST_SWAPS = 20

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Run:
    """A weld to draw, under the name that the legend gives it."""

    label: str
    signals: WeldSignals


@dataclass(frozen=True, slots=True)
class _Panel:
    """One axis: the quantity and whatever belongs into its picture."""

    title: str
    ylabel: str
    quantity: str
    reference: str = ""
    band: float = 0.0
    limits: tuple[float, float] | None = None
    smallest_span: float = 0.0
    sensor: str = ""
    error_span: float = 0.0
    factor: float = 1.0


_DEPTH = _Panel(
    "Shoulder depth", "depth [mm]", "depth_mm", "reference_depth_mm", DEAD_BAND_DEPTH_MM, None, 0.02, "depth_mm"
)
_TEMPERATURE = _Panel(
    "Stir-zone temperature",
    "temperature [°C]",
    "temperature_c",
    "reference_temperature_c",
    DEAD_BAND_TEMPERATURE_C,
    None,
    1.0,
    "temperature_c",
)
_DEPTH_ERROR = _Panel(
    "Depth error, close up",
    "error [µm]",
    "depth_mm",
    "reference_depth_mm",
    DEAD_BAND_DEPTH_MM,
    error_span=20.0,
    factor=1e3,
)
_TEMPERATURE_ERROR = _Panel(
    "Temperature error, close up",
    "error [°C]",
    "temperature_c",
    "reference_temperature_c",
    DEAD_BAND_TEMPERATURE_C,
    error_span=1.0,
)
_DEPTH_FREE = replace(_DEPTH, reference="")
_TEMPERATURE_FREE = replace(_TEMPERATURE, reference="")
_LIMITS = Limits()
_FORCE = _Panel(
    "Axial force", "force [kN]", "force_kn", limits=(_LIMITS.force_min_kn, _LIMITS.force_max_kn), smallest_span=0.5
)
_SPEED = _Panel(
    "Spindle speed",
    "speed [rpm]",
    "speed_rpm",
    limits=(_LIMITS.speed_min_rpm, _LIMITS.speed_max_rpm),
    smallest_span=2.0,
)
_TORQUE = _Panel("Spindle motor torque", "torque [N·m]", "motor_torque_nm", smallest_span=10.0, sensor="torque_nm")
_POWER = _Panel("Power into the copper", "power [kW]", "process_power_kw", smallest_span=0.5)

_FIGURES: dict[int, tuple[str, tuple[_Panel, ...]]] = {
    4: ("Fig. 4: axial force steps, open loop", (_FORCE, _DEPTH_FREE, _TORQUE, _TEMPERATURE_FREE)),
    5: ("Fig. 5: spindle speed steps, open loop", (_SPEED, _TORQUE, _POWER, _TEMPERATURE_FREE)),
    6: ("Fig. 6: reference tracking, controlled outputs", (_DEPTH, _DEPTH_ERROR, _TEMPERATURE, _TEMPERATURE_ERROR)),
    7: ("Fig. 7: reference tracking, handles", (_FORCE, _SPEED, _POWER)),
    8: ("Fig. 8: output disturbances, controlled outputs", (_DEPTH, _DEPTH_ERROR, _TEMPERATURE, _TEMPERATURE_ERROR)),
    9: ("Fig. 9: output disturbances, handles", (_FORCE, _SPEED, _POWER)),
}
_OVERVIEW = (_DEPTH, _TEMPERATURE, _FORCE, _SPEED, _TORQUE, _POWER)


def draw(runs: Sequence[Run], numbers: Sequence[int], folder: Path, name: str = "") -> list[Path]:
    """Draw figures of the paper and an overview of everything.

    Parameters
    ----------
    runs : sequence of Run
        Welds to overlay; the references of the first are drawn.
    numbers : sequence of int
        Which of the figures 4 to 9.
    folder : Path
        Where to write ``fig<number>.png`` and ``overview.png``; must exist.
    name : str
        Of the scenario: goes into the titles and before the files' names.

    Returns
    -------
    list of Path
        The files.

    Raises
    ------
    ValueError
        If there is nothing to draw or a figure's number is unknown.
    """
    if not runs:
        raise ValueError("figures: no run to draw")
    unknown = [number for number in numbers if number not in _FIGURES]
    if unknown:
        raise ValueError(f"figures: there is no figure {unknown[0]}; known: {', '.join(map(str, _FIGURES))}")
    prefix = f"{name}_" if name else ""
    pages = [(f"{prefix}fig{number}.png", *_FIGURES[number], 1) for number in numbers]
    pages.append((f"{prefix}overview.png", "Overview", _OVERVIEW, 2))
    paths: list[Path] = []
    with matplotlib.rc_context(_STYLE):
        for file, title, panels, columns in pages:
            path = folder / file
            _page(runs, f"{title} ({name})" if name else title, panels, columns, path)
            paths.append(path)
    return paths


def _page(runs: Sequence[Run], title: str, panels: Sequence[_Panel], columns: int, path: Path) -> None:
    rows = -(-len(panels) // columns)
    figure = Figure(figsize=(9.0 * (1.35 if columns > 1 else 1.0), 0.9 + 2.25 * rows), layout="constrained")
    axes = figure.subplots(rows, columns, sharex=True, squeeze=False)
    for i, panel in enumerate(panels):
        _draw_panel(axes[i // columns][i % columns], panel, runs)
    if len(runs) == 1:
        _mark_swaps(list(axes.flat), runs[0].signals)
    for i in range(columns):
        axes[-1][i].set_xlabel("time [s]")
    figure.suptitle(title, fontsize=12.0, fontweight="bold")
    handles, labels = [], []
    for axis in axes.flat:
        for handle, label in zip(*axis.get_legend_handles_labels(), strict=True):
            if label not in labels:
                handles.append(handle)
                labels.append(label)
    figure.legend(handles, labels, loc="outside lower center", ncols=min(len(labels), 5), frameon=False)
    figure.savefig(path)


def _draw_panel(axis: Axes, panel: _Panel, runs: Sequence[Run]) -> None:
    axis.set_title(panel.title, loc="left", fontsize=10.0)
    axis.set_ylabel(panel.ylabel)
    if panel.error_span:
        _draw_error(axis, panel, runs)
        return
    shown: list[FloatArray] = []
    if panel.reference:
        shown += _draw_reference(axis, panel, runs[0].signals)
    for i, run in enumerate(runs):
        colour = COLOURS[i % len(COLOURS)]
        true, time_s = _values(run.signals, panel.quantity), experiment_time_s(run.signals)
        sensed = getattr(run.signals, panel.sensor) if panel.sensor else None
        if sensed is not None and true is None:
            axis.plot(time_s, sensed, color=colour, label=run.label)
            shown.append(sensed)
        elif sensed is not None and len(runs) == 1:
            axis.plot(time_s, sensed, color=colour, alpha=0.35, linewidth=0.7, label="sensor")
            shown.append(sensed)
        if true is not None:
            held = panel.quantity in ("force_kn", "speed_rpm")
            axis.plot(time_s, true, color=colour, label=run.label, drawstyle="steps-post" if held else "default")
            shown.append(true)
    _scale(axis, panel, shown)


def _mark_swaps(axes: Sequence[Axes], signals: WeldSignals) -> None:
    """Lines where the command's source changes, with its name on the first axis."""
    source, time_s = signals.command_source, experiment_time_s(signals)
    changes = np.flatnonzero(source[1:] != source[:-1]) + 1
    if not changes.size or changes.size > _MOST_SWAPS:
        return
    for axis in axes:
        for tick in changes:
            axis.axvline(time_s[tick], label="other source of the command", **_SWAP)
    top = axes[0].get_xaxis_transform()
    for tick in (0, *changes):
        axes[0].text(
            time_s[tick], 0.98, source[tick], transform=top, va="top", rotation=90, fontsize=8.0, color="dimgray"
        )


def _draw_reference(axis: Axes, panel: _Panel, signals: WeldSignals) -> list[FloatArray]:
    reference: FloatArray = getattr(signals, panel.reference)
    if not np.isfinite(reference).any():
        return []
    axis.step(experiment_time_s(signals), reference, where="post", label="reference", **_REFERENCE)
    return [reference]


def _draw_error(axis: Axes, panel: _Panel, runs: Sequence[Run]) -> None:
    """Error of an output, at a scale at which the dead-band is visible."""
    for i, run in enumerate(runs):
        values = _values(run.signals, panel.quantity)
        values = getattr(run.signals, panel.quantity) if values is None else values
        error = panel.factor * (values - getattr(run.signals, panel.reference))
        axis.plot(experiment_time_s(run.signals), error, color=COLOURS[i % len(COLOURS)], label=run.label)
    band = panel.factor * panel.band
    axis.axhspan(-band, band, color="black", alpha=0.15, linewidth=0.0, label="dead-band (±2 µm, ±0.1 °C)")
    axis.set_ylim(-panel.error_span, panel.error_span)
    axis.margins(x=0.01)


def _values(signals: WeldSignals, quantity: str) -> FloatArray | None:
    """True values where the bag has them, the applied command for the handles, else None."""
    if quantity in ("force_kn", "speed_rpm"):
        values: FloatArray = getattr(signals, quantity)
        return values
    if signals.truth is None:
        return None
    return getattr(signals.truth, quantity) if np.isfinite(getattr(signals.truth, quantity)).any() else None


def _scale(axis: Axes, panel: _Panel, shown: list[FloatArray]) -> None:
    """Scale to the data, but never so far that noise fills the picture; limits are drawn where they are near."""
    known = [values[np.isfinite(values)] for values in shown]
    known = [values for values in known if values.size]
    if not known:
        axis.text(0.5, 0.5, "not in this bag", transform=axis.transAxes, ha="center", va="center", color="gray")
        return
    low, high = min(float(v.min()) for v in known), max(float(v.max()) for v in known)
    span = max(high - low, panel.smallest_span)
    middle = 0.5 * (low + high)
    low, high = middle - 0.57 * span, middle + 0.57 * span
    axis.ticklabel_format(axis="y", useOffset=False)
    for limit in panel.limits or ():
        if low - 0.4 * span <= limit <= high + 0.4 * span:
            axis.axhline(limit, label="limit", **_LIMIT)
            low, high = min(low, limit - 0.05 * span), max(high, limit + 0.05 * span)
    if panel.limits and not any(low <= limit <= high for limit in panel.limits):
        axis.text(
            0.995,
            1.01,
            f"limits {panel.limits[0]:g} and {panel.limits[1]:g} out of view",
            transform=axis.transAxes,
            ha="right",
            va="bottom",
            fontsize=8.0,
            color="firebrick",
        )
    axis.set_ylim(low, high)
    axis.margins(x=0.01)
