"""Figures of merit, on signals whose figures are known beforehand."""

import json
from dataclasses import astuple, replace
from pathlib import Path

import numpy as np
import pytest

from fsw_analysis import kpi, kpi_table, phase_kpi
from fsw_analysis.changes import changes, cut_to_scenario, missing_at_end_s
from fsw_analysis.weld_signals import (
    StatusSignals,
    TruthSignals,
    WeldEvent,
    WeldSignals,
    experiment_time_s,
)
from fsw_control.schema.errors import InputError

N = 1000


def truth(n=N, **columns):
    values = {
        name: np.zeros(n) for name in TruthSignals.__dataclass_fields__ if name != "active_faults"
    }
    return TruthSignals(**(values | columns), active_faults=np.full(n, "", dtype=object))


def signals(n=N, **columns):
    """A weld at rest on its set-points, with some columns replaced."""
    numbers = {
        "depth_mm": 2.66,
        "torque_nm": 1052.0,
        "temperature_c": 850.0,
        "reference_depth_mm": 2.66,
        "reference_temperature_c": 850.0,
        "force_kn": 78.4,
        "speed_rpm": 407.6,
        "command_latency_s": 0.0,
    }
    values = {name: np.full(n, value) for name, value in numbers.items()}
    texts = ("command_source", "command_reason", "actual_controller", "actual_mode")
    values |= {
        name: np.full(n, "decentral" if name == "command_source" else "", dtype=object)
        for name in texts
    }
    stamps = (np.arange(n, dtype=np.int64) + 1) * 100_000_000
    values |= {"stamp_ns": stamps, "time_s": experiment_time_s(stamps), "path": Path("weld")}
    return WeldSignals(**(values | columns))


def test_figures_of_a_phase_are_against_the_programme_and_beside_it_against_what_was_in_force():
    weld = signals()
    same = phase_kpi.compute(weld, "one", [])[0]
    assert same.temperature_c == same.in_force_temperature_c
    weld.programme_temperature_c = (
        weld.reference_temperature_c + 31.4
    )  # held, and 31.4 degC lower by hand
    off = phase_kpi.compute(weld, "one", [])[0]
    assert off.in_force_temperature_c == same.temperature_c
    assert off.temperature_c.mean == pytest.approx(same.temperature_c.mean - 31.4)
    assert "in force" in phase_kpi.markdown([[off]]) and "in force" not in phase_kpi.markdown(
        [[same]]
    )


def test_figures_of_phases_are_those_of_their_ticks(tmp_path):
    error = np.concatenate([np.full(300, 1.0), np.full(600, -2.0), np.full(100, np.nan)])
    weld = signals(temperature_c=850.0 + error)
    spans = [("dwell", 0.0, 30.0), ("start", 30.0, 90.0), ("parking", 90.0, 100.0)]
    dwell, start, parking, whole = figures = phase_kpi.compute(weld, "one", spans)
    assert dwell.temperature_c == phase_kpi.ErrorStatistics(1.0, 0.0, 1.0, 1.0)
    assert astuple(start.temperature_c) == (-2.0, 0.0, -2.0, -2.0) and not any(
        astuple(start.depth_mm)
    )
    assert parking.temperature_c is None and parking.power_kw is None
    assert astuple(whole.temperature_c) == pytest.approx((-1.0, np.sqrt(2.0), -2.0, 1.0))
    table = phase_kpi.markdown([figures])
    assert [row.phase for row in figures] == ["dwell", "start", "parking", "whole weld"]
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in table.splitlines()]
    assert ["whole weld", "one", "-1.00, 1.41, -2.00, +1.00", "+0.0, 0.0, +0.0, +0.0", "-"] in rows
    assert ["published, 8 real welds", "cascade", "+0.6, 1.0, -7.0, +8.0", "-", "-"] in rows


