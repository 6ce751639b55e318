"""Samples become rows, rows become frames."""

import json
from math import nan

import pytest

from fsw_control.contract import Command, Reference
from fsw_hmi.frames import COLUMNS, frame, row
from fsw_hmi.hub import BLOCK, History
from fsw_hmi.weld_view import WeldView

TICK_NS = 100_000_000
START_NS = 1_700_000_000_000_000_000
ACTING = Command(78.0, 400.0)
SAMPLES = {"depth": 2.66, "torque": 1000.0, "thermocouple": 816.0}


def view():
    return WeldView(lambda _: Reference(2.7, 820.0))


def tick(weld_view, number, samples=SAMPLES, drives=True):
    """Rows that a tick brings."""
    stamp_ns, now_s = START_NS + number * TICK_NS, 0.1 * number
    rows = weld_view.on_drives(stamp_ns, ACTING, now_s)[0] if drives else []
    for sensor, value in samples.items():
        rows += weld_view.on_sample(sensor, stamp_ns, value, now_s)
    return rows


def named(values):
    return dict(zip(COLUMNS[1:], values, strict=True))


def test_row_is_over_when_all_sensors_have_come():
    weld_view = view()
    weld_view.on_command(START_NS, Command(78.5, 401.0), 0.0)
    (only,) = tick(weld_view, 0)
    assert only.stamp_ns == START_NS
    values = named(only.values)
    assert (values["depth_mm"], values["temperature_c"], values["torque_nm"]) == (
        2.66,
        816.0,
        1000.0,
    )
    assert (values["force_kn"], values["speed_rpm"]) == (78.0, 400.0)
    assert values["power_kw"] == pytest.approx(41.888, abs=1e-3)
    assert (values["reference_depth_mm"], values["reference_temperature_c"]) == (2.7, 820.0)
    assert (values["command_force_kn"], values["command_speed_rpm"]) == (78.5, 401.0)


def test_row_without_a_sensor_is_over_when_the_next_tick_begins():
    weld_view = view()
    assert tick(weld_view, 0, {"depth": 2.66, "torque": 1000.0}) == []
    rows = tick(weld_view, 1)
    assert [row.stamp_ns for row in rows] == [START_NS, START_NS + TICK_NS]
    assert str(named(rows[0].values)["temperature_c"]) == "nan"


def test_samples_before_the_drives_and_late_ones():
    weld_view = view()
    assert tick(weld_view, 0, drives=False) == []
    assert len(tick(weld_view, 0, {})) == 1
    assert weld_view.on_sample("depth", START_NS, 2.0, 0.0) == []  # again
    assert (
        weld_view.on_sample("depth", START_NS - 50 * TICK_NS, 2.0, 0.0) == []
    )  # delayed by a fault
    assert len(tick(weld_view, 1)) == 1


def test_of_several_samples_with_one_stamp_the_first_counts():
    weld_view = view()
    tick(weld_view, 0, {"depth": 2.66}, drives=False)
    tick(weld_view, 0, {"depth": 2.0}, drives=False)
    (only,) = tick(weld_view, 0, {"torque": 1000.0, "thermocouple": 816.0})
    assert named(only.values)["depth_mm"] == 2.66


def test_samples_of_another_clock_do_not_pile_up():
    weld_view = view()
    for number in range(200):
        weld_view.on_sample("depth", START_NS + 10**15 + number, 2.0, 0.0)
        assert len(tick(weld_view, number)) == 1
    assert len(weld_view._samples) <= 20


def test_latency_is_from_measurement_to_command():
    weld_view = view()
    tick(weld_view, 0)
    weld_view.on_command(START_NS, ACTING, 0.0125)
    (second,) = tick(weld_view, 1)
    assert named(second.values)["latency_ms"] == pytest.approx(12.5)


def test_time_that_goes_back_begins_another_weld():
    weld_view = view()
    tick(weld_view, 100)
    assert weld_view.on_drives(START_NS + 99 * TICK_NS, ACTING, 0.0) == ([], False)
    rows, restarted = weld_view.on_drives(START_NS, ACTING, 0.0)
    assert (rows, restarted) == ([], True)
    assert len(tick(weld_view, 0, drives=False)) == 1


def test_sensor_is_good_when_its_sample_is_a_number():
    weld_view = view()
    tick(weld_view, 0)
    tick(weld_view, 1, SAMPLES | {"depth": nan})
    assert (weld_view.good_s["depth"], weld_view.good_s["torque"]) == (0.0, 0.1)


def test_row_as_text():
    text = row(START_NS + 123_456_789, (2.664999, nan, 123456.0, 0.0))
    assert json.loads(text) == [1_700_000_000.123, 2.665, None, 123460.0, 0.0]


def test_frame_refuses_what_is_no_json():
    assert json.loads(frame("beat", {"a": None})) == {"t": "beat", "a": None}
    with pytest.raises(ValueError):
        frame("beat", {"a": nan})


def test_history_comes_in_blocks_from_the_newest_on():
    history = History()
    for number in range(2 * BLOCK + 5):
        history.add(f"[{number}]")
    frames = [json.loads(frame)["rows"] for frame in history.frames()]
    assert [(len(rows), rows[0], rows[-1]) for rows in frames] == [
        (5, [2 * BLOCK], [2 * BLOCK + 4]),
        (BLOCK, [BLOCK], [2 * BLOCK - 1]),
        (BLOCK, [0], [BLOCK - 1]),
    ]
    assert History().frames() == []


def test_history_is_bounded():
    history = History()
    for _ in range(70 * BLOCK):
        history.add("[0]")
    assert len(history.frames()) == 60
