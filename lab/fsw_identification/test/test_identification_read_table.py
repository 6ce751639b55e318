"""Logs of machines as signals: names, units, sampling rates, and errors with their place."""

import numpy as np
import pytest

from fsw_analysis.weld_signals import export_weld
from fsw_control.schema.models import InputError
from fsw_identification.read_table import read_table

N = 30
LOG = {
    "time_s": np.arange(N) * 0.02,
    "depth_mm": np.linspace(2.6, 2.7, N),
    "temperature_c": np.linspace(810.0, 820.0, N),
    "torque_nm": np.linspace(1000.0, 1010.0, N),
    "force_kn": np.linspace(78.0, 79.0, N),
    "speed_rpm": np.linspace(400.0, 401.0, N),
}
EPOCH = np.datetime64("2026-05-01T10:00:00", "ns")


def changed(**columns):
    """The log with other columns; None: without it."""
    return {name: cells for name, cells in (LOG | columns).items() if cells is not None}


def written(path, header, *rows):
    path.write_text("\n".join([header, *rows]), encoding="cp1252")
    return path


def test_samples_are_brought_to_ticks():
    signals = read_table(LOG)
    assert signals.time_s == pytest.approx([0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7])
    near_second = np.abs(LOG["time_s"] - 0.1) < 0.049
    assert signals.depth_mm[1] == pytest.approx(LOG["depth_mm"][near_second].mean())
    assert signals.drives.force_kn == pytest.approx(signals.force_kn)


def test_a_slower_log_has_ticks_for_its_samples_only():
    signals = read_table(changed(time_s=np.arange(N) * 1.0))
    assert signals.n_ticks == N and signals.stamp_ns[1] - signals.stamp_ns[0] == 10**9


@pytest.mark.parametrize(
    ("header", "cells", "name"),
    [
        ("Axial force [N]", LOG["force_kn"] * 1e3, "force_kn"),
        ("Spindle speed (rad/s)", LOG["speed_rpm"] * np.pi / 30.0, "speed_rpm"),
        ("tool_temperature_k", LOG["temperature_c"] + 273.15, "temperature_c"),
        ("depth_m", LOG["depth_mm"] * 1e-3, "depth_mm"),
        ("Time / (min)", LOG["time_s"] / 60.0, "time_s"),
    ],
)
def test_names_and_units_are_known(header, cells, name):
    signals, same = read_table(changed(**{name: None, header: cells})), read_table(LOG)
    assert getattr(signals, name) == pytest.approx(getattr(same, name))


def test_a_column_of_any_name_is_given_by_quantity_and_unit():
    signals = read_table(changed(force_kn=None, F=LOG["force_kn"] * 1e3), {"force_n": "F"})
    assert signals.force_kn == pytest.approx(read_table(LOG).force_kn)


@pytest.mark.parametrize(
    ("name", "other"),
    [
        ("depth_mm", "reference_depth_mm"),
        ("depth_mm", "Target depth [mm]"),
        ("force_kn", "Traverse force [kN]"),
        ("temperature_c", "Motor temperature [C]"),
        ("speed_rpm", "speed_setpoint_rpm"),
        ("time_s", "Cycle time [s]"),
    ],
)
def test_set_points_and_ambiguous_columns_are_not_measurements(name, other):
    with pytest.raises(InputError) as raised:
        read_table(changed(**{name: None, other: LOG[name], "Depth actual [mm]": LOG["depth_mm"]}))
    assert f"'{name}': NAME" in str(raised.value) and other in str(raised.value)


@pytest.mark.parametrize(
    "cells",
    [
        [None, *LOG["force_kn"][1:]],
        np.ma.array(LOG["force_kn"], mask=np.arange(N) == 0),
        np.ma.array(np.full(N, 78), mask=np.arange(N) == 0),
    ],
    ids=["None", "mask", "mask of int"],
)
def test_a_cell_that_is_missing_has_no_value(cells):
    signals = read_table(changed(time_s=LOG["time_s"] * 10.0, force_kn=cells))
    assert np.flatnonzero(np.isnan(signals.force_kn)).tolist() == [0]


SINCE = np.round(LOG["time_s"] * 1e9).astype("timedelta64[ns]")


@pytest.mark.parametrize("unit", ["s", "ms", "min"])
@pytest.mark.parametrize(
    "cells",
    [
        EPOCH + SINCE,
        SINCE,
        SINCE.astype("timedelta64[us]").tolist(),
        (EPOCH + SINCE).astype("datetime64[us]").tolist(),
        [str(stamp)[:26] for stamp in EPOCH + SINCE],
    ],
    ids=["datetime64", "timedelta64", "timedelta", "datetime", "text"],
)
def test_dates_and_durations_are_times_whatever_the_columns_unit(cells, unit):
    signals = read_table(changed(**{"time_s": None, f"time_{unit}": cells}))
    assert signals.time_s == pytest.approx(read_table(LOG).time_s)


def test_a_file_may_have_decimal_commas_and_another_encoding(tmp_path):
    header = (
        "# machine 3\nTime [s];Depth [mm];Temperature [°C];Torque [N m];Force [kN];Speed [1/min]"
    )
    rows = [f"{0.1 * i:.1f};2,6;816,4;1022;78,4;{'' if i == 2 else 407}" for i in range(4)]
    signals = read_table(
        written(tmp_path / "a.csv", header, *(row.replace(".", ",") for row in rows))
    )
    assert signals.force_kn == pytest.approx(np.full(4, 78.4))
    assert np.isnan(signals.speed_rpm).tolist() == [False, False, True, False]


