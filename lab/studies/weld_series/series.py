"""One weld of the series: its planted change, bag, record and row of the history."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import yaml

from fsw_analysis.procedure import Procedure
from fsw_analysis.weld_signals import WeldSignals
from fsw_campaign.welds import progress
from fsw_control.cause import RequestKind
from fsw_control.parameters import validate
from fsw_control.schema.files import write_whole
from fsw_control.weld import TICK_S
from fsw_quality import history, record, report
from fsw_quality.monitor import Monitor
from fsw_quality.monitor_run import watch
from fsw_recorder.bag_metadata import METADATA_NAME
from fsw_scenario import procedure
from fsw_scenario.closed_loop import ClosedLoop
from fsw_scenario.controllers import described_in, make_all, variant_of
from fsw_scenario.scenario import Scenario
from fsw_scenario.scenario_file import load, parse
from fsw_scenario.weld_programme import spans
from weld_series import bag

CONTROLLER = "decentral:tight"
#: as welds and procedure name it
MACHINE = "emulator"
#: where the joint line begins, and its end in a whole weld [deg]
BEGIN_DEG, WHOLE_DEG = 20.0, 380.0
#: dwell as the procedure wants it, and the tool's temperature at its begin, within the permitted
#: set-points
DWELL_S, START_C = 20.0, 805.0
#: from weld to weld the tool takes so much more torque (chosen)
WEAR_NM = 0.8
#: by number of the weld, where one is not like the others
SPECIAL = {22: "swap", 37: "thermocouple", 48: "operator"}
#: what happens there begins at this share of the joint line; the drift and the wrong set-point
#: last so long at most
SHARE, LASTS_S = 0.4, 300.0
DRIFT_C_PER_MIN, WRONG_C = 3.0, 842.0
ROW = "row.json"


def scenario_text(number: int, end_deg: float = WHOLE_DEG) -> str:
    """Scenario of a weld.

    `canister_weld_heat` whose joint line ends at ``end_deg``, with what is special about it.
    """
    content = yaml.safe_load(load("canister_weld_heat").text)
    del content["duration_s"], content["path"]  # they follow from the phases
    special, at_deg = SPECIAL.get(number), BEGIN_DEG + SHARE * (end_deg - BEGIN_DEG)
    begin_s, lasts_s = begin_and_length(end_deg)
    phases = {phase["name"]: phase for phase in content["phases"]}
    phases["dwell"].pop("until_c")
    phases["dwell"] |= {
        "duration_s": DWELL_S,
        "set_points": [{"temperature_c": 816.4, "over_s": DWELL_S}],
    }
    content["plant"]["start"]["temperature_c"] = START_C
    for name in ("joint_line", "overlap", "parking"):
        phases[name]["to_deg"] += end_deg - WHOLE_DEG
    events: list[dict[str, Any]] = [
        # without a fault nor a second controller no supervisor would watch the weld
        {"at_s": 0.0, "fault": {"sensor": "depth", "kind": "none"}},
        {
            "at_s": 0.0,
            "disturbance": {
                "channel": "torque",
                "shape": "step",
                "amplitude_nm": max(WEAR_NM * number, 0.1),
            },
        },
        *(
            event
            for event in content["events"]
            if event.get("disturbance", {}).get("channel") == "axial_force"
        ),
        {
            "at_deg": BEGIN_DEG,
            "disturbance": {"channel": "depth", "shape": "step", "amplitude_mm": 0.05},
        },
    ]
    if special == "swap":
        events.append({"at_deg": at_deg, "switch": "nmpc"})
    if special == "thermocouple":
        drift = {"sensor": "thermocouple", "kind": "drift", "magnitude_c": DRIFT_C_PER_MIN / 60.0}
        events.append({"at_deg": at_deg, "fault": drift | {"duration_s": lasts_s}})
    if special == "operator":
        phases["joint_line"]["set_points"] += [
            {"at_s": begin_s, "temperature_c": WRONG_C, "over_s": 20.0},
            {"at_s": begin_s + lasts_s, "temperature_c": 826.4, "over_s": 20.0},
        ]
    content |= {"name": f"series_{number:03d}", "controller": "decentral", "events": events}
    content["plant"]["seed"] = 1000 + number
    return yaml.safe_dump(content, sort_keys=False)


def begin_and_length(end_deg: float) -> tuple[float, float]:
    """Begin of the planted change after the begin of the joint line, and its duration [s]."""
    phases = load("canister_weld_heat").phases
    whole_s = next(end - begin for name, begin, end in spans(phases) if name == "joint_line")
    line_s = whole_s * (end_deg - BEGIN_DEG) / (WHOLE_DEG - BEGIN_DEG)
    return round(SHARE * line_s, 1), round(min(LASTS_S, 0.5 * line_s), 1)


def series_procedure(end_deg: float = WHOLE_DEG) -> Procedure:
    """The shipped procedure for the emulator.

    With another end of the joint line than the whole, phases are shorter.
    """
    values = procedure.load("copper_lid").model_dump(mode="json", exclude_none=True)
    values["machine"]["name"] = MACHINE
    for row in values["phases"]:
        if row["name"] in ("joint_line", "overlap", "parking") and end_deg != WHOLE_DEG:
            row |= {"to_deg": row["to_deg"] + end_deg - WHOLE_DEG, "source": "the series, chosen"}
    return Procedure.model_validate(values)


def weld(number: int, end_deg: float) -> tuple[Scenario, WeldSignals, bag.Actions]:
    """Weld in this process; what an operator sets by hand is none of the programme."""
    scenario = parse(scenario_text(number, end_deg), f"series {number}")
    signals = ClosedLoop(scenario, make_all(scenario, CONTROLLER, {})).run()
    if SPECIAL.get(number) != "operator":
        return scenario, signals, {}
    reports = progress(scenario, signals)
    begin = next(tick for tick, report in enumerate(reports) if report.phase == "joint_line")
    begin_s, lasts_s = begin_and_length(end_deg)
    first, last = (begin + round(at_s / TICK_S) for at_s in (begin_s, begin_s + lasts_s + 20.0))
    signals.programme_temperature_c = signals.reference_temperature_c.copy()
    signals.programme_temperature_c[first : last + 1] = signals.reference_temperature_c[first - 1]
    actions: dict[int, dict[str, Any]] = {
        tick: {
            "who": "Ada (3f2a)",
            "kind": RequestKind.SET_REFERENCE,
            "action": f"set-points {value:g} °C, ramp",
            "outcome": "done",
            "message": "",
        }
        for tick, value in ((first, WRONG_C), (round(first + lasts_s / TICK_S), 826.4))
        if tick < signals.n_ticks
    }
    return scenario, signals, actions


def judged(number: int, folder: Path, end_deg: float = WHOLE_DEG) -> history.Row:
    """Weld, write the bag, judge and monitor it; parts of an interrupted series are kept."""
    name = f"C{number:03d}"
    place = folder / "welds" / name
    row_file, page = place / ROW, place / "record" / report.JSON
    if row_file.is_file():
        kept: history.Row = json.loads(row_file.read_text(encoding="utf-8"))
        return kept
    if not (place / "bag" / METADATA_NAME).exists():
        shutil.rmtree(place, ignore_errors=True)
        _weld_to_bag(number, name, place / "bag", end_deg)
    signals, proof = record.read(place / "bag")
    wanted = series_procedure(end_deg)
    made, course = record.judged(place / "bag", wanted, signals, proof)
    page.parent.mkdir(exist_ok=True)
    report.write(made, course, wanted, page.parent)
    watched = watch(Monitor("canister"), signals)
    row = history.row(
        name, signals, watched, signals.custom, str(made.verdict), made.data_files, made.procedure
    )
    known = {key: None if value != value else value for key, value in row.items()}
    write_whole(row_file, json.dumps(known, indent=1))
    return row


def _weld_to_bag(number: int, name: str, folder: Path, end_deg: float) -> None:
    scenario, signals, actions = weld(number, end_deg)
    identity = {"canister": name, "lid": f"L{number:03d}", "tool": "T1", "machine": MACHINE}
    parameters = {
        controller: validate(
            described_in(controller),
            variant_of(CONTROLLER) if CONTROLLER.startswith(controller) else {},
        )
        for controller in scenario.controllers
    }
    bag.write(folder, scenario, signals, identity, parameters, actions)
