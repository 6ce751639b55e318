"""What the page says at its top, and what it flags.

Found by the server, by the rules that the weld is judged by.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from fsw_analysis.rule_book import Limit, default
from fsw_control.cause import Cause
from fsw_hmi.alarm_rules import Situation
from fsw_hmi.alarms import ACTIONS, NEXT_OF_BAG
from fsw_hmi.headline import headline
from fsw_hmi.limits import flags, limits, outside_now, variables
from fsw_test_support import hmi_situation

INTERLOCKS = {"interlocks.depth_high.warn": 3.4, "interlocks.depth_high.trip": 3.6}
LIMITS = limits(INTERLOCKS, default())
GOOD = hmi_situation.GOOD | {"torque_nm": 1060.0, "power_kw": 45.0}
AUTO = {
    "known": True,
    "actual_mode": "auto",
    "reason": "",
    "acknowledged": False,
    "cause": Cause.SWAP_REQUESTED,
}
ACCOUNT = {"level": "good", "rule": "all", "text": "Good", "detail": ""}
FLAG = {"level": "medium", "kind": "error", "text": "off its set-point, high"}


def alarm(priority: str, state: str = "active") -> dict[str, str]:
    codes = {"id": priority, "cause": "", "action": "check_plant", "advice": "see"}
    return {"priority": priority, "state": state, "what": f"{priority} one", "why": "so", **codes}


def shown(
    alarms: Any = (), account: Any = ACCOUNT, recording: str = "none", **changed: Any
) -> dict[str, str]:
    """The headline; a state that is not known is one whose supervisor is silent."""
    changed = {"tick_age_s": 0.1, "state": AUTO, **changed}
    known = changed["state"]["known"]
    outside = {quantity: [flag] for quantity, flag in changed.pop("flags", {}).items()}
    now = Situation(state_age_s=0.1 if known else 60.0, outside=outside, **changed)
    return headline(now, alarms, account, recording)


@pytest.mark.parametrize(
    ("changed", "level", "text"),
    [
        ({}, "good", "Good"),
        ({"tick_age_s": None}, "attention", "No measurements yet"),
        ({"tick_age_s": 60.0, "programme": "done"}, "good", "Weld done: Good"),
        ({"programme": "done", "alarms": [alarm("high")]}, "high", "high one"),
        ({"programme": "done"}, "good", "Weld done: Good"),
        ({"programme": "done", "state": AUTO | {"known": False}}, "medium", "No supervisor"),
        ({"tick_age_s": 0.6, "alarms": [alarm("high")]}, "high", "No measurements"),
        ({"alarms": [alarm("medium"), alarm("high", "acknowledged")]}, "medium", "medium one"),
        ({"alarms": [alarm("medium", "acknowledged")]}, "medium", "medium one"),
        ({"alarms": [alarm("medium")], "flags": {"depth_mm": FLAG}}, "medium", "medium one"),
        ({"alarms": [alarm("medium", "shelved"), alarm("high", "cleared")]}, "good", "Good"),
        (
            {"alarms": [alarm("low")], "flags": {"depth_mm": FLAG}},
            "medium",
            "Depth: off its set-point, high",
        ),
        (
            {"flags": {"depth_mm": FLAG, "power_kw": FLAG | {"level": "high"}}},
            "high",
            "Power: off its set-point, high",
        ),
        ({"state": AUTO | {"known": False}}, "medium", "No supervisor"),
        ({"state": AUTO | {"actual_mode": "safe_stop"}}, "high", "In safe stop"),
        ({"state": AUTO | {"actual_mode": "manual"}}, "attention", "In manual"),
        ({"account": None}, "attention", "Not judged yet"),
        (
            {
                "account": {"level": "medium", "rule": "tool", "text": "Tool", "detail": ""},
                "alarms": [alarm("low")],
            },
            "medium",
            "Tool",
        ),
        ({"alarms": [alarm("low")]}, "low", "low one"),
    ],
)
def test_headline_is_the_worst(changed: dict[str, Any], level: str, text: str) -> None:
    top = shown(**changed)
    assert (top["level"], top["text"]) == (level, text)


STOP = {"actual_mode": "safe_stop"}
RETRACT = "retract_and_acknowledge"


def test_a_stop_that_waits_is_told_although_no_supervisor_reports() -> None:
    silent = AUTO | {"known": False}
    assert shown(state=silent, stop_waits=True)["detail"] != shown(state=silent)["detail"]
    for programme, after in (("done", "acknowledge_first"), ("aborted", RETRACT)):
        line = shown(programme=programme, state=silent, stop_waits=True, recording="closed")
        assert line["after"] == ACTIONS[after]


@pytest.mark.parametrize(
    ("changed", "action"),
    [
        ({"cause": Cause.UNKNOWN}, "choose_auto"),
        ({"cause": Cause.STARTED}, "none"),
    ],
)
def test_in_hold_at_the_start_nothing_is_to_be_done(changed: Any, action: str) -> None:
    line = shown(state=AUTO | {"actual_mode": "hold", **changed})
    assert (line["code"], line["action"]) == ("mode", action)


@pytest.mark.parametrize(
    ("rule", "action"),
    [("quality", "see_marks"), ("recording", "check_recorder"), ("mode", "have_reviewed")],
)
def test_what_to_do_follows_from_the_rule_that_decides(rule: str, action: str) -> None:
    account = {"level": "medium", "rule": rule, "text": "so", "detail": ""}
    assert shown(account=account)["action"] == action


@pytest.mark.parametrize("account", [ACCOUNT, None], ids=["judged", "not judged"])
@pytest.mark.parametrize(
    ("programme", "state", "action"),
    [
        ("aborted", STOP, RETRACT),
        ("aborted", STOP | {"known": False}, RETRACT),
        ("aborted", STOP | {"acknowledged": True}, NEXT_OF_BAG["recording"]),
        ("aborted", {"actual_mode": "hold"}, NEXT_OF_BAG["recording"]),
        ("aborted", {"actual_mode": "manual"}, NEXT_OF_BAG["recording"]),
        ("aborted", {}, NEXT_OF_BAG["recording"]),
        ("done", {}, NEXT_OF_BAG["recording"]),
        ("done", STOP, "acknowledge_first"),
        ("running", STOP, "none"),
        ("", {}, "none"),
    ],
)
def test_what_follows_the_weld_is_said_once_it_is_over(
    programme: str, state: dict[str, Any], action: str, account: dict[str, str] | None
) -> None:
    top = shown(programme=programme, state=AUTO | state, account=account, recording="recording")
    assert top["after"] == ACTIONS[action]


@pytest.mark.parametrize(
    ("changed", "quantity", "kind", "side"),
    [
        ({"depth_mm": 3.65}, "depth_mm", "trip", "high"),
        ({"depth_mm": 1.3}, "depth_mm", "essential", "low"),
        ({"depth_mm": 3.5}, "depth_mm", "warn", "high"),
        ({"depth_mm": 2.77}, "depth_mm", "error", "high"),
        ({"temperature_c": 839.0}, "temperature_c", "error", "low"),
        (
            {"temperature_c": 911.0, "reference_temperature_c": 911.0},
            "temperature_c",
            "essential",
            "high",
        ),
        ({"force_kn": 74.0}, "force_kn", "deviation", "low"),
    ],
)
def test_flag_is_the_worst_of_a_quantity(
    changed: dict[str, float], quantity: str, kind: str, side: str
) -> None:
    outside = outside_now(GOOD | changed, None, default(), LIMITS)
    assert (
        list(outside) == [quantity]
        and outside[quantity][0]["kind"] == kind
        and outside[quantity][0]["text"].endswith(side)
    )


def test_nothing_is_flagged_of_a_good_weld_nor_of_what_is_not_known() -> None:
    assert outside_now(GOOD, None, default(), LIMITS) == {}
    assert outside_now(dict.fromkeys(GOOD, float("nan")), None, default(), LIMITS) == {}


def test_errors_are_from_the_programme_as_in_the_record() -> None:
    by_hand = GOOD | {"depth_mm": 2.8, "reference_depth_mm": 2.8}
    assert outside_now(by_hand, None, default(), LIMITS) == {}
    programme = {"depth_mm": 2.66, "temperature_c": 850.0, "phase": "joint_line"}
    assert outside_now(by_hand, programme, default(), LIMITS)["depth_mm"][0]["kind"] == "error"
    none = {"depth_mm": 0.0, "temperature_c": 0.0, "phase": ""}
    assert variables(by_hand, none)["depth_error_mm"] == 0.0, (
        "a player without a programme reports zeros"
    )


def test_limits_of_a_phase_hold_in_it_and_where_no_phase_is_known() -> None:
    narrow = Limit(variable="torque_nm", max=1000.0, phases=("joint_line",), source="test")
    book = default().model_copy(update={"quality": (narrow,)})
    columns = {name: np.full(3, value) for name, value in variables(GOOD).items()}
    flagged = flags(columns, np.array(["dwell", "joint_line", ""], object), book, LIMITS)
    assert [list(quantities) for quantities in flagged] == [[], ["torque_nm"], ["torque_nm"]]