def test_a_weld_at_rest_has_no_error():
    result = kpi.compute(signals())
    assert result["iae_depth_mm_s"] == result["ise_temperature_c2_s"] == 0.0
    assert result["in_dead_band_depth_share"] == 1.0
    assert result["total_variation_force_kn"] == 0.0
    assert result["events"] == []
    assert result["outputs"] == "measured"
    assert result["controllers"] == ["decentral"]


def test_integrals_shares_and_variation():
    depth = np.full(N, 2.66)
    depth[100:200] += 0.01
    force = np.full(N, 78.4)
    force[10:20] += 0.5
    result = kpi.compute(signals(depth_mm=depth, force_kn=force))
    assert result["iae_depth_mm_s"] == pytest.approx(0.01 * 10.0)
    assert result["ise_depth_mm2_s"] == pytest.approx(1e-4 * 10.0)
    assert result["in_dead_band_depth_share"] == pytest.approx(0.9)
    assert result["total_variation_force_kn"] == pytest.approx(1.0)


def test_step_response_of_first_order_with_overshoot():
    reference = np.full(N, 2.66)
    reference[200:] = 2.86
    time_s = np.arange(N - 200) * 0.1
    depth = np.full(N, 2.66)
    depth[200:] = 2.86 - 0.2 * np.exp(-time_s / 5.0)
    depth[500] = 2.868  # 8 um beyond, within the 5 % band
    temperature = np.full(N, 850.0)
    temperature[230] = 849.6
    result = kpi.compute(
        signals(depth_mm=depth, reference_depth_mm=reference, temperature_c=temperature)
    )
    (event,) = result["events"]
    assert event["time_s"] == pytest.approx(20.1)
    assert event["kind"] == "step"
    assert event["size_mm"] == pytest.approx(0.2)
    assert event["overshoot_mm"] == pytest.approx(0.008)
    assert event["overshoot_percent"] == pytest.approx(4.0)
    assert event["settling_s"] == pytest.approx(5.0 * np.log(20.0), abs=0.1)
    assert result["peak_temperature_in_depth_step_up_c"] == pytest.approx(0.4)
    assert result["peak_temperature_in_depth_step_down_c"] is None
    assert result["steps_not_settled"] == 0


def test_disturbance_overshoot_is_on_the_other_side_and_truth_counts():
    disturbance = np.zeros(N)
    disturbance[200:] = 0.1
    depth = np.full(N, 2.66)
    depth[200:400] = 2.76
    depth[400:500] = 2.65
    noisy = depth + 0.5
    weld = signals(depth_mm=noisy)
    weld.truth = truth(
        depth_mm=depth, temperature_c=np.full(N, 850.0), depth_disturbance_mm=disturbance
    )
    result = kpi.compute(weld)
    (event,) = result["events"]
    assert result["outputs"] == "truth"
    assert event["quantity"] == "depth_disturbance"
    assert event["overshoot_mm"] == pytest.approx(0.01)
    assert event["settling_s"] == pytest.approx(30.0)
    assert result["peak_temperature_after_depth_disturbance_c"] == 0.0


def test_an_error_that_stays_never_settles():
    reference = np.full(N, 850.0)
    reference[500:] = 860.0
    result = kpi.compute(signals(reference_temperature_c=reference))
    assert result["events"][0]["settling_s"] is None
    assert result["steps_not_settled"] == 1
    assert result["longest_settling_s"] is None


def test_ramps_and_sines_are_one_event_and_simultaneous_ones_do_not_count_as_coupling():
    ramp = np.full(N, 2.66)
    ramp[100:131] = np.linspace(2.66, 2.96, 31)
    ramp[131:] = 2.96
    temperature = np.full(N, 850.0)
    temperature[600:] = 855.0
    ramp[600:] = 2.9
    steps = changes(signals(reference_depth_mm=ramp, reference_temperature_c=temperature))
    assert [(change.quantity, change.is_step) for change in steps] == [
        ("depth_reference", False),
        ("depth_reference", True),
        ("temperature_reference", True),
    ]
    assert steps[0].size == pytest.approx(0.3)
    result = kpi.compute(signals(reference_depth_mm=ramp, reference_temperature_c=temperature))
    assert result["peak_depth_in_temperature_step_mm"] is None


