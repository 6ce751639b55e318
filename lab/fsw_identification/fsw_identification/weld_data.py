"""Data of a recorded weld for identification: mean inputs per step, and valid sensor samples."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np
import scipy

from fsw_analysis.messages import SENSOR_TOPICS
from fsw_analysis.weld_signals import FloatArray, WeldSignals
from fsw_control.schema.models import InputError
from fsw_control.sensors import SENSORS
from fsw_control.units import NANOSECONDS
from fsw_control.validity import Flaw, SensorGuard
from fsw_control.weld import TICK_S

#: a longer gap in the data ends a segment [s]
_LONGEST_GAP_S = 2.0
#: a shorter segment is not used [s]
_SHORTEST_S = 30.0
#: share of a segment's rows with force and speed (chosen): 5 Hz with a tenth lost. At 2 Hz and
#: less, inputs that are held between samples shift the dead time beyond its standard deviation
_LEAST_SHARE = 0.45
#: order of the columns of ``measured``
_COLUMNS = ("depth", "thermocouple", "torque")


@dataclass(frozen=True, slots=True)
class Segment:
    """A part of a weld without long gaps, one row per tick of 0.1 s."""

    begin_s: float  #: time of the first row since the first tick of the weld
    #: (n,): means of the acting inputs over the step that begins at the row
    force_kn: FloatArray
    speed_rpm: FloatArray
    acceleration_rpm_per_s: (
        FloatArray  #: (n,): mean of the spindle over the step that ends at the row
    )
    #: (n, 3): depth [mm], temperature [degC] and motor torque [N m]; NaN where there is no usable
    #: sample
    measured: FloatArray

    @property
    def n_ticks(self) -> int:
        """Number of rows."""
        return int(self.force_kn.size)

    @property
    def time_s(self) -> FloatArray:
        """Time of the rows since the first tick of the weld."""
        return np.asarray(self.begin_s + TICK_S * np.arange(self.n_ticks), dtype=np.float64)


@dataclass(frozen=True, slots=True)
class WeldData:
    """Segments of one weld, and the excluded parts with the reason, one line each."""

    name: str
    segments: list[Segment]
    notes: list[str]


def prepare(signals: WeldSignals, drive_lag_s: float, in_air: bool = False) -> WeldData:
    """Segments of a weld.

    Parameters
    ----------
    signals : WeldSignals
        The emulator's truth in it is not used.
    drive_lag_s : float
        Time constant of the drives, from which the inputs between ticks follow.
    in_air : bool
        A run without copper: only the torque is required, and it may have any size.

    Raises
    ------
    InputError
        If the weld lacks sensors or inputs, is too short, or was sampled too slowly.
    """
    name = str(signals.path)
    sensors = np.column_stack([signals.depth_mm, signals.temperature_c, signals.torque_nm])
    needed = ("torque",) if in_air else _COLUMNS
    missing = [
        sensor
        for sensor, column in zip(_COLUMNS, sensors.T, strict=True)
        if not np.isfinite(column).any()
    ]
    if missing := [sensor for sensor in missing if sensor in needed]:
        topics = ", ".join(SENSOR_TOPICS[sensor] for sensor in needed)
        raise InputError(f"{name}: no samples of {', '.join(missing)}; a bag needs {topics}")
    notes: list[str] = []
    acting = _acting(signals, drive_lag_s, notes)
    sensors = sensors if in_air else _usable(signals, sensors, notes)
    row = np.round((signals.stamp_ns - signals.stamp_ns[0]) / (TICK_S * NANOSECONDS)).astype(int)
    # A short gap is bridged by the held inputs and NaN samples; over a long one the state is lost,
    # and the rest is a segment with an initial state of its own.
    cuts = np.flatnonzero(np.diff(row) * TICK_S > _LONGEST_GAP_S) + 1
    segments = []
    for part in np.split(np.arange(row.size), cuts):
        n = int(row[part[-1]] - row[part[0]]) + 1
        if n * TICK_S < _SHORTEST_S:
            notes.append(
                f"{n * TICK_S:.1f} s from {row[part[0]] * TICK_S:.1f} s on left out: too short"
            )
            continue
        grid = np.full((n, 5), np.nan)
        grid[row[part] - row[part[0]]] = np.column_stack([acting, sensors])[part]
        ends = np.column_stack([_filled(grid[:, i]) for i in range(2)])
        if not np.isfinite(ends).all():
            notes.append(
                f"{n * TICK_S:.1f} s from {row[part[0]] * TICK_S:.1f} s on left out: "
                "no force or speed"
            )
            continue
        share = float(np.isfinite(grid[:, :2]).all(axis=1).mean())
        if share < _LEAST_SHARE:
            raise InputError(
                f"{name}: has force and speed {share / TICK_S:.1f} times a second from "
                f"{row[part[0]] * TICK_S:.1f} s on; identification needs 5 Hz, better 10 Hz"
            )
        means = _means(ends, drive_lag_s)
        acceleration = np.diff(ends[:, 1], prepend=ends[0, 1]) / TICK_S
        segments.append(
            Segment(row[part[0]] * TICK_S, means[:, 0], means[:, 1], acceleration, grid[:, 2:])
        )
    if not segments:
        raise InputError(
            f"{name}: no stretch of {_SHORTEST_S:g} s with sensors, force and speed "
            f"({signals.duration_s:.1f} s in all)"
        )
    return WeldData(name, segments, notes)


def _acting(signals: WeldSignals, lag_s: float, notes: list[str]) -> FloatArray:
    """Actual force and speed per tick: drive feedback, or commands filtered by the drive lag."""
    if signals.drives is not None:
        acting = np.column_stack([signals.drives.force_kn, signals.drives.speed_rpm])
        # feedback has the disturbances that act on the drives, which no filtered command shows
        if np.isfinite(acting).all(axis=1).mean() > 0.5:
            return acting
    commands = np.column_stack([_filled(signals.force_kn), _filled(signals.speed_rpm)])
    if not np.isfinite(commands).all():
        raise InputError(
            f"{signals.path}: has neither /fsw/drives nor /fsw/command, so its inputs are unknown"
        )
    notes.append(
        "no drives' feedback: the commands are used instead, without disturbances of the inputs"
    )
    # the drives' lag, exact for commands that are held over a tick, from rest at the first one
    left = np.exp(-TICK_S / lag_s) if lag_s > 0.0 else 0.0
    acting, _ = scipy.signal.lfilter(
        [0.0, 1.0 - left], [1.0, -left], commands, axis=0, zi=commands[:1]
    )
    return np.asarray(acting)


def _means(ends: FloatArray, lag_s: float) -> FloatArray:
    """Mean inputs over each step from their end values, through a first-order lag."""
    after = np.vstack([ends[1:], ends[-1:]])
    if lag_s <= 0.0:
        return after
    # The drives hold their set-point over a step: it follows from both end values, and the mean
    # from the exponential between them.
    left = float(np.exp(-TICK_S / lag_s))
    setpoints = (after - left * ends) / (1.0 - left)
    means: FloatArray = setpoints + (ends - setpoints) * lag_s / TICK_S * (1.0 - left)
    return means


def _filled(values: FloatArray) -> FloatArray:
    """Fill missing values with the last known (at the start the first); NaN if none is known."""
    known = np.flatnonzero(np.isfinite(values))
    if not known.size:
        return values
    last = np.maximum(np.searchsorted(known, np.arange(values.size), side="right") - 1, 0)
    return values[known[last]]


def _usable(signals: WeldSignals, sensors: FloatArray, notes: list[str]) -> FloatArray:
    """Samples accepted by the controllers' sensor guard, without held values and frozen runs."""
    # The guard decides as it did during the weld; it detects a frozen run late, so that the run is
    # removed back to its first sample.
    guard, usable = SensorGuard(), sensors.copy()
    refused: dict[str, Counter[str]] = {sensor: Counter() for sensor in SENSORS}
    for tick, row in enumerate(sensors):
        values = {
            name: float(value)
            for name, value in zip(_COLUMNS, row, strict=True)
            if np.isfinite(value)
        }
        guard.measure(float(signals.stamp_ns[tick]) * 1e-9, values)
        for column, name in enumerate(_COLUMNS):
            reason = guard.reasons[name]
            if not reason:
                continue
            begin = tick
            while (
                reason == Flaw.FROZEN and begin > 0 and sensors[begin - 1, column] == row[column]
            ):
                begin -= 1
            fresh = np.isfinite(usable[begin : tick + 1, column])
            refused[name][reason] += max(1, int(fresh.sum()))
            usable[begin : tick + 1, column] = np.nan
    for name, reasons in refused.items():
        notes += [
            f"{name}: {count} samples left out: {reason}" for reason, count in reasons.items()
        ]
    return usable
