"""Joins the sensor topics by stamp into ticks: late, duplicate, missing, out of order."""

from __future__ import annotations

from dataclasses import dataclass, field

from fsw_control.contract import SENSORS

NANOSECONDS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class Tick:
    """The samples of one stamp.

    Attributes
    ----------
    stamp_ns : int
        The stamp that they share.
    values : dict of str to float
        Value by sensor name; a sensor that did not come is absent.
    restarted : bool
        Whether time jumped before this tick, so that the past must be forgotten.
    """

    stamp_ns: int
    values: dict[str, float]
    restarted: bool = False


@dataclass(slots=True)
class JoinCounts:
    """What did not go as it should, by sensor, since start."""

    late: dict[str, int] = field(default_factory=lambda: dict.fromkeys(SENSORS, 0))
    duplicate: dict[str, int] = field(default_factory=lambda: dict.fromkeys(SENSORS, 0))
    missing: dict[str, int] = field(default_factory=lambda: dict.fromkeys(SENSORS, 0))
    jumps: int = 0


class TickJoin:
    """Collects samples into ticks, which come out in order of time and each stamp once.

    A tick is complete when all sensors came and the command that answers the tick before is known (a controller
    needs to know what was applied); it is given up waiting for when a newer stamp arrives, or by :meth:`flush`.
    A single stamp far from the last one is not believed until another sensor confirms it or all else is silent,
    so that one sensor with a broken clock cannot stop the others.

    Parameters
    ----------
    jump_s : float
        Distance of a stamp from the last tick that counts as a jump of time.
    silence_s : float
        After so long without any believed sample a jump is believed unconfirmed.
    """

    def __init__(self, jump_s: float = 1.0, silence_s: float = 1.0) -> None:
        self.counts = JoinCounts()
        self._jump_ns = round(jump_s * NANOSECONDS)
        self._silence_s = silence_s
        self._last_ns: int | None = None
        self._command_ns: int | None = None
        self._awaits_command = True
        self._unanswered = 0
        self._pending_ns: int | None = None
        self._pending: dict[str, float] = {}
        self._restarted = False
        self._strange: dict[str, tuple[int, float]] = {}
        self._heard_s = float("-inf")
        self._missed: frozenset[str] = frozenset()

    @property
    def waiting(self) -> bool:
        """Whether a tick has begun and is not complete."""
        return self._pending_ns is not None

    @property
    def lacking(self) -> frozenset[str]:
        """Sensors (and ``command``) that the tick that has begun still waits for."""
        sensors = {sensor for sensor in SENSORS if sensor not in self._pending}
        return frozenset(sensors if self._answered() else sensors | {"command"})

    @property
    def missed(self) -> frozenset[str]:
        """Sensors (and ``command``) that the last tick had to do without."""
        return self._missed

    def add(self, sensor: str, stamp_ns: int, value: float, now_s: float) -> list[Tick]:
        """Take one sample; return the ticks that it completes, oldest first.

        Parameters
        ----------
        sensor : str
            One of ``SENSORS``.
        stamp_ns : int
            Stamp of the sample.
        value : float
            The sample.
        now_s : float
            Time of arrival on any steady clock.
        """
        anchor = self._pending_ns if self._pending_ns is not None else self._last_ns
        if anchor is not None and abs(stamp_ns - anchor) > self._jump_ns:
            return self._consider_jump(sensor, stamp_ns, value, now_s)
        self._heard_s = now_s
        if self._last_ns is not None and stamp_ns <= self._last_ns:
            same = stamp_ns == self._last_ns and sensor not in self._missed
            (self.counts.duplicate if same else self.counts.late)[sensor] += 1
            return []
        return self._accept(sensor, stamp_ns, value)

    def add_command(self, stamp_ns: int) -> list[Tick]:
        """Note that the command answering ``stamp_ns`` is known; return the tick that it completes, if any."""
        self._command_ns = stamp_ns
        self._awaits_command = True
        self._unanswered = 0
        return self._release() if self._complete() else []

    def flush(self) -> list[Tick]:
        """Stop waiting: return the tick that has begun, if any, with what came."""
        return self._release() if self._pending_ns is not None else []

    def _accept(self, sensor: str, stamp_ns: int, value: float) -> list[Tick]:
        ticks: list[Tick] = []
        if self._pending_ns is not None and stamp_ns < self._pending_ns:
            self.counts.late[sensor] += 1
            return ticks
        if self._pending_ns is not None and stamp_ns > self._pending_ns:
            ticks = self._release()
        self._pending_ns = stamp_ns
        if sensor in self._pending:
            self.counts.duplicate[sensor] += 1
            return ticks
        self._pending[sensor] = value
        if self._complete():
            ticks += self._release()
        return ticks

    def _complete(self) -> bool:
        return self._pending_ns is not None and len(self._pending) == len(SENSORS) and self._answered()

    def _answered(self) -> bool:
        if self._last_ns is None or self._restarted or not self._awaits_command:
            return True
        return self._command_ns is not None and self._command_ns >= self._last_ns

    def _release(self) -> list[Tick]:
        assert self._pending_ns is not None
        missed = [sensor for sensor in SENSORS if sensor not in self._pending]
        for sensor in missed:
            self.counts.missing[sensor] += 1
        if not self._answered():
            missed.append("command")
            self._unanswered += 1
            # Nobody commands (a bag is replayed, or the arbiter is gone): do not wait at every tick.
            self._awaits_command = self._unanswered < 3
        self._missed = frozenset(missed)
        tick = Tick(self._pending_ns, self._pending, self._restarted)
        self._last_ns, self._pending_ns = self._pending_ns, None
        self._pending, self._restarted = {}, False
        self._strange.clear()
        return [tick]

    def _consider_jump(self, sensor: str, stamp_ns: int, value: float, now_s: float) -> list[Tick]:
        self.counts.late[sensor] += 1
        self._strange[sensor] = (stamp_ns, value)
        agreeing = {name: entry[1] for name, entry in self._strange.items() if entry[0] == stamp_ns}
        if len(agreeing) < 2 and now_s - self._heard_s < self._silence_s:
            return []
        ticks = self.flush()
        self.counts.jumps += 1
        self._heard_s = now_s
        self._last_ns, self._command_ns, self._missed = None, None, frozenset()
        self._restarted = True
        self._strange.clear()
        for name, entry in agreeing.items():
            ticks += self._accept(name, stamp_ns, entry)
        return ticks
