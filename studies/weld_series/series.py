"""One weld of the series: what is special about it, the weld itself, its record and its row of the history."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import yaml

from fsw_analysis.weld_signals import WeldEvent, WeldSignals
from fsw_quality import history, procedure, record, report
from fsw_quality.monitor import Monitor
from fsw_quality.monitor_run import watch
from fsw_quality.procedure import Procedure
from fsw_scenario.closed_loop import ClosedLoop
from fsw_scenario.controllers import make_all
from fsw_scenario.scenario_file import load, parse
from fsw_scenario.weld_programme import CANISTER_DIAMETER_MM

#: chosen: the dwell, the part of the joint line that is welded, shorter than a weld by far, and the traverse speed
DWELL_S, LINE_DEG, TRAVERSE_MM_PER_MIN = 30.0, 42.0, 86.0
#: from weld to weld the tool takes so much more torque (chosen)
WEAR_NM = 0.8
#: by number of the weld, where one is not like the others
SPECIAL = {22: "swap", 37: "thermocouple", 48: "operator"}
FAULT_S, DRIFT_C_PER_MIN = 130.0, 2.0
WRONG_C = 832.0


def scenario_text(number: int) -> str:
    """Scenario of a weld: a canister whose geometry is that of `canister_weld_heat`."""
    special = SPECIAL.get(number)
    points: list[dict[str, float]] = [{"at_s": 20.0, "depth_mm": 2.76}, {"at_s": 60.0, "depth_mm": 2.66}]
    events: list[dict[str, Any]] = [
        {"at_s": 0.0, "disturbance": {"channel": "torque", "shape": "step", "amplitude_nm": max(WEAR_NM * number, 0.1)}}
    ]
    if special == "swap":
        events.append({"at_s": 160.0, "switch": "nmpc"})
    if special == "thermocouple":
        drift = {"sensor": "thermocouple", "kind": "drift", "magnitude_c": DRIFT_C_PER_MIN / 60.0}
        events.append({"at_s": FAULT_S, "fault": drift})
    if special == "operator":
        points.append({"at_s": 130.0, "temperature_c": WRONG_C, "over_s": 20.0})
    canister = {key: value for key, value in load("canister_weld_heat").plant.items() if key.startswith("canister.")}
    start = {"start.temperature_c": 814.0, "start.power_kw": 48.0}
    return yaml.safe_dump(
        {
            "name": f"series_{number:03d}",
            "controller": "decentral",
            "plant": {"seed": 1000 + number, "process": "canister", **start, **canister},
            "phases": [
                {"name": "dwell", "duration_s": DWELL_S},
                {"name": "joint_line", "to_deg": LINE_DEG, "set_points": points},
            ],
            "events": events,
        }
    )


def series_procedure() -> Procedure:
    """The shipped procedure with the phases of the series."""
    values = procedure.load("copper_lid").model_dump(mode="json", exclude_none=True)
    values["phases"] = [
        {"name": "dwell", "duration_s": DWELL_S, "source": "the series, chosen"},
        {"name": "joint_line", "to_deg": LINE_DEG, "source": "the series, chosen"},
    ]
    return Procedure.model_validate(values)


def weld(number: int) -> WeldSignals:
    """Weld in this process; what a programme's node would report is added."""
    scenario = parse(scenario_text(number), f"series {number}")
    signals = ClosedLoop(scenario, make_all(scenario, "decentral:tight", {})).run()
    time_s = signals.time_s
    signals.phases = [("dwell", float(time_s[0])), ("joint_line", DWELL_S)]
    signals.travel_mm = TRAVERSE_MM_PER_MIN / 60.0 * np.clip(time_s - DWELL_S, 0.0, None)
    signals.angle_deg = signals.travel_mm / (np.pi * CANISTER_DIAMETER_MM / 360.0)
    signals.events = [
        WeldEvent(DWELL_S, "phase", "phase joint_line"),
        WeldEvent(float(time_s[-1]), "weld", "weld done"),
    ]
    source = signals.command_source
    for tick in np.flatnonzero(source[1:] != source[:-1]) + 1:
        signals.events.append(WeldEvent(float(time_s[tick]), "swap", f"{source[tick - 1]} to {source[tick]}"))
    if SPECIAL.get(number) == "operator":  # the programme knows nothing of what was set by hand
        signals.programme_temperature_c = np.full(time_s.size, float(signals.reference_temperature_c[0]))
        text = f"Ada, session 1: set_reference {WRONG_C:g} °C (done)"
        signals.events.append(WeldEvent(DWELL_S + FAULT_S, "operator", text))
    signals.events.sort()
    return signals


def judged(number: int, folder: Path) -> history.Row:
    """Weld, watch and judge; the record goes into the folder, of special welds with pages and figures."""
    name, signals = f"C{number:03d}", weld(number)
    identity = {"canister": name, "lid": f"L{number:03d}", "tool": "T1", "machine": "emulator", "lost_messages": "0"}
    watched = watch(Monitor("canister"), signals)
    wanted = series_procedure()
    made, course = record.assemble(signals, wanted, identity)
    place = folder / "records" / name
    place.mkdir(parents=True, exist_ok=True)
    if number in SPECIAL:
        report.write(made, course, wanted, place)
    else:
        (place / report.JSON).write_text(made.model_dump_json(indent=2, exclude_none=True) + "\n", encoding="utf-8")
    return history.row(name, signals, watched, identity, str(made.verdict))
