"""How far a safe stop has come."""

from __future__ import annotations

from math import nan

import pytest

from fsw_hmi.limits import StopKind, StopProgress

SAFE = {"force_kn": 65.0, "rate_kn_per_s": 2.0}


def kind(
    stop: StopProgress, time_s: float, force_kn: float, stopped: bool = True
) -> StopKind | None:
    state = stop.at(stopped, {"time_s": time_s, "force_kn": force_kn}, SAFE)
    return None if state is None else state["kind"]


def test_a_force_that_follows_the_ramp_reaches_the_safe_one() -> None:
    stop = StopProgress()
    assert stop.at(False, {"time_s": 0.0, "force_kn": 78.0}, SAFE) is None
    forces = [max(65.0, 78.0 - 2.0 * 0.1 * tick) for tick in range(80)]
    states = [
        stop.at(True, {"time_s": 0.1 * tick, "force_kn": force}, SAFE)
        for tick, force in enumerate(forces)
    ]
    kinds = [state["kind"] for state in states if state]
    assert set(kinds[:60]) == {StopKind.FALLING} and set(kinds[60:]) == {StopKind.SAFE}
    shares = [state["share"] for state in states if state]
    assert shares[0] == 0.0 and shares == sorted(shares) and shares[-1] == 1.0
    assert states[0] is not None and states[0]["left_s"] == pytest.approx(6.5)


@pytest.mark.parametrize(
    ("after_s", "expected"), [(2.4, StopKind.FALLING), (2.6, StopKind.NOT_FALLING)]
)
def test_a_force_that_stays_is_reported_after_the_ramp_s_delay(
    after_s: float, expected: StopKind
) -> None:
    """2 s late and 1 kN above the ramp of 2 kN/s are allowed: 2.5 s."""
    stop = StopProgress()
    assert kind(stop, 100.0, 78.0) is StopKind.FALLING
    assert kind(stop, 100.0 + after_s, 78.0) is expected
    assert kind(stop, 100.0 + after_s, 66.0) is StopKind.SAFE


def test_the_next_stop_begins_with_its_own_force() -> None:
    stop = StopProgress()
    kind(stop, 0.0, 90.0)
    assert kind(stop, 10.0, 90.0) is StopKind.NOT_FALLING
    assert kind(stop, 11.0, 90.0, stopped=False) is None
    assert kind(stop, 12.0, 90.0) is StopKind.FALLING


def test_without_a_force_or_the_ramp_nothing_is_compared() -> None:
    stop = StopProgress()
    assert kind(stop, 0.0, nan) is None, "it has not begun where no force is known"
    assert kind(stop, 0.1, 78.0) is StopKind.FALLING
    assert kind(stop, 9.0, nan) is StopKind.UNKNOWN
    assert stop.at(True, {"time_s": 9.1, "force_kn": 78.0}, None) == {"kind": StopKind.UNKNOWN}
