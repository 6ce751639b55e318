"""The weld so far, as the page judges it."""

from math import nan

from fsw_analysis.rule_book import default
from fsw_control.cause import Cause
from fsw_hmi.frames import COLUMNS
from fsw_hmi.live_weld import LiveWeld
from fsw_hmi.weld_view import Row
from fsw_test_support import hmi_situation

GOOD = hmi_situation.GOOD | {"torque_nm": 1060.0, "power_kw": 45.0}
STATE = {
    "actual_controller": "nmpc",
    "actual_mode": "auto",
    "reason": "",
    "cause": Cause.READY,
    "by": "",
    "interlocks": [],
}
PROGRESS = {"state": "running", "phase": "joint_line", "angle_deg": 0.0, "length_mm": 0.0}


def test_samples_of_the_first_tick_may_be_missing():
    weld = LiveWeld(default())
    for number in range(3):
        weld.add(Row(number * 10**8, (nan,) * (len(COLUMNS) - 1)), "nmpc")
        assert (weld.account() is None) is (number == 0)


def test_what_the_page_did_not_see_is_no_gap_of_the_record():
    weld = LiveWeld(default())
    weld.on_progress(PROGRESS)
    weld.on_state("a", STATE)
    for tick in [*range(20), *range(95, 130)]:  # 7.5 s
        weld.add(Row(tick * 10**8, tuple(GOOD.get(name, 0.0) for name in COLUMNS[1:])), "nmpc")
    assert {rule.name for rule in weld.account().rules if rule.verdict != "accept"} == set()
    shown = weld.frame()
    (mark,) = shown["marks"]
    assert (shown["level"], mark["level"], mark["lasts_s"]) == ("medium", "medium", 7.5)


def test_a_weld_of_which_only_the_end_was_seen_is_not_judged():
    weld = LiveWeld(default())
    weld.on_progress(PROGRESS | {"state": "done", "angle_deg": 361.0})
    weld.add(Row(10**8, tuple(GOOD.get(name, 0.0) for name in COLUMNS[1:])), "nmpc")
    assert weld.account() is None
    weld.on_progress(PROGRESS)
    weld.add(Row(2 * 10**8, tuple(GOOD.get(name, 0.0) for name in COLUMNS[1:])), "nmpc")
    assert weld.account() is not None
