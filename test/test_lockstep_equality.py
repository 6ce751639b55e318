"""The same scenario in the graph in lockstep and in one process: the same trajectory."""

import numpy as np
import pytest

from fsw_analysis.changes import cut_to_scenario, part
from fsw_analysis.signals import load_weld
from fsw_control.free_domain import free_domain
from fsw_control.heat_plan import SHARE_NAME
from fsw_model import nominal
from fsw_model.heat_profile import HeatProfile, HeatSource, ThermalModel
from fsw_scenario.closed_loop import ClosedLoop
from fsw_scenario.controllers import make
from fsw_scenario.graph import WeldGraph
from fsw_scenario.launcher import Launcher
from fsw_scenario.scenario_file import load
from fsw_test_support.waiting import PATIENCE_S

CLOSED = """
name: everything
duration_s: 28.0
controller: nmpc
announced: true
plant:
  seed: 11
  start: {depth_mm: 2.7, temperature_c: 812.4}
  factors: {thermal_gain_c_per_kw: 1.1, depth_gain_mm_per_kn_s: 0.9}
events:
  - {at_s: 1.0, reference: {depth_mm: 2.72}}
  - {at_s: 2.0, reference: {temperature_c: 815.4, over_s: 2.5}}
  - {at_s: 5.0, disturbance: {channel: depth, shape: step, amplitude_mm: 0.05}}
  - {at_s: 6.0, disturbance: {channel: axial_force, shape: ramp, amplitude_kn: 0.5, duration_s: 1.5}}
  - {at_s: 7.0, disturbance: {channel: temperature, shape: sine, amplitude_c: 1.0, period_s: 5.0}}
  - {at_s: 7.1, disturbance: {channel: temperature, shape: random, amplitude_c: 0.5, period_s: 2.0}}
  - {at_s: 7.2, switch: decentral}
  - {at_s: 7.5, reference: {sine: {depth_mm: 0.02, temperature_c: 1.0, period_s: 4.0}}}
  - {at_s: 9.0, switch: nmpc}
  - {at_s: 10.0, fault: {sensor: torque, kind: nan, duration_s: 0.2}}
  - {at_s: 11.0, fault: {sensor: thermocouple, kind: bias, magnitude_c: 1.5, duration_s: 1.5}}
  - {at_s: 13.0, fault: {sensor: depth, kind: spike, magnitude_mm: 2.0}}
  - {at_s: 15.0, reference: {depth_mm: 2.66}}
  - {at_s: 15.0, disturbance: {channel: spindle_speed, shape: pulse, amplitude_rpm: 5.0, duration_s: 1.0}}
  - {at_s: 15.5, fault: {sensor: thermocouple, kind: nan, duration_s: 3.0}}
  - {at_s: 19.0, switch: nmpc}
  - {at_s: 23.0, fault: {sensor: depth, kind: dropout, duration_s: 0.2}}
  - {at_s: 23.5, fault: {sensor: depth, kind: nan, duration_s: 3.0}}
"""
OPEN = """
name: steps
duration_s: 15.0
controller: none
plant: {seed: 3}
events:
  - {at_s: 2.0, command: {force_kn: 80.4}}
  - {at_s: 5.0, command: {speed_rpm: 420.0}}
  - {at_s: 10.0, command: {force_kn: 78.4, speed_rpm: 407.6}}
"""
WELD = """
name: short_weld
controller: decentral
announced: true
phases:
  - {name: dwell, duration_s: 3.0}
  - {name: start, to_deg: 1.0, set_points: [{at_s: 1.0, depth_mm: 2.7}]}
  - {name: downward, to_deg: 2.0, length_mm: 12.0, set_points: [{at_s: 0.5, temperature_c: 819.4, over_s: 4.0}]}
  - {name: joint_line, to_deg: 5.0, set_points: [{at_s: 3.0, depth_mm: 2.66}]}
  - {name: overlap, to_deg: 6.0}
  - {name: parking, to_deg: 7.0, length_mm: 11.0, set_points: [{temperature_c: 816.4}]}
events:
  - {at_s: 2.0, disturbance: {channel: torque, shape: ramp, amplitude_nm: 10.0, duration_s: 30.0}}
  - {at_deg: 3.0, switch: nmpc}  # on the joint line, and back
  - {at_deg: 4.0, switch: decentral}
"""
#: with the heat of a profile; the dwell ends early, in its ramp: the plan and the set-points move
KNOWN = """
name: short_weld_with_known_heat
controller: nmpc
announced: true
plant:
  seed: 8
  process: canister
  start: {temperature_c: 795.0}
  canister: {lid_mm: 0.0, probe_radius_mm: 25.0, shoulder_share: 0.2, element_mm: 12.5, modes: 53}
phases:
  - {name: dwell, duration_s: 60.0, until_c: 803.0, set_points: [{temperature_c: 804.4, over_s: 25.0}]}
  - {name: start, to_deg: 2.0, length_mm: 20.0, set_points: [{at_s: 1.0, depth_mm: 2.7}]}
events:
  - {at_s: 61.0, disturbance: {channel: torque, shape: ramp, amplitude_nm: 10.0, duration_s: 30.0}}
  - {at_deg: 0.6, disturbance: {channel: depth, shape: step, amplitude_mm: 0.05}}
"""
PROFILE = HeatProfile(
    type="short_weld",
    model=ThermalModel.of(nominal()),
    welds=(HeatSource(weld="C001", sha256="a" * 64),),
    travel_mm=(0.0, 8.0, 12.0, 20.0),
    heat_kw=(0.0, 0.0, 1.0, 1.0),
    deviation_kw=(0.1, 0.1, 0.2, 0.1),
)
SIGNALS = (
    "reference_depth_mm",
    "reference_temperature_c",
    "force_kn",
    "speed_rpm",
    "depth_mm",
    "torque_nm",
    "temperature_c",
)
TRUTH = (
    "depth_mm",
    "temperature_c",
    "process_power_kw",
    "force_kn",
    "speed_rpm",
    "depth_disturbance_mm",
)


