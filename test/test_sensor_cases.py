"""Sensor faults in the closed loop, by the plant's true values.

The weld stops in time, and the cause is named.
"""

import re
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

import fsw
from fsw_scenario.closed_loop import ClosedLoop
from fsw_scenario.controllers import make
from fsw_scenario.scenario_file import load

CASES = Path(__file__).parent / "cases"
FAULT_S = 40.0
CONTROLLERS = ("decentral", "nmpc")


class Outcome(NamedTuple):
    """What became of a weld with a fault."""

    stopped_s: float  #: from the fault to the safe stop; NaN: never
    causes: set[str]  #: names of the causes
    deepest_mm: float  #: true depth since the fault
    hottest_c: float  #: true temperature of the copper since the fault


def welded(scenario, controller, at_s=FAULT_S, **options):
    signals = fsw.simulate(scenario, controller=controller, **options).signals
    stops = np.flatnonzero(signals.actual_mode == "safe_stop")
    since = signals.time_s >= at_s - 0.05
    reason = signals.command_reason[stops[0]] if stops.size else ""
    return Outcome(
        float(signals.time_s[stops[0]]) - at_s if stops.size else float("nan"),
        set(re.findall(r"[a-z]+_[a-z_]+", reason)),
        float(signals.truth.depth_mm[since].max()),
        float(signals.truth.copper_temperature_c[since].max()),
    )


@pytest.fixture
def case(tmp_path):
    """Writes a scenario with faults of a sensor: ``(at_s, kind, values)``."""

    def write(sensor, *faults):
        lines = [
            f"  - {{at_s: {at_s}, fault: {{sensor: {sensor}, kind: {kind}{values}}}}}"
            for at_s, kind, values in faults
        ]
        path = tmp_path / "case.yaml"
        path.write_text(
            "\n".join(
                ["name: case", "duration_s: 80.0", "controller: decentral", "events:", *lines]
            )
        )
        return path

    return write


@pytest.mark.requirement("S35")
@pytest.mark.parametrize("controller", CONTROLLERS)
def test_a_depth_sensor_that_slips_moves_no_tool(controller):
    outcome = welded(CASES / "lost_contact.yaml", controller)
    assert outcome.stopped_s <= 0.5
    assert {"depth_jump", "depth_low"} <= outcome.causes
    assert outcome.deepest_mm < 2.68
    assert outcome.hottest_c < 830.0


@pytest.mark.requirement("S35")
@pytest.mark.parametrize("controller", CONTROLLERS)
def test_a_broken_probe_stops_the_weld_before_the_copper_is_hot(controller):
    outcome = welded(CASES / "broken_probe.yaml", controller)
    assert outcome.stopped_s <= 0.5
    assert outcome.causes & {"torque_jump", "torque_model_low", "torque_low"}
    assert outcome.hottest_c < 830.0


@pytest.mark.requirement("S35")
@pytest.mark.parametrize("controller", CONTROLLERS)
@pytest.mark.parametrize("slip_mm", [2.0, -2.0, -1.0, -0.6, -0.45])
@pytest.mark.parametrize("ticks", [1, 3])
def test_a_slip_is_caught_at_once_or_spread_over_some_ticks(case, controller, slip_mm, ticks):
    faults = [
        (FAULT_S + 0.1 * k, "bias", f", magnitude_mm: {slip_mm * (k + 1) / ticks:.4f}")
        for k in range(ticks)
    ]
    outcome = welded(case("depth", *faults), controller)
    assert outcome.stopped_s <= 0.6
    assert any(cause.startswith(("depth_", "torque_model")) for cause in outcome.causes)
    assert outcome.deepest_mm < 2.68


@pytest.mark.requirement("S36")
@pytest.mark.parametrize("controller", CONTROLLERS)
@pytest.mark.parametrize(
    ("sensor", "unit", "off", "cause"),
    [
        ("torque", "nm", 650.0, "torque_high"),
        ("torque", "nm", 2000.0, "torque_high"),
        ("thermocouple", "c", 100.0, "temperature_high"),
        ("thermocouple", "c", 290.0, "temperature_high"),
        ("thermocouple", "c", 900.0, "temperature_high"),
    ],
)
def test_the_worse_the_fault_the_stop_is_no_later(case, controller, sensor, unit, off, cause):
    outcome = welded(case(sensor, (FAULT_S, "bias", f", magnitude_{unit}: {off}")), controller)
    assert outcome.stopped_s <= 0.5
    assert cause in outcome.causes


@pytest.mark.requirement("S37")
@pytest.mark.parametrize("controller", CONTROLLERS)
def test_a_sensor_that_is_mostly_away_ends_the_weld(case, controller):
    """0.4 s of good samples in every 14.4 s."""
    faults = [(20.0 + 14.4 * k, "nan", ", duration_s: 14.0") for k in range(4)]
    outcome = welded(case("torque", *faults), controller, at_s=20.0)
    assert outcome.stopped_s == pytest.approx(12.3, abs=0.3)
    assert outcome.causes == {"torque_blind"}


@pytest.mark.requirement("S35", "S37")
@pytest.mark.parametrize("controller", CONTROLLERS)
@pytest.mark.parametrize(
    "scenario", ["output_disturbances", "model_uncertainty", "simultaneous_events", "quick"]
)
def test_a_weld_without_a_fault_does_not_trip(controller, scenario):
    controllers = {
        name: make(name) for name in CONTROLLERS
    }  # of several, the supervisor applies one
    signals = ClosedLoop(load(scenario, [f"controller={controller}"]), controllers).run()
    assert set(signals.actual_mode[10:]) == {"auto"}


@pytest.mark.parametrize("controller", CONTROLLERS)
@pytest.mark.parametrize("plant", [{}, {"sensors.torque_resolution_nm": 0.0}])
@pytest.mark.parametrize("scenario", ["output_disturbances", "reference_tracking", "quick"])
def test_without_noise_no_sensor_is_frozen(scenario, controller, plant):
    quiet = {
        f"sensors.{name}": 0.0
        for name in ("depth_noise_mm", "torque_noise_nm", "temperature_noise_c")
    }
    signals = fsw.simulate(scenario, controller=controller, plant=quiet | plant).signals
    assert signals.proposals[controller].healthy.all()
