"""Plant, sensors and their clock fail: what reached the plant, tick by tick."""

from __future__ import annotations

import signal
import time

import pytest

from fsw_msgs.srv import SetFault


@pytest.mark.real_time
@pytest.mark.full
def test_the_plant_is_stopped_and_continued(weld, table):
    weld.restore()
    weld.signal("plant", signal.SIGSTOP)
    count = len(weld.truths)
    end_s = time.monotonic() + 1.5
    weld.until(lambda: time.monotonic() > end_s)
    weld.signal("plant", signal.SIGCONT)
    weld.ticks(20)
    outcome = weld.outcome(count)
    outcome.assert_steady(lost=3)
    weld.a_controller_commands()
    table.add(
        "plant stopped for 1.5 s and continued",
        "gap in the measurements",
        "restarts from the actual force and speed",
        outcome,
    )


@pytest.mark.real_time
def test_the_plant_is_killed_and_started_again(weld, table):
    weld.restore()
    weld.kill_the_plant()
    first = len(weld.truths)
    weld.start("plant")
    weld.until(lambda: len(weld.truths) > first, what="the next measurement")
    weld.ticks(25)
    outcome = weld.outcome(first)
    outcome.assert_steady(lost=5)
    weld.a_controller_commands()
    table.add(
        "plant killed (-9) and started again",
        "gap in the measurements",
        "restarts from the actual force and speed",
        outcome,
    )


KINDS = ("nan", "dropout", "freeze", "spike", "delay", "duplicate")
#: A delay of the thermocouple waits for the deadline many times.
DEFAULT = {
    "depth": ("nan", "dropout", "freeze", "spike", "delay"),
    "thermocouple": ("nan", "freeze", "spike"),
}


@pytest.mark.requirement("S8")
@pytest.mark.parametrize(
    ("sensor", "kind"),
    [
        pytest.param(
            sensor, kind, marks=[] if kind in DEFAULT.get(sensor, ()) else pytest.mark.full
        )
        for sensor in ("depth", "torque", "thermocouple")
        for kind in KINDS
    ],
)
def test_a_sensor_fails(steps, table, sensor, kind):
    first = steps.restore()
    magnitude = {
        "spike": {"depth": 1e-3, "torque": 300.0, "thermocouple": 60.0}[sensor],
        "delay": 0.3,
    }.get(kind, 0.0)
    duration_s = 1.0 if kind == "delay" else 3.0
    steps.call(
        steps.faults,
        SetFault.Request(sensor=sensor, kind=kind, magnitude=magnitude, duration=duration_s),
    )
    steps.ticks(60)
    outcome = steps.outcome(first)
    outcome.assert_steady(depth_mm=0.25)
    reaction = "held 0.3 s, then a controller that tolerates it, else hold"
    table.add(
        f"sensor fault `{kind}` of {duration_s:g} s, each sensor, lockstep",
        "validity",
        reaction,
        outcome,
    )


def test_the_plant_of_lockstep_is_killed_and_restarts_its_time(steps, table):
    steps.restore()
    steps.kill_the_plant()
    known = len(steps.truths)
    steps.start("plant")
    steps.until(lambda: steps.new_time(known), what="a time that begins anew")
    steps.ticks(40)
    outcome = steps.outcome(steps.new_time(known))
    outcome.assert_steady()
    assert steps.source() == "decentral"
    table.add(
        "plant killed (-9) in lockstep, its time restarts",
        "stamps go back",
        "restarts from the actual force and speed",
        outcome,
    )


@pytest.mark.requirement("S8")
@pytest.mark.full
def test_a_third_of_the_measurements_is_lost(launch, table):
    weld = launch(lockstep=True, relayed=True)
    first = weld.restore()
    weld.relay.loss = 0.3
    weld.ticks(15)
    weld.relay.loss = 0.0
    outcome = weld.outcome(first)
    outcome.assert_steady()
    assert "safe_stop" not in outcome.sources
    weld.a_controller_commands()
    table.add(
        "30 % of the samples of every sensor lost",
        "validity",
        "held 0.3 s, then fallback or hold",
        outcome,
    )


@pytest.mark.requirement("S15")
@pytest.mark.parametrize("hours", [pytest.param(1, marks=pytest.mark.full), -1])
def test_the_clock_of_the_measurements_jumps(launch, table, hours):
    weld = launch(lockstep=True, relayed=True)
    first = weld.restore()
    weld.relay.shift_ns += hours * 3600 * 10**9
    weld.ticks(30)
    outcome = weld.outcome(first)
    outcome.assert_steady(lost=1)
    weld.a_controller_commands()
    table.add(
        "clock of the measurements jumps by an hour, forth and back",
        "two sensors agree",
        "continues",
        outcome,
    )
