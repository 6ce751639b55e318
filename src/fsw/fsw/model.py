"""``fsw.py model``: the bare process in open loop, without drives, sensors and noise."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from fsw.errors import CommandError
from fsw.outputs import add_force, check_new
from fsw_analysis.export import write_table
from fsw_control.ranges import Range
from fsw_control.weld import TICK_S
from fsw_model import ModelParameterError, ModelParameters, OperatingPointError, ProcessModel
from fsw_plant.event_schema import DURATION_S
from fsw_plant.place import Place
from fsw_scenario.scenario import ScenarioError

COLUMNS = (
    "time_s",
    "depth_mm",
    "temperature_c",
    "motor_torque_nm",
    "process_torque_nm",
    "power_kw",
    "force_kn",
    "speed_rpm",
)
#: simulated after the last event where the file does not say how long
_AFTERWARDS_S = 30.0
#: inputs of the bare process, far beyond what drives can do; the model itself says where it ends
_FORCE_KN, _SPEED_RPM = Range(0.0, 1000.0, "kN"), Range(0.0, 10_000.0, "rpm")
#: share of a tick by which a time may miss it
_ROUNDING = 1e-6
_TICKS_PER_S = round(1.0 / TICK_S)


@dataclass(frozen=True, slots=True)
class InputStep:
    """New inputs from a tick on; None keeps the present one."""

    tick: int
    force_kn: float | None
    speed_rpm: float | None


def add_command(commands: Any) -> None:
    """Add the command to the parser's subcommands."""
    parser = commands.add_parser(
        "model",
        help="simulate the bare process in open loop from a file of input steps",
        description="Simulate the bare process (no drives, no sensors, no noise) in open loop from the operating point "
        "and write its course as CSV, a row every 0.1 s. The file lists steps {at_s, force_kn, speed_rpm}, or is a "
        "mapping with events: and duration_s: (default: 30 s after the last event). Values are absolute and hold from "
        "at_s, a multiple of 0.1 s, on; one left out stays.",
    )
    parser.add_argument(
        "--events", required=True, metavar="FILE", help=f"YAML file, or one of {', '.join(shipped())} (the paper's)"
    )
    parser.add_argument("--csv", required=True, type=Path, metavar="FILE", help="table to write")
    parser.add_argument("--figure", type=Path, metavar="FILE.png", help="also draw it like the paper's Figs. 4 and 5")
    parser.add_argument("--model", type=Path, metavar="FILE", help="model parameters (YAML) instead of the paper's")
    add_force(parser)
    parser.set_defaults(run=_run)


def shipped() -> list[str]:
    """Names of the files of input steps that come with the package."""
    folder = resources.files("fsw_scenario").joinpath("events")
    return sorted(entry.name.removesuffix(".yaml") for entry in folder.iterdir() if entry.name.endswith(".yaml"))


def read_steps(text: str, where: str) -> tuple[list[InputStep], int]:
    """Input steps in order of time, and the last tick, from YAML text.

    Raises
    ------
    ScenarioError
        Something is wrong; the message says where and what is allowed.
    """
    at = Place(where, failure=ScenarioError)
    content = at.yaml(text)
    if isinstance(content, list):
        content = {"events": content}
    if not isinstance(content, dict):
        raise ScenarioError(f"{where}: give a list of steps, or a mapping with events and duration_s")
    at.keys(content, ("events", "duration_s"), required=("events",))
    steps: list[InputStep] = []
    for i, entry in enumerate(at.list(content, "events")):
        place = at.inside(f"events[{i}]")
        place.mapping(entry)
        place.keys(entry, ("at_s", "force_kn", "speed_rpm"), required=("at_s",))
        force, speed = place.optional(entry, "force_kn", _FORCE_KN), place.optional(entry, "speed_rpm", _SPEED_RPM)
        if force is None and speed is None:
            raise place.error("needs force_kn or speed_rpm")
        step = InputStep(_tick(place, entry, "at_s", Range(0.0, DURATION_S.high, "s")), force, speed)
        if steps and step.tick < steps[-1].tick:
            raise place.error("is earlier than the step before it; list steps in order of time")
        steps.append(step)
    latest = steps[-1].tick if steps else 0
    if "duration_s" not in content:
        return steps, latest + round(_AFTERWARDS_S / TICK_S)
    last = _tick(at, content, "duration_s", DURATION_S)
    if latest > last:
        raise at.inside(f"events[{len(steps) - 1}]").error(f"is after the end at {last / _TICKS_PER_S:g} s")
    return steps, last


