"""The line at the top of the page: whether the weld is good and, if not, what is worst.

The judgement of the weld so far is ``fsw_analysis.judgement``'s; what is worse, or more urgent,
comes before it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from enum import StrEnum
from typing import Any

from fsw_analysis.course import OVER
from fsw_analysis.rules import VARIABLES
from fsw_hmi.alarm_rules import DONE, NO_REPORT_S, Situation, next_in_stop
from fsw_hmi.alarms import ACTIONS, NEXT_OF_BAG
from fsw_hmi.limits import worst
from fsw_hmi.recording import RecordingState

#: no ticks for longer than this: the values on the page are old
TICK_AGE_S = 0.5
#: by rule that decides how the weld is judged, what to do while it runs
_ACTIONS = {
    **dict.fromkeys(("essential", "quality", "set-point"), "see_marks"),
    "recording": "check_recorder",
    "sensor": "check_sensor_cable",
}
#: alarms that say why there are no measurements
_OF_SILENCE = ("machine", "measurements")


class Code(StrEnum):
    """What a headline that is not of an alarm says."""

    NO_MEASUREMENTS_YET = "no_measurements_yet"
    NO_MEASUREMENTS = "no_measurements"
    FLAG = "flag"
    NO_SUPERVISOR = "no_supervisor"
    MODE = "mode"
    DONE = "done"
    ABORTED = "aborted"
    NOT_JUDGED = "not_judged"
    ACCOUNT = "account"
    GOOD = "good"


#: alarms in the order of the list, and the judgement, as the page gets them
Alarms = Sequence[Mapping[str, Any]]
Account = Mapping[str, Any] | None


def headline(
    now: Situation,
    alarms: Alarms = (),
    account: Account = None,
    recording: str = RecordingState.NONE,
) -> dict[str, str]:
    """Level, text, detail and what to do; ``code`` or else ``alarm`` is what it is about.

    ``after`` is what to do once the programme is over; empty before.
    """
    if now.programme not in OVER:
        return {**_worst(now, alarms, _of_account(account)), "after": ""}
    after = NEXT_OF_BAG[recording]
    if now.stop_waits or _waits(now.state):  # comes before the recording
        after = "acknowledge_first" if now.programme == DONE else "retract_and_acknowledge"
    end = _end(now, account, after)
    return {**_worst(now, alarms, end), "after": ACTIONS[after]}


def _worst(now: Situation, alarms: Alarms, weld: dict[str, str] | None) -> dict[str, str]:
    """The worst state; ``weld`` is the judgement so far (None: good), or the end of the weld."""
    silent = now.tick_age_s is None or now.tick_age_s > TICK_AGE_S
    if now.programme == DONE and silent and weld is not None:
        return _urgent(alarms) or weld
    if now.tick_age_s is None:
        return _line("attention", Code.NO_MEASUREMENTS_YET, "start_plant", "No measurements yet")
    if now.tick_age_s > TICK_AGE_S:
        why = [alarm for alarm in alarms if alarm["id"] in _OF_SILENCE]
        since = f"for {now.tick_age_s:.0f} s" if now.tick_age_s >= 1.0 else ""
        return _urgent(why) or _line(
            "high", Code.NO_MEASUREMENTS, "check_plant", "No measurements", since
        )
    return (
        _urgent(alarms)
        or _of_flags(worst(now.outside))
        or _of_state(now)
        or weld
        or _of_alarms(alarms, ("low",))
        or _line("good", Code.GOOD, "none", "Good", "every limit is kept so far")
    )


def _line(level: str, code: Code, action: str, text: str, detail: str = "") -> dict[str, str]:
    about = {"code": str(code), "alarm": "", "action": action, "next": ACTIONS[action]}
    return {"level": level, "text": text, "detail": detail, **about}


def _urgent(alarms: Alarms) -> dict[str, str] | None:
    """The alarm that needs a person first, by the order of the list: unacknowledged ones lead."""
    return _of_alarms(alarms, ("high", "medium"))


def _of_alarms(alarms: Alarms, priorities: tuple[str, ...]) -> dict[str, str] | None:
    for alarm in alarms:
        if alarm["state"] in ("active", "acknowledged") and alarm["priority"] in priorities:
            about = {"code": alarm["cause"], "alarm": alarm["id"], "action": alarm["action"]}
            words = {"text": alarm["what"], "detail": alarm["why"], "next": alarm["advice"]}
            return {"level": alarm["priority"], **words, **about}
    return None


def _of_flags(flags: Mapping[str, Mapping[str, str]]) -> dict[str, str] | None:
    if not flags:
        return None
    name = min(flags, key=lambda quantity: flags[quantity]["level"] != "high")
    text = f"{VARIABLES[name].capitalize()}: {flags[name]['text']}"
    return _line(flags[name]["level"], Code.FLAG, "check_control", text)


def _of_state(now: Situation) -> dict[str, str] | None:
    """What is wrong with the state is an alarm; the rest is what somebody wants."""
    state = now.state
    if state is None or now.state_age_s is None or now.state_age_s > NO_REPORT_S:
        text, detail = "No supervisor", "no supervisor reports"
        if now.stop_waits:
            detail = "a safe stop is in force: the next weld starts in it"
        return _line("medium", Code.NO_SUPERVISOR, "start_supervisor", text, detail)
    mode = state["actual_mode"]
    if mode == "auto":
        return None
    stopped, text = mode == "safe_stop", f"In {mode.replace('_', ' ')}"
    action = next_in_stop(now, state) if stopped else "choose_auto"
    if mode == "hold" and state["cause"].at_start:
        action = "none"
    return _line("high" if stopped else "attention", Code.MODE, action, text, state["reason"])


def _waits(state: Mapping[str, Any] | None) -> bool:
    """Whether a safe stop is yet to be acknowledged."""
    if state is None:
        return False
    return state["actual_mode"] == "safe_stop" and not state["acknowledged"]


def _end(now: Situation, account: Account, action: str) -> dict[str, str]:
    """The weld has ended: aborted, or as its programme has it and as its rules judge it."""
    if now.programme != DONE:
        return _line("medium", Code.ABORTED, action, "Weld aborted", "it cannot be continued")
    if account is None:
        return _line("attention", Code.DONE, action, "Weld done", "not judged")
    text = f"Weld done: {account['text']}"
    return _line(account["level"], Code.DONE, action, text, account["detail"])


def _of_account(account: Account) -> dict[str, str] | None:
    """How the weld so far is judged, by the rules of its record."""
    if account is None:
        return _line("attention", Code.NOT_JUDGED, "none", "Not judged yet")
    if account["level"] == "good":
        return None
    action = _ACTIONS.get(account["rule"], "have_reviewed")
    return _line(account["level"], Code.ACCOUNT, action, account["text"], account["detail"])
