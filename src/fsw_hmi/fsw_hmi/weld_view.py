"""Joins the samples of the graph into the rows that the page draws; how old they are."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from math import isfinite, nan
from typing import NamedTuple

from fsw_control.contract import Command, Reference
from fsw_control.message_synchronizer import JUMP_NS
from fsw_control.sensors import OPTIONAL, REQUIRED
from fsw_control.units import KW_PER_NM_RPM

#: ticks whose samples may still arrive
_PENDING = 20


class Row(NamedTuple):
    """A tick: stamp, and values of ``frames.COLUMNS`` after the time; NaN if unknown."""

    stamp_ns: int
    values: tuple[float, ...]


class WeldView:
    """Joins sensors, drives, set-points and commands by their stamps.

    The drives' samples define the ticks, since no sensor fault changes their stamps. A tick ends
    when all required sensors, and the others that the last tick had, have arrived, or the next
    tick begins. The command of a row is the one in force at its measurement. Drive samples older
    than the newest are late; if older by more than `JUMP_NS`, they belong to another weld.
    ``reference_at`` returns the set-points in force at a tick, None before the first.
    """

    def __init__(self, reference_at: Callable[[int], Reference | None]) -> None:
        self._reference_at = reference_at
        #: when the last finite sample of each sensor came, on a steady clock
        self.good_s: dict[str, float] = {}
        self.tick_s: float | None = None  #: when the newest tick came
        self.newest_ns: int | None = None  #: its stamp
        self._begin()

    def _begin(self) -> None:
        self._samples: dict[int, dict[str, float]] = {}
        self._awaited = set(REQUIRED)
        self._came_s: dict[int, float] = {}
        self._open: tuple[int, Command] | None = None
        self._command = Command(nan, nan)
        self._latency_ms = nan
        self.solve_ms = nan  #: as the selected controller has reported last; who hears it sets it
        self.angle_deg = nan  #: and the programme
        self.command_s: float | None = None  #: when the last command of this weld came

    def on_drives(self, stamp_ns: int, acting: Command, now_s: float) -> tuple[list[Row], bool]:
        """Begin a tick; returns the completed rows, and whether another weld has begun."""
        newest_ns, restarted = self.newest_ns, False
        if newest_ns is not None and stamp_ns <= newest_ns:
            if stamp_ns >= newest_ns - JUMP_NS:
                return [], False
            restarted = True
            self._begin()
        rows = self._close()
        self.newest_ns, self.tick_s = stamp_ns, now_s
        self._open = (stamp_ns, acting)
        self._came_s[stamp_ns] = now_s
        while len(self._came_s) > _PENDING:
            del self._came_s[next(iter(self._came_s))]
        return [*rows, *self._close_if_complete()], restarted

    def on_sample(self, sensor: str, stamp_ns: int, value: float, now_s: float) -> list[Row]:
        """Take a sample of a sensor; returns the completed rows."""
        if isfinite(value):
            self.good_s[sensor] = now_s
        self._samples.setdefault(stamp_ns, {}).setdefault(sensor, value)
        if len(self._samples) > _PENDING:
            newest_ns = self.newest_ns or 0
            del self._samples[max(self._samples, key=lambda key_ns: abs(key_ns - newest_ns))]
        return self._close_if_complete()

    def on_command(self, stamp_ns: int, command: Command, now_s: float) -> None:
        """Take the command that answers a tick."""
        self._command, self.command_s = command, now_s
        if stamp_ns in self._came_s:
            self._latency_ms = 1e3 * (now_s - self._came_s.pop(stamp_ns))

    def _close_if_complete(self) -> list[Row]:
        if self._open is None or self._awaited - self._samples.get(self._open[0], {}).keys():
            return []
        return self._close()

    def _close(self) -> list[Row]:
        if self._open is None:
            return []
        (stamp_ns, acting), self._open = self._open, None
        samples = self._samples.pop(stamp_ns, {})
        self._awaited = {*REQUIRED, *samples}
        for old_ns in [key_ns for key_ns in self._samples if key_ns < stamp_ns]:
            del self._samples[old_ns]
        torque_nm = samples.get("torque", nan)
        reference = self._reference_at(stamp_ns) or Reference(nan, nan)
        values = (
            samples.get("depth", nan),
            samples.get("thermocouple", nan),
            torque_nm,
            acting.force_kn,
            acting.speed_rpm,
            torque_nm * acting.speed_rpm * KW_PER_NM_RPM,
            reference.depth_mm,
            reference.temperature_c,
            self._command.force_kn,
            self._command.speed_rpm,
            self._latency_ms,
            self.solve_ms,
            self.angle_deg,
            *(samples.get(name, nan) for name in OPTIONAL),
        )
        return [Row(stamp_ns, values)]


#: looks come every 0.05 s; one that comes later by more than this was kept waiting (chosen)
_LOOK_S, _LATE_S = 0.05, 0.05
#: delays that are remembered
_DELAYS = 1000
#: after delays of so much within so long no further one is excused: who is always late must not
#: hide that nothing comes (chosen)
_EXCUSED_S, _WITHIN_S = 2.0, 10.0


class Awake:
    """What came while the process stood still waits in its queues, so it is not missing yet.

    :meth:`look` is to be called at every look, on the clock of all other times.
    """

    def __init__(self) -> None:
        self._looked_s: float | None = None
        self._delays: deque[tuple[float, float]] = deque(maxlen=_DELAYS)  # end and length

    def look(self, now_s: float) -> None:
        """Note a look."""
        if self._looked_s is not None:
            late_s = now_s - self._looked_s - _LOOK_S
            spent_s = sum(
                length_s for end_s, length_s in self._delays if now_s - end_s < _WITHIN_S
            )
            if late_s > _LATE_S and spent_s < _EXCUSED_S:
                self._delays.append((now_s, late_s))
        self._looked_s = now_s

    def age_s(self, came_s: float, now_s: float) -> float:
        """How long something that came at a time has been awaited since."""
        # of a delay, no more than what of it came after: the look that ends one comes later
        stood_s = sum(
            min(late_s, end_s - came_s) for end_s, late_s in self._delays if end_s > came_s
        )
        return max(0.0, now_s - came_s - stood_s)