@pytest.mark.parametrize(
    "text",
    [
        pytest.param(CLOSED, id="closed"),
        pytest.param(OPEN, id="open", marks=pytest.mark.full),
        pytest.param(WELD, id="weld", marks=pytest.mark.full),
        pytest.param(KNOWN, id="known heat"),
    ],
)
def test_graph_in_lockstep_equals_one_process(text, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))  # of reduced canisters
    path = tmp_path / "scenario.yaml"
    path.write_text(text)
    scenario, heat, shares = load(path), None, []
    if text == KNOWN:
        heat = tmp_path / "heat.yaml"
        heat.write_text(PROFILE.text, encoding="utf-8")
    with free_domain() as domain, Launcher(tmp_path / "log", domain, PATIENCE_S) as launcher:
        graph = WeldGraph(scenario, tmp_path / "weld", heat=heat)
        elapsed_s = graph.run(launcher, shares.append)
    recorded = load_weld(graph.bag)
    assert recorded.problems == []
    assert recorded.attachments["scenario.yaml"] == scenario.text.encode()
    there = cut_to_scenario(recorded)
    here = ClosedLoop(
        scenario,
        {name: make(name) for name in scenario.controllers},
        PROFILE if text == KNOWN else None,
    ).run()

    # a dwell that ends early shortens the weld; the plant then goes on until the launcher ends it
    n = here.n_ticks
    assert there.n_ticks == n or ("until_c" in text and n < there.n_ticks < scenario.n_ticks + 50)
    there = part(there, slice(n))
    assert np.array_equal(there.stamp_ns, here.stamp_ns)
    assert list(there.command_source) == list(here.command_source)
    assert list(there.command_reason) == list(here.command_reason)
    assert list(there.truth.active_faults) == list(here.truth.active_faults)
    for name in SIGNALS:
        np.testing.assert_allclose(
            getattr(there, name), getattr(here, name), rtol=0.0, atol=1e-9, err_msg=name
        )
    for name in TRUTH:
        np.testing.assert_allclose(
            getattr(there.truth, name),
            getattr(here.truth, name),
            rtol=0.0,
            atol=1e-9,
            err_msg=f"truth {name}",
        )
    for name, status in here.statuses.items():
        for key, values in status.disturbances.items():
            if key == SHARE_NAME:
                recorded_share = there.statuses[name].disturbances[key]
                np.testing.assert_allclose(recorded_share, values, rtol=0.0, atol=1e-9)
    assert shares == sorted(shares)
    assert elapsed_s > 0.0


def test_the_known_heat_moves_the_speed(tmp_path):
    """So the plan has arrived in the graph where the trajectories are the same."""
    path = tmp_path / "scenario.yaml"
    path.write_text(KNOWN)
    with_heat, without = (
        ClosedLoop(load(path), {"nmpc": make("nmpc")}, heat).run() for heat in (PROFILE, None)
    )
    n = min(with_heat.n_ticks, without.n_ticks)
    assert n < 700  # the dwell ends early
    assert np.abs(with_heat.speed_rpm[:n] - without.speed_rpm[:n]).max() > 1.0
    assert np.isfinite(with_heat.statuses["nmpc"].disturbances[SHARE_NAME]).all()


def test_the_courses_of_force_and_speed_are_not_trivial(tmp_path):
    """What the test above compares does move: else it could not fail."""
    path = tmp_path / "scenario.yaml"
    path.write_text(CLOSED)
    scenario = load(path)
    signals = ClosedLoop(scenario, {name: make(name) for name in scenario.controllers}).run()
    assert {"nmpc", "decentral", "hold"} <= set(signals.command_source)
    assert np.ptp(signals.force_kn) > 1.0
    assert np.ptp(signals.speed_rpm) > 10.0
    assert np.isnan(signals.torque_nm).sum() == 2
    assert np.ptp(signals.reference_depth_mm) > 0.05
