"""Situations in which a person must find cause and next action from the page alone, and their page."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from fsw_control.cause import Cause
from fsw_control.parameters import defaults
from fsw_control.stop import StopCause
from fsw_hmi.alarm_rules import AlarmRules, Part, Situation
from fsw_hmi.alarms import AlarmList, flood
from fsw_hmi.headline import headline
from fsw_hmi.parameters import HmiParameters
from fsw_test_support.fake_hmi import good_account
from fsw_test_support.hmi_situation import (
    controller,
    gateway,
    lock,
    procedure_left,
    situation,
    state,
)

#: each moment of a situation lasts so long, longer than any alarm waits, and is looked at so often
_LASTS_S, _LOOK_S = 20.0, 0.5


@dataclass(frozen=True)
class Staged:
    """What happens, moment by moment, and what the headline must then be about."""

    about: str  #: identifier of the alarm; of the headline itself, if it is not an alarm's
    cause: str  #: code of the cause; empty where there is only one
    action: str  #: code of what to do
    says: str  #: the same in words, as the page has them
    moments: tuple[Situation, ...]
    recording: str = "recording"
    after: str = "none"  #: code of what to do at the end of the weld


def _stopped(by_cause: StopCause, **changed: Any) -> dict[str, Any]:
    modes = {"actual_mode": "safe_stop", "target_mode": "safe_stop", "stop_cause": by_cause}
    return state(**modes | changed)


_STANDBY = {"fsw_supervisor": {"arbiter": Part("ok", ""), "standby": Part("ok", "")}}
_ALONE = {"fsw_supervisor": {"arbiter": Part("ok", ""), "standby": Part("stale", "")}}
_SILENT: dict[str, Any] = {"tick_age_s": 5.0, "command_age_s": 5.0}
_RETRACT = "Remove the cause, retract the tool at the machine, then acknowledge the stop"

STAGED = {
    "thermocouple frozen": Staged(
        "sensor:thermocouple",
        "frozen",
        "check_sensor",
        "Sensor thermocouple not usable: its value stands still"
        " → Check sensor and cable, ask for a safe stop if it stays unusable",
        (situation(sensor_states={"thermocouple": "frozen"}),),
    ),
    "thermocouple detached": Staged(
        "interlock:temperature_model_low",
        "temperature_model_low",
        "compare_thermocouple",
        "Temperature falls without a cause: thermocouple loose, or the weld cools: warning"
        " → Compare the thermocouple with a second one, ask for a safe stop if it is loose",
        (
            situation(
                {"temperature_c": 780.0},
                state=state(interlocks=[lock("temperature_model_low", "warn")]),
            ),
        ),
    ),
    "torque spike": Staged(
        "sensor:torque",
        "too fast",
        "check_sensor",
        "Sensor torque not usable: its value changed faster than the process can"
        " → Check sensor and cable, ask for a safe stop if it stays unusable",
        (
            situation(sensor_states={"torque": "too fast"}),
            situation(sensor_states={"torque": "recovering"}),
        ),
    ),
    "failover": Staged(
        "failover",
        "",
        "swap_back",
        "decentral commands instead of nmpc: no proposal at the deadline"
        " → Remove the cause, then swap back to nmpc",
        (
            situation(
                state=state(
                    actual_controller="decentral",
                    controllers=[
                        controller(ready=False, inhibited=True, why="no proposal at the deadline")
                    ],
                )
            ),
        ),
    ),
    "supervisor taken over": Staged(
        "standby",
        "taken_over",
        "start_standby",
        "No supervisor stands by: the supervisor that led has failed, and its standby leads now"
        " → Start another supervisor",
        (
            situation(leader="a", parts=_STANDBY),
            situation(leader="b", parts=_ALONE),
        ),
    ),
    "supervisor killed": Staged(
        "supervisor",
        "",
        "start_supervisor",
        "No commands from the supervisor → Start a supervisor, ready to stop at the machine",
        (situation(state=state(known=False), state_age_s=5.0, command_age_s=5.0),),
    ),
    "link to the PLC lost": Staged(
        "machine",
        "",
        "check_machine",
        "Commands do not reach the machine: link lost"
        " → Check the machine's control: mode, permissive, network; ready to stop at the machine",
        (situation(parts=gateway(connection="error"), **_SILENT),),
    ),
    "recorder killed": Staged(
        "recorder",
        "",
        "start_recorder",
        "The recorder no longer reports → Start the recorder again, it begins another bag",
        (situation(parts={"fsw_recorder": {"recording": Part("stale", "")}}),),
        "silent",
    ),
    "safe stop by the operator": Staged(
        "safe_stop",
        "operator",
        "retract_and_acknowledge",
        f"Safe stop: asked for by Anna (1) → {_RETRACT}",
        (situation(state=_stopped(StopCause.OPERATOR, cause=Cause.STOP_HEARD)),),
    ),
    "safe stop by an interlock": Staged(
        "safe_stop",
        "interlock",
        "retract_and_acknowledge",
        f"Safe stop: Axial force too high → {_RETRACT}",
        (
            situation(state=state(interlocks=[lock("force_high", "warn")])),
            situation(
                state=_stopped(
                    StopCause.INTERLOCK,
                    cause=Cause.INTERLOCK_TRIP,
                    interlocks=[lock("force_high", "trip")],
                    tripped=["force_high"],
                )
            ),
        ),
    ),
    "stop acknowledged": Staged(
        "safe_stop",
        "operator",
        "choose_auto",
        "Safe stop: asked for by Anna (1) → Choose mode auto to start control again",
        (situation(state=_stopped(StopCause.OPERATOR, acknowledged=True)),),
    ),
    "programme aborted": Staged(
        "safe_stop",
        "operator",
        "retract_and_acknowledge",
        f"Safe stop: asked for by operator → {_RETRACT}",
        (
            situation(
                state=_stopped(StopCause.OPERATOR, by="operator"),
                values={"temperature_c": 700.0, "reference_temperature_c": 850.0},
                programme="aborted",
            ),
        ),
        after="retract_and_acknowledge",
    ),
    "programme aborted, stop acknowledged": Staged(
        "safe_stop",
        "operator",
        "clear_machine",
        "Safe stop: asked for by Anna (1) → Clear the machine, then start the next weld",
        (situation(state=_stopped(StopCause.OPERATOR, acknowledged=True), programme="aborted"),),
        after="wait_for_bag",
    ),
    "programme aborted, control again": Staged(
        "aborted",
        "",
        "wait_for_bag",
        "Weld aborted: it cannot be continued → "
        "Wait until the bag is closed, then write the record of the weld",
        (situation(programme="aborted"),),
        after="wait_for_bag",
    ),
    "weld finished": Staged(
        "done",
        "",
        "write_record",
        "Weld done: Good: every limit is kept → Write the record of the weld: fsw.py record",
        (situation(programme="running"), situation(programme="done", state_age_s=60.0, **_SILENT)),
        "closed",
        "write_record",
    ),
    "plant killed": Staged(
        "measurements",
        "",
        "check_plant",
        "No measurements: the drives are silent"
        " → Check plant or gateway, ready to stop at the machine",
        (situation(parts={"fsw_plant": {"watchdog": Part("stale", "")}}, **_SILENT),),
    ),
    "weld leaves its procedure": Staged(
        "procedure",
        "set_point_temperature_c",
        "correct_procedure",
        "The weld leaves its procedure: set-point temperature_c 905 is in force; "
        "permitted: 800 to 900 → Correct set-points or controller as the procedure has them, "
        "or ask for a safe stop",
        (situation(parts=procedure_left(temperature_c=905.0)),),
    ),
}


def page_of(staged: Staged) -> tuple[list[dict[str, Any]], dict[str, str]]:
    """Rows of the alarms and the headline, as the page's server makes them after the last moment."""
    rules = AlarmRules(defaults(HmiParameters).__getitem__)
    alarms, now_s = AlarmList(flood), 0.0
    for moment in (situation(), *staged.moments):
        end_s = now_s + _LASTS_S
        while now_s < end_s:
            alarms.update(rules.present(moment, now_s), now_s)
            now_s += _LOOK_S
    rows, last = alarms.rows(now_s, 0.0), staged.moments[-1]
    return rows, headline(last, rows, good_account(), staged.recording)


def sentence(shown: Mapping[str, str]) -> str:
    """A headline as a person reads it."""
    cause = f"{shown['text']}: {shown['detail']}" if shown["detail"] else shown["text"]
    return f"{cause} → {shown['next']}"
