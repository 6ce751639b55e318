"""``fsw.py canister``.

The heat of a weld in the canister, as table, figure, VTK files and thermocouples.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from math import isfinite, radians
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from fsw.command import FORCE, command, file, number, option, picture, repeated
from fsw.console import (
    ProgressBar,
    check_new,
    default_folder,
    new_folder,
    print_table,
    write_whole,
)
from fsw.errors import CommandError
from fsw_analysis.weld_signals import write_table
from fsw_control.schema.models import InputError
from fsw_control.schema.ranges import Range
from fsw_heat import heat_figures, load_or_reduce
from fsw_heat.elements import elements_of
from fsw_heat.history import HeatHistory, heat_history, write_vtk
from fsw_lab.canister_weld import CanisterWeld, programmed, recorded
from fsw_model import STEP_S

_SCENARIO = "canister_weld_heat"
#: moments that are shown where none is given, as shares of these phases; of the whole where there
#: are none of them
_MOMENTS = {"start": 0.9, "joint_line": 0.5, "overlap": 0.9}
#: tolerance of the reduction where temperatures away from the tool are shown
_FINE_K = 1e-5
_ONLY_WITHOUT_BAG = ("power", "scenario", "canister")


@command(
    "canister",
    "heat of a weld in the canister: table, figure, VTK files, thermocouples",
    option(
        "bag",
        nargs="?",
        type=Path,
        metavar="BAG",
        help="bag of a weld on a plant with process: canister",
    ),
    number(
        "--power",
        "KW",
        Range(0.0, 200.0, "kW"),
        "constant power, 0 to 200 kW (default: the paper's, 43.6 kW)",
    ),
    option(
        "--scenario",
        metavar="NAME",
        help=f"scenario whose path the tool takes (default {_SCENARIO})",
    ),
    file("--canister", "parameters of the canister (YAML) instead of the scenario's"),
    repeated(
        "--probe",
        "R,ANGLE,Z",
        "virtual thermocouple: radius [mm], angle from the start [deg], "
        "height above the joint line [mm], e.g. 525,90,-50",
    ),
    repeated(
        "--at",
        "S",
        "moment for --figure and --vtk (default: in the lid, on the joint line, in the overlap)",
        type=float,
    ),
    file("--csv", "table over time (default out/<date>_canister/heat.csv)"),
    picture("--figure", "surface, section and curves in one figure"),
    file("--vtk", "temperatures of the whole geometry for ParaView", "DIR"),
    FORCE,
    description="Compute the heat of a weld in the canister, "
    "by conduction: of a constant power along the tool's path of a scenario, "
    "from a cold canister, or of the power in a bag recorded with process: canister. "
    "Writes a table over time and prints the temperatures of each phase.",
)
def canister(arguments: argparse.Namespace) -> int:
    _check(arguments)
    if arguments.bag is not None:
        weld = recorded(arguments.bag)
    else:
        weld = programmed(arguments.scenario or _SCENARIO, arguments.canister, arguments.power)
    moments_s = _moments(arguments, weld)
    history, probes, step_us = _computed(arguments, weld)
    table = arguments.csv or default_folder("canister") / "heat.csv"
    _write_table(table, history, probes)
    written = [f"{table}: temperatures over time, {history.kept_s.size} rows"]
    written += _pictures(arguments, weld, history, probes, moments_s)
    _print(weld, history, step_us)
    print("\n".join(written))
    return 0


def _check(arguments: argparse.Namespace) -> None:
    """Refuse what cannot be done, before any work."""
    given = [name for name in _ONLY_WITHOUT_BAG if getattr(arguments, name) is not None]
    if arguments.bag is not None and given:
        raise CommandError(
            f"canister: --{given[0]} does not go with a bag, which has power, "
            "path and canister itself"
        )
    check_new([arguments.csv, arguments.figure], arguments.force)
    arguments.probe = [_probe(text) for text in arguments.probe]


class _Probe(NamedTuple):
    """A virtual thermocouple.

    As it was given, in words for a figure, and radius [mm], angle [rad], height [mm].
    """

    text: str
    words: str
    place: tuple[float, float, float]


def _probe(text: str) -> _Probe:
    try:
        r, degrees, z = map(float, text.split(","))
    except ValueError:
        raise CommandError(
            f"--probe {text}: give radius, angle and height as R,ANGLE,Z, e.g. 525,90,-50"
        ) from None
    if not isfinite(r + degrees + z):
        raise CommandError(f"--probe {text}: not finite")
    return _Probe(text, f"{r:g} mm, {degrees:g}°, {z:+g} mm", (r, radians(degrees), z))


def _moments(arguments: argparse.Namespace, weld: CanisterWeld) -> list[float]:
    end_s = weld.phases[-1][2]
    if late := next((at_s for at_s in arguments.at if not 0.0 <= at_s <= end_s), None):
        raise CommandError(f"--at {late:g}: the weld lasts from 0 to {end_s:.0f} s")
    spans = {name: (begin, end) for name, begin, end in weld.phases}
    named = [
        spans[name][0] + share * (spans[name][1] - spans[name][0])
        for name, share in _MOMENTS.items()
        if name in spans
    ]
    return sorted(arguments.at) or named or [share * end_s for share in _MOMENTS.values()]


def _computed(
    arguments: argparse.Namespace, weld: CanisterWeld
) -> tuple[HeatHistory, dict[_Probe, Any], float]:
    """The heat over time, the thermocouples by name, and what a step took [us]."""
    for text, _, (r, _, z) in arguments.probe:
        try:
            elements_of(weld.parameters).at(1e-3 * r, 1e-3 * z)
        except InputError as error:
            raise CommandError(f"--probe {text}: {error}") from None
    if arguments.vtk is not None:
        outputs = (arguments.csv, arguments.figure)
        new_folder(arguments, "canister", "--vtk", outputs)
    elsewhere = arguments.probe or arguments.figure or arguments.vtk
    parameters = weld.parameters.changed(tolerance_k=_FINE_K) if elsewhere else weld.parameters
    with ProgressBar("heat conduction in the canister") as bar:
        canister = load_or_reduce(parameters, progress=lambda share, _: bar(share))
    start = weld.start(canister)
    with ProgressBar(weld.name) as bar:
        began = time.perf_counter()
        history = heat_history(canister, start, weld.course, STEP_S, bar)
        step_us = 1e6 * (time.perf_counter() - began) / history.time_s.size
    columns = history.thermocouples([probe.place for probe in arguments.probe]).T
    return history, dict(zip(arguments.probe, columns, strict=True)), step_us


def _write_table(table: Path, history: HeatHistory, probes: dict[_Probe, Any]) -> None:
    """A row a second; of each thermocouple a column."""
    at = np.searchsorted(history.time_s, history.kept_s[1:] - 1e-6)
    course = history.course
    columns = {
        "time_s": np.round(history.time_s[at], 3),
        "power_kw": course.power_kw[at],
        "stir_zone_c": history.stir_zone_c[at],
        "tool_angle_deg": np.degrees(history.angle_rad[at]),
        "tool_axial_mm": course.axial_mm[at],
    }
    columns |= {f"probe {probe.text} [degC]": values[1:] for probe, values in probes.items()}
    write_whole(table, lambda part: write_table(columns, part))


def _pictures(
    arguments: argparse.Namespace,
    weld: CanisterWeld,
    history: HeatHistory,
    probes: dict[_Probe, Any],
    moments_s: Sequence[float],
) -> list[str]:
    """Write what is wanted; what each file has, in words."""
    words = []
    if arguments.figure is not None:
        named = {probe.words: values for probe, values in probes.items()}
        title = f"Heat in the canister: {weld.name}"
        picture = heat_figures.HeatPicture(history, weld.phases, title, named)
        arguments.figure.parent.mkdir(parents=True, exist_ok=True)
        heat_figures.draw_heat(picture, moments_s, arguments.figure)
        times = ", ".join(f"{at_s:.0f}" for at_s in moments_s)
        words.append(f"{arguments.figure}: the canister at {times} s")
    if arguments.vtk is not None:
        files = write_vtk(history, moments_s, arguments.vtk)
        words.append(f"{files[0]}: {len(files) - 1} moments, for ParaView")
    return words


def _print(weld: CanisterWeld, history: HeatHistory, step_us: float) -> None:
    """What was computed, and the temperatures of each phase."""
    p, canister, last = weld.parameters, history.canister, history.states[-1]
    print(
        f"{weld.name}: outer radius {p.outer_radius_mm:g} mm, wall {p.wall_mm:g} mm, "
        f"lid {p.lid_mm:g} mm"
    )
    stored_mj = 1e-6 * canister.stored_j(last)
    print(
        f"{canister.states} states, {step_us:.0f} us a step; "
        f"{stored_mj:.1f} MJ in the copper at the end"
    )
    if weld.stir_zone_c is not None:
        largest = abs(history.stir_zone_c - weld.stir_zone_c).max()
        print(f"the stir zone differs from that in the bag by at most {largest:.2f} degC")
    rows = []
    for name, begin_s, end_s in weld.phases:
        inside = (history.time_s > begin_s) & (history.time_s <= end_s + 1e-6)
        if inside.any():
            stir, power = history.stir_zone_c[inside], history.course.power_kw[inside].mean()
            numbers = (
                f"{begin_s:.0f}",
                f"{end_s:.0f}",
                f"{power:.1f}",
                *map("{:.0f}".format, (stir.min(), stir.mean(), stir.max())),
            )
            rows.append((name.replace("_", " "), *numbers))
    header = ("phase", "from [s]", "to [s]", "power [kW]", "stir zone min [degC]", "mean", "max")
    print_table(rows, header, 1)
