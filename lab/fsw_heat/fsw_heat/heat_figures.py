"""Figure of the heat in a canister.

The outer surface unrolled, the section at the tool, and curves.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse, Rectangle

from fsw_analysis.figure_style import COLOURS, legend_below, looks_of, shade_phases, sheet
from fsw_analysis.phase_kpi import Span
from fsw_heat.heat_model import CanisterState
from fsw_heat.history import HeatHistory

#: isotherms [degC], closer where most of the canister is
LEVELS_C = (
    30,
    40,
    60,
    80,
    100,
    125,
    150,
    175,
    200,
    250,
    300,
    350,
    400,
    500,
    600,
    700,
    800,
    900,
    1000,
)
_LABELLED_C = (40, 60, 100, 150, 200, 300, 400, 500, 600, 700, 800, 900)
_COLOURS = matplotlib.colormaps["inferno"]
_NORM = BoundaryNorm(LEVELS_C, _COLOURS.N, extend="both")
_TOOL: dict[str, Any] = {
    "facecolor": "#9aa3ab",
    "edgecolor": "black",
    "linewidth": 0.7,
    "zorder": 3.0,
}
_JOINT: dict[str, Any] = {
    "color": "white",
    "linewidth": 0.9,
    "linestyle": (0, (6, 4)),
    "zorder": 2.5,
}
_CLAMP: dict[str, Any] = {
    "fill": False,
    "edgecolor": "white",
    "hatch": "////",
    "linewidth": 0.0,
    "alpha": 0.25,
}
#: what is shown: angles of the unrolled surface, from before the start on; lowest height; the
#: section about the tool
_FIRST_DEG, _LOWEST_MM = -60.0, -400.0
_SECTION_MM, _INWARD_MM, _OUTWARD_MM = (-165.0, 10.0), 60.0, 35.0
#: points of the surface, and of each part of the section
_SURFACE, _SECTION = (481, 97), (21, 121)


@dataclass(frozen=True, slots=True)
class HeatPicture:
    """What is drawn."""

    history: HeatHistory
    phases: Sequence[Span]
    title: str
    thermocouples: Mapping[str, Any] = field(
        default_factory=dict
    )  #: temperatures at the kept times, by name


def draw_heat(picture: HeatPicture, moments_s: Sequence[float], path: Path) -> None:
    """Draw stir zone and power over the weld, and surface and section at moments."""
    rows = len(moments_s)
    with sheet(12.0, 4.0 + 1.75 * rows, path) as figure:
        figure.suptitle(picture.title, fontsize=12.0, fontweight="bold")
        grid = figure.add_gridspec(
            2 + rows, 2, width_ratios=(2.7, 1.0), height_ratios=(2.0, 1.0, *[1.5] * rows)
        )
        curves = [figure.add_subplot(grid[i, :]) for i in (0, 1)]
        _draw_curves(curves, picture)
        fields = [
            (figure.add_subplot(grid[2 + i, 0]), figure.add_subplot(grid[2 + i, 1]))
            for i in range(rows)
        ]
        for i, (axes, time_s) in enumerate(zip(fields, moments_s, strict=True)):
            at_s, state = picture.history.at(time_s)
            for axis in curves:
                axis.axvline(at_s / 60.0, color="black", linewidth=0.9, linestyle=":")
            letter = chr(ord("A") + i)
            curves[0].text(
                at_s / 60.0,
                1.0,
                letter,
                transform=curves[0].get_xaxis_transform(),
                ha="center",
                va="bottom",
            )
            _draw_fields(axes, picture.history, state, f"{letter}: {_when(picture, at_s)}")
        _label_below(fields[-1])
        _add_scale(figure, [axis for pair in fields for axis in pair])
        legend_below(figure, curves[:1])


def _when(picture: HeatPicture, at_s: float) -> str:
    """A moment in words: time, phase, stir zone, power."""
    history = picture.history
    phase = next(
        (name for name, begin, end in picture.phases if begin <= at_s < end), picture.phases[-1][0]
    )
    i = max(int(np.searchsorted(history.time_s, at_s + 1e-6)) - 1, 0)
    minutes, seconds = divmod(round(at_s), 60)
    return (
        f"{minutes}:{seconds:02d} min, {phase.replace('_', ' ')}; "
        f"stir zone {history.stir_zone_c[i]:.0f} °C, {history.course.power_kw[i]:.1f} kW"
    )


def _draw_curves(axes: Sequence[Axes], picture: HeatPicture) -> None:
    """Temperatures in the first axis, power in the second."""
    history = picture.history
    minutes = history.time_s / 60.0
    axes[0].plot(minutes, history.stir_zone_c, color="black", label="stir zone")
    names = list(picture.thermocouples)
    for name, look in zip(names, looks_of(names), strict=True):
        axes[0].plot(history.kept_s / 60.0, picture.thermocouples[name], **look.line, label=name)
    axes[0].set_ylabel("temperature [°C]")
    axes[1].plot(minutes, history.course.power_kw, color=COLOURS[0])
    axes[1].set_ylabel("power [kW]")
    axes[0].tick_params(labelbottom=False)
    for axis in axes:
        axis.set_xlim(0.0, minutes[-1])
    axes[-1].set_xlabel("time [min]")
    shade_phases(axes, [(name, begin / 60.0, end / 60.0) for name, begin, end in picture.phases])
    for axis in axes:
        axis.set_ylim(bottom=0.0)


def _draw_fields(
    axes: tuple[Axes, Axes],
    history: HeatHistory,
    state: CanisterState,
    title: str,
) -> None:
    """The outer surface unrolled, and the section at the tool, its outer surface on top."""
    surface, section = axes
    p = history.canister.parameters
    _draw_surface(surface, history, state)
    _draw_section(section, history, state)
    surface.set_title(title, loc="left", fontsize=10.0)
    section.set_title("section at the tool", loc="left", fontsize=10.0)
    surface.set_ylabel("height [mm]")
    section.set_ylabel("radius [mm]")
    for axis in axes:
        axis.grid(False)
    surface.set_aspect(180.0 / np.pi / p.outer_radius_mm, adjustable="box")
    section.set_aspect("equal", adjustable="box")


def _label_below(axes: tuple[Axes, Axes]) -> None:
    axes[0].set_xlabel("angle from the start [°]")
    axes[1].set_xlabel("height above the joint line [mm]")


def _draw_surface(axis: Axes, history: HeatHistory, state: CanisterState) -> None:
    p = history.canister.parameters
    across, up = _SURFACE
    degrees, height = (
        np.linspace(_FIRST_DEG, _FIRST_DEG + 360.0, across),
        np.linspace(max(_LOWEST_MM, -p.tube_mm), p.rim_mm, up),
    )
    field_c = history.canister.temperature_c(
        state, p.outer_radius_mm, np.radians(degrees), height[:, None]
    )
    _isotherms(axis, degrees, height, field_c, _LABELLED_C[1:6])
    axis.axhline(0.0, **_JOINT)
    axis.axhspan(-p.clamp_to_mm, -p.clamp_from_mm, **_CLAMP)
    here = (np.degrees(state.angle_rad) - _FIRST_DEG) % 360.0 + _FIRST_DEG
    wide = np.degrees(p.shoulder_radius_mm / p.outer_radius_mm)
    for at in (here - 360.0, here, here + 360.0):  # also where it is cut by the edge
        axis.add_patch(
            Ellipse((at, state.axial_mm), 2.0 * wide, 2.0 * p.shoulder_radius_mm, **_TOOL)
        )
    axis.set_xlim(degrees[0], degrees[-1])
    axis.set_xticks(np.arange(-60.0, 301.0, 30.0))
    axis.set_ylim(height[0], height[-1])


def _draw_section(axis: Axes, history: HeatHistory, state: CanisterState) -> None:
    p = history.canister.parameters
    low, high = max(_SECTION_MM[0], -p.tube_mm), p.rim_mm + _SECTION_MM[1]
    outer, inner = p.outer_radius_mm, p.outer_radius_mm - p.wall_mm
    parts, inmost = [(inner, outer, low, p.rim_mm)], inner - 5.0
    if p.shape == "cylinder" and p.lid_mm > 0.0:
        inmost = inner - _INWARD_MM
        parts.append((inner - _INWARD_MM, inner, p.lid_from_mm, p.lid_from_mm + p.lid_mm))
    deep, wide = _SECTION
    for r_low, r_high, z_low, z_high in parts:
        r, z = np.linspace(r_low, r_high, deep), np.linspace(z_low, z_high, wide)
        field_c = history.canister.temperature_c(state, r[:, None], state.angle_rad, z)
        _isotherms(axis, z, r, field_c, _LABELLED_C[4::2])
    axis.plot([0.0, 0.0], [inner, outer], **_JOINT)
    tool_mm, probe, shoulder = state.axial_mm, p.probe_radius_mm, p.shoulder_radius_mm
    axis.add_patch(
        Rectangle(
            (tool_mm - probe, outer - p.probe_length_mm), 2.0 * probe, p.probe_length_mm, **_TOOL
        )
    )
    axis.add_patch(
        Rectangle((tool_mm - shoulder, outer), 2.0 * shoulder, 2.0 * _OUTWARD_MM, **_TOOL)
    )
    axis.set_xlim(low, high)
    axis.set_ylim(inmost, outer + _OUTWARD_MM)


def _isotherms(axis: Axes, x: Any, y: Any, field_c: Any, labelled: Sequence[float]) -> None:
    axis.contourf(x, y, field_c, LEVELS_C, cmap=_COLOURS, norm=_NORM, extend="both")
    lines = axis.contour(x, y, field_c, LEVELS_C, colors="white", linewidths=0.4, alpha=0.6)
    axis.clabel(lines, [t_c for t_c in labelled if t_c in lines.levels], fontsize=6.0, fmt="%g")


def _add_scale(figure: Figure, axes: Sequence[Axes]) -> None:
    mapped = matplotlib.cm.ScalarMappable(norm=_NORM, cmap=_COLOURS)
    scale = figure.colorbar(mapped, ax=list(axes), ticks=_LABELLED_C, fraction=0.02, pad=0.01)
    scale.set_label("copper [°C]")
    scale.ax.tick_params(labelsize=7.0)