def test_missing_values_are_counted_not_guessed():
    depth = np.full(N, np.nan)
    result = kpi.compute(signals(depth_mm=depth, reference_depth_mm=depth, force_kn=depth))
    assert result["iae_depth_mm_s"] is None
    assert result["total_variation_force_kn"] is None
    assert result["ticks_without_output"] == N
    json.dumps(result, allow_nan=False)
    assert "IAE depth" not in kpi_table.markdown([result])


def test_too_short_a_weld_is_an_error():
    with pytest.raises(InputError, match="at least 2"):
        kpi.compute(signals(n=1))


def test_solve_times():
    column = np.full(N, 0.0005)
    texts = np.full(N, "", dtype=object)
    status = StatusSignals(*[column] * 8, texts, texts, texts)
    result = kpi.compute(replace(signals(), statuses={"nmpc": status}))
    assert result["solve_time_nmpc_p99_ms"] == pytest.approx(0.5)
    assert "ms" not in kpi_table.markdown([result])


def test_tables_and_files(tmp_path):
    depth = np.full(N, 2.67)
    runs = [
        kpi.compute(signals(depth_mm=depth), "one"),
        kpi.compute(signals(depth_mm=depth + 0.01), "two"),
    ]
    head, rule, *lines = kpi_table.markdown(runs).splitlines()
    assert (
        head.replace(" ", "") == "||unit|one|two|difference|"
        and rule.replace("-", "") == "|  |  | : | : | : |"
    )
    assert "+100.0 %" in next(line for line in lines if line.startswith("| IAE depth"))
    assert {len(line) for line in lines} == {len(head)}
    assert "points" in next(line for line in lines if line.startswith("| time within +-2 um"))
    json_path, table_path = kpi_table.write_both(runs, kpi_table.markdown(runs), tmp_path / "kpi")
    assert json.loads(json_path.read_text())[1]["label"] == "two"
    assert table_path.read_text() == kpi_table.markdown(runs)


def test_ticks_after_the_scenario_are_cut():
    weld = signals()
    weld.truth = truth()
    weld.attachments = {"scenario.yaml": b"{name: x, duration_s: 50.0}"}
    cut = cut_to_scenario(weld)
    assert cut.n_ticks == 500
    assert cut.truth.depth_mm.size == 500
    assert weld.n_ticks == N
    weld.attachments = {"scenario.yaml": b"["}
    assert cut_to_scenario(weld) is weld


@pytest.mark.parametrize(
    ("scenario", "missing_s"),
    [
        ("duration_s: 100.0", 0.0),
        ("duration_s: 100.2", 0.0),
        ("duration_s: 103.0", 3.0),
        ("phases: []", 0.0),
        ("", 0.0),
    ],
)
def test_the_end_that_a_scenario_has_and_the_bag_lacks(scenario, missing_s):
    weld = signals()
    assert weld.time_s[-1] == pytest.approx(100.0)
    weld.attachments = {"scenario.yaml": f"{{name: x, {scenario}}}".encode()} if scenario else {}
    assert missing_at_end_s(weld) == pytest.approx(missing_s)


@pytest.mark.parametrize(
    ("states", "on_record"),
    [((), False), (("held", "resumed"), False), (("done",), True), (("aborted",), True)],
)
def test_a_programme_without_a_duration_has_its_end_on_record(states, on_record):
    weld = signals()
    weld.attachments = {"scenario.yaml": b"{name: x, phases: [{name: dwell}]}"}
    weld.phases = [("dwell", 0.1)]
    weld.events = [WeldEvent(5.0, "weld", state) for state in states]
    missing_s = missing_at_end_s(weld)
    assert missing_s == 0.0 if on_record else np.isnan(missing_s)