def _tick(at: Place, entry: dict[str, Any], key: str, allowed: Range) -> int:
    value = at.number(entry, key, allowed)
    tick = round(value / TICK_S)
    if abs(value / TICK_S - tick) > _ROUNDING:
        raise at.inside(key).error(f"is {value:g}: give a multiple of {TICK_S:g} s")
    return tick


def simulate(steps: list[InputStep], last_tick: int, model: ProcessModel) -> dict[str, Any]:
    """Course of the process, every column an array with one value per tick from 0 to ``last_tick``.

    Raises
    ------
    fsw_model.OperatingPointError
        The shoulder leaves the copper.
    """
    start = model.equilibrium()
    forces, speeds = np.full(last_tick + 1, start.force_kn), np.full(last_tick + 1, start.speed_rpm)
    for step in steps:
        if step.force_kn is not None:
            forces[step.tick :] = step.force_kn
        if step.speed_rpm is not None:
            speeds[step.tick :] = step.speed_rpm
    course = model.simulate(forces.tolist(), speeds.tolist(), start)
    course["time_s"] = course["time_s"].round(6)  # whole tenths, as they are written
    return {name: course[name] for name in COLUMNS}


def _run(arguments: argparse.Namespace) -> int:
    if arguments.figure is not None and arguments.figure.suffix.lower() != ".png":
        raise CommandError(f"--figure {arguments.figure}: end the name in .png")
    if arguments.csv == arguments.figure:
        raise CommandError(f"model: --csv and --figure are both {arguments.csv}; give two files")
    check_new([arguments.csv, arguments.figure], arguments.force)
    steps, last_tick = read_steps(_text(arguments.events), arguments.events)
    try:
        parameters = ModelParameters.from_file(arguments.model) if arguments.model is not None else None
        course = simulate(steps, last_tick, ProcessModel(parameters))
    except (ModelParameterError, OperatingPointError) as error:
        raise CommandError(f"model: {error}") from None
    files: dict[Path, Callable[[Path], None]] = {arguments.csv: lambda path: write_table(course, path)}
    if arguments.figure is not None:
        from fsw_analysis.figures import draw_open_loop  # matplotlib takes a second to import

        title = f"Process in open loop: {Path(arguments.events).name}"
        columns = course | {"process_power_kw": course["power_kw"]}
        files[arguments.figure] = lambda path: draw_open_loop(columns, title, path)
    _write_all(files)
    print(f"{last_tick + 1} rows, 0 to {last_tick / _TICKS_PER_S:g} s, written to {', '.join(map(str, files))}")
    return 0


def _text(source: str) -> str:
    path = Path(source)
    if source in shipped() and not path.is_file():
        return resources.files("fsw_scenario").joinpath("events", f"{source}.yaml").read_text(encoding="utf-8")
    try:
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise CommandError(
            f"cannot read events {source}: {error.strerror}; give a YAML file or one of {', '.join(shipped())}"
        ) from None
    except (UnicodeDecodeError, ValueError):
        raise CommandError(f"cannot read events {source!r}: not a text file in UTF-8") from None


def _write_all(files: dict[Path, Callable[[Path], None]]) -> None:
    """Write every file beside its place first, and put them there only when all are whole."""
    parts = {target: target.parent / f".{target.name}.{os.getpid()}.part" for target in files}
    try:
        for target, write in files.items():
            try:
                write(parts[target])
            except OSError as error:
                raise CommandError(f"cannot write {target}: {error.strerror or error}") from None
        for target, part in parts.items():
            part.replace(target)
    finally:
        for part in parts.values():
            with suppress(OSError):
                part.unlink()