def test_an_exported_weld_is_read_as_it_was(tmp_path):
    signals = read_table(
        changed(drives_force_kn=LOG["force_kn"] - 1.0, drives_speed_rpm=LOG["speed_rpm"])
    )
    export_weld(signals, tmp_path / "weld.csv")
    again = read_table(tmp_path / "weld.csv")
    for name in ("time_s", "depth_mm", "temperature_c", "torque_nm", "force_kn"):
        assert np.array_equal(getattr(again, name), getattr(signals, name))
    assert again.drives.force_kn == pytest.approx(again.force_kn - 1.0)


@pytest.mark.parametrize("torque", ["1,054", "1,054.0", "1.054,0"])
def test_a_comma_in_a_file_with_decimal_points_is_refused(tmp_path, torque):
    rows = [ROW.replace(",", ";"), f"0.1;2.660;816;{torque};78;407"]
    with pytest.raises(InputError) as raised:
        read_table(written(tmp_path / "log.csv", HEADER.replace(",", ";"), *rows))
    facts = ["line 3", "'torque_nm'", repr(torque)]
    assert [fact for fact in facts if fact not in str(raised.value)] == []


HEADER = "time_s,depth_mm,temperature_c,torque_nm,force_kn,speed_rpm"
ROW = "0.0,2.6,816.4,1022,78.4,407"


@pytest.mark.parametrize(
    ("lines", "facts"),
    [
        ([HEADER, ROW, ROW.replace("78.4", "7x")], ["line 3", "'force_kn'", "'7x'"]),
        ([HEADER, ROW, ROW], ["line 3", "time"]),
        ([HEADER, ROW, "0.1,2.6"], ["line 3", "2 cells", "6 columns"]),
        ([HEADER, ROW, ROW.replace("0.0,", ",", 1)], ["line 3", "no time"]),
        ([HEADER], ["no rows", "line 1"]),
        ([""], ["is empty"]),
        ([HEADER.replace("depth_mm", "time_s"), ROW], ["line 1", "'time_s'", "twice"]),
        ([HEADER.replace("force_kn", "force_bar"), ROW], ["'force_bar'", "force_kn", "columns="]),
        ([HEADER.replace("force_kn", "force"), ROW], ["'force'", "unit", "kn, n"]),
        ([HEADER.replace("force_kn", "x"), ROW], ["force_kn", "speed_rpm"]),
        (
            [HEADER.replace("force_kn", "axial_force_kn") + ",plunge_force_kn", ROW + ",1"],
            ["axial_force_kn, plunge_force_kn"],
        ),
    ],
)
def test_errors_in_a_file_have_their_place(tmp_path, lines, facts):
    with pytest.raises(InputError) as raised:
        read_table(written(tmp_path / "log.csv", *lines))
    assert [fact for fact in ["log.csv", *facts] if fact not in str(raised.value)] == []


@pytest.mark.parametrize(
    ("source", "columns", "facts"),
    [
        (3, None, ["int"]),
        (changed(force_kn=[1.0]), None, ["length"]),
        (changed(force_kn=["x"] * N), None, ["row 0", "'force_kn'", "'x'"]),
        (changed(force_kn=SINCE), None, ["row 0", "'force_kn'"]),
        (changed(time_s=np.ma.array(EPOCH + SINCE, mask=[True] * N)), None, ["row 0", "no time"]),
        ({name: [] for name in LOG}, None, ["no rows"]),
        (changed(time_s=np.full(N, np.datetime64("NaT"))), None, ["row 0", "no time"]),
        (LOG, {"force_kn": "F"}, ["'F'", "force_kn"]),
        (LOG, {"force": "force_kn"}, ["'force'", "unit"]),
        ("no_such.csv", None, ["no_such.csv"]),
    ],
)
def test_errors_in_arrays_and_arguments_are_named(source, columns, facts):
    with pytest.raises(InputError) as raised:
        read_table(source, columns)
    assert [fact for fact in facts if fact not in str(raised.value)] == []


@pytest.mark.parametrize(
    ("column", "factor", "offset"),
    [
        ("depth_mm", 1e-3, 0.0),
        ("force_kn", 1e3, 0.0),
        ("speed_rpm", np.pi / 30.0, 0.0),
        ("temperature_c", 1.0, 273.15),
    ],
)
def test_values_unusual_for_their_unit_are_reported(column, factor, offset):
    signals = read_table(changed(**{column: factor * LOG[column] + offset}))
    [problem] = signals.problems
    assert column in problem and not read_table(LOG).problems


@pytest.mark.parametrize("nothing", [np.nan, np.inf])
def test_a_column_without_numbers_is_refused(nothing):
    with pytest.raises(InputError, match="depth_mm"):
        read_table(changed(depth_mm=np.full(N, nothing)))


def test_a_log_in_air_is_usual():
    zero = np.zeros(N)
    assert not read_table(changed(depth_mm=zero - 5.0, force_kn=zero)).problems
