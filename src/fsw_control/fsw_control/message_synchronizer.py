"""Joins topics by stamp into ticks, despite late, duplicate or missing samples and time jumps."""

from __future__ import annotations

from bisect import insort
from dataclasses import dataclass, field
from math import inf
from typing import Any, NamedTuple

from fsw_control.contract import Command
from fsw_control.sensors import OPTIONAL, REQUIRED


class JoinRules(NamedTuple):
    """Rules by which samples of several topics become ticks, in nodes and in replayed bags.

    Of several samples of one sensor with one stamp the first counts. A tick is complete when it
    has a sample of every required sensor and, if they are awaited, of the drives, and when a
    command answers the tick before it.

    Beginning and end of a tick depend on its use: a controller gets it once it is complete
    (`MessageSynchronizer`); the supervisor's begins with its first sample, from which its deadline
    counts (`fsw_supervisor.ticks`); the operator page draws one for each sample of the drives
    (`fsw_hmi.weld_view`); in a bag all stamps are known (`fsw_analysis.signals`).
    """

    #: distance from the newest accepted stamp beyond which a stamp is an outlier: after a jump of
    #: time, or from a broken clock
    jump_ns: int = 1_000_000_000
    #: sources with the same outlier that make it a jump of time; one suffices if it is alone
    agreeing: int = 2
    #: in real time, time without a newer stamp after which any stamp is accepted [s]
    silence_s: float = 0.25
    #: latest sample [s]: a command that answers an older measurement is rejected
    late_s: float = 0.5
    #: number of incomplete ticks kept: after a stall the samples of neighbouring ticks are mixed
    pending_ticks: int = 2
    #: extra patience of a tick, as a share and once, if this process itself has missed its
    #: deadline
    extension: float = 1.0 / 3.0
    #: samples of a source kept for their tick; more than a queue holds after a stall
    kept_optional: int = 16
    unanswered: int = 3  #: ticks without a command after which commands are no longer awaited


RULES = JoinRules()
#: source of the drives' samples, beside the sensors
DRIVES = "drives"
JUMP_NS = RULES.jump_ns
#: a near stamp of one source alone is accepted after this multiple of ``RULES.silence_s``
_ALONE = 3.0
#: in lockstep, where time waits for slow nodes, the same as ``RULES.silence_s`` [s]
_SILENCE_LOCKSTEP_S = 1.0


@dataclass(slots=True)
class SampleSet:
    """The samples of one stamp."""

    stamp_ns: int
    begun_s: float  #: arrival of the first sample on the steady clock
    #: by sensor; missing ones are absent
    values: dict[str, float] = field(default_factory=dict)
    #: force and speed that act, as the drives report them; None if their sample is missing
    drives: Command | None = None
    restarted: bool = False  #: time jumped before this tick: the past must be forgotten
    extended: bool = False  #: whether its deadline was extended, once


class AcceptedSamples(NamedTuple):
    """Samples of one stamp by source, and whether time has jumped to it."""

    samples: dict[str, float]
    jumped: bool


class StampFilter:
    """Decides which stamps are accepted.

    - A stamp newer than the newest accepted one, by ``jump_ns`` at most, advances the time.
    - Any other stamp may mean that the clock was set or the plant restarted, or only that this
      sample is late or its sensor's clock broken. A stamp further away than ``jump_ns`` becomes
      the new time if two sources agree on it, or if no stamp has advanced the time for
      ``silence_s``; a nearer one if both hold, or after three times as long. So one sensor with a
      broken clock cannot stop the others, and a clock that goes back stops nothing for long.
    - A stamp accepted within the last ``late_s`` never begins a new time: it is a late or repeated
      sample. So no tick is answered twice, however late samples and clock steps coincide.

    In ``lockstep`` time waits for slow nodes, so arrival times mean little: a stamp within
    ``jump_ns`` that is not newer is always a late sample. The plant's stamps do not go back there.
    """

    def __init__(self, lockstep: bool = False) -> None:
        self.newest_ns: int | None = None  #: newest accepted stamp; None before the first
        self.jumps = 0  #: jumps of time since the start
        self._lockstep = lockstep
        self._silence_s = _SILENCE_LOCKSTEP_S if lockstep else RULES.silence_s
        self._advanced_s = float("-inf")
        self._begin_ns: int | None = None  # the stamp that time has jumped to
        self._outliers: dict[str, tuple[int, float]] = {}
        self._accepted: dict[int, float] = {}  # by stamp, when it was accepted first

    def offer(
        self, source: str, stamp_ns: int, value: float, now_s: float
    ) -> AcceptedSamples | None:
        """Process a sample received at ``now_s`` (steady clock); return what it makes acceptable.

        That is None for a rejected sample, and the samples of all agreeing sources at a jump.
        """
        newest_ns = stamp_ns - 1 if self.newest_ns is None else self.newest_ns
        is_near, is_newer = abs(stamp_ns - newest_ns) <= RULES.jump_ns, stamp_ns > newest_ns
        is_repeated = stamp_ns == newest_ns or self._is_late(stamp_ns, now_s)
        is_before = self._begin_ns is not None and stamp_ns < self._begin_ns
        if is_repeated and (is_newer or is_before or not is_near):
            return None  # from before the last jump
        if is_near and is_newer:
            self._advance(stamp_ns, now_s)
            return AcceptedSamples({source: value}, jumped=False)
        silence_s = now_s - self._advanced_s
        if is_near and (is_repeated or self._lockstep or silence_s < self._silence_s):
            if is_before:
                return None
            self._accepted.setdefault(stamp_ns, now_s)
            return AcceptedSamples({source: value}, jumped=False)
        self._outliers[source] = (stamp_ns, value)
        agreeing = {
            name: entry[1] for name, entry in self._outliers.items() if entry[0] == stamp_ns
        }
        # A near stamp of one source may come from a lagging sensor while the others are delayed
        # for a moment.
        is_silent = silence_s >= (_ALONE * self._silence_s if is_near else self._silence_s)
        if len(agreeing) < RULES.agreeing and not is_silent:
            return None
        self.jumps += 1
        self._begin_ns = stamp_ns
        self._advance(stamp_ns, now_s)
        return AcceptedSamples(agreeing, jumped=True)

    def _is_late(self, stamp_ns: int, now_s: float) -> bool:
        return not self._lockstep and now_s - self._accepted.get(stamp_ns, -inf) < RULES.late_s

    def _advance(self, stamp_ns: int, now_s: float) -> None:
        self.newest_ns, self._advanced_s = stamp_ns, now_s
        self._outliers.clear()
        self._accepted = {
            stamp: at_s for stamp, at_s in self._accepted.items() if now_s - at_s < RULES.late_s
        }
        self._accepted[stamp_ns] = now_s


class MessageSynchronizer:
    """Collects samples into ticks, which are released in order of time, each stamp once.

    A tick is complete when all sensors have arrived and the command that answers the tick before
    is known (a controller needs the applied command). The wait ends early when all missing
    sensors have sent newer samples (a topic keeps its order), when the second tick after it
    begins, or by :meth:`expire`.

    The samples of the drives and of optional sensors neither begin nor confirm a tick, and a tick
    does not wait for them. Only in lockstep (``await_drives``) does a tick wait for those that the
    previous tick had. Without ``await_commands`` no tick waits for a command before the first one.
    """

    def __init__(self, await_drives: bool = False, await_commands: bool = True) -> None:
        #: decides which stamps are accepted
        self.stamps = StampFilter(lockstep=await_drives)
        #: by sensor, its samples ``late``, ``duplicate`` and ``missing`` since start
        self.counts = {
            sensor: dict.fromkeys(("late", "duplicate", "missing"), 0) for sensor in REQUIRED
        }
        #: sensors (and ``drives``, ``command``) that were missing in the last tick
        self.missed: frozenset[str] = frozenset()
        self._last_ns: int | None = None
        self._command_ns: int | None = None
        self._awaits_command = await_commands
        self._unanswered = 0
        self._pending: list[SampleSet] = []
        self._restarted = False
        #: by source, its samples by stamp
        self._optional: dict[str, dict[int, Any]] = {source: {} for source in (DRIVES, *OPTIONAL)}
        self._awaited = {DRIVES} if await_drives else set[str]()  # of these
        self._await_drives = await_drives
        self._repeated: set[str] = set()

    def take_repeated(self) -> bool:
        """Whether all sensors have repeated the last tick since the previous such call."""
        is_repeated = self._last_ns is not None and self._repeated >= set(REQUIRED) - self.missed
        if is_repeated:
            self._repeated.clear()
        return is_repeated

    @property
    def begun_s(self) -> float | None:
        """Arrival of the first sample of the oldest incomplete tick; None if there is none."""
        return self._pending[0].begun_s if self._pending else None

    @property
    def lacking(self) -> frozenset[str]:
        """Sensors (and ``drives``, ``command``) that the oldest incomplete tick waits for."""
        oldest = self._pending[0] if self._pending else None
        lacking = set(REQUIRED).difference(oldest.values if oldest else ())
        if oldest:
            optional, stamp_ns = self._optional, oldest.stamp_ns
            lacking |= {name for name in self._awaited if stamp_ns not in optional[name]}
        if not self._answered():
            lacking.add("command")
        return frozenset(lacking)

    def add(self, sensor: str, stamp_ns: int, value: float, now_s: float) -> list[SampleSet]:
        """Take a sample received at ``now_s`` (steady clock); return completed ticks in order."""
        if sensor in self._optional:
            return self._add_optional(sensor, stamp_ns, value)
        accepted = self.stamps.offer(sensor, stamp_ns, value, now_s)
        if accepted is None or accepted.jumped:
            self.counts[sensor]["late"] += 1
            return [] if accepted is None else self._jump(stamp_ns, accepted.samples, now_s)
        if self._last_ns is not None and stamp_ns <= self._last_ns:
            again = stamp_ns == self._last_ns and sensor not in self.missed
            self.counts[sensor]["duplicate" if again else "late"] += 1
            if again:
                self._repeated.add(sensor)
            return []
        return self._accept(sensor, stamp_ns, value, now_s)

    def add_command(self, stamp_ns: int) -> list[SampleSet]:
        """Note that a command answers ``stamp_ns``; return the ticks that this completes."""
        self._command_ns = stamp_ns
        self._awaits_command = True
        self._unanswered = 0
        return self._release()

    def add_drives(self, stamp_ns: int, acting: Command) -> list[SampleSet]:
        """Take a sample of the drives; return the ticks that it completes."""
        return self._add_optional(DRIVES, stamp_ns, acting)

    def _add_optional(self, source: str, stamp_ns: int, value: Any) -> list[SampleSet]:
        samples = self._optional[source]
        if self._await_drives:
            self._awaited.add(source)
        samples[stamp_ns] = value
        if len(samples) > RULES.kept_optional:
            del samples[next(iter(samples))]
        return self._release()

    def expire(self, now_s: float, patience_s: float) -> list[SampleSet]:
        """Release the oldest tick if its first sample arrived ``patience_s`` ago.

        If the call itself is late by more than that, this process was stalled: the queues are
        then read first, once. Returns the released ticks.
        """
        if not self._pending:
            return []
        tick = self._pending[0]
        due_s = tick.begun_s + patience_s
        if now_s > due_s + patience_s and not tick.extended:
            tick.begun_s, tick.extended = now_s - (1.0 - RULES.extension) * patience_s, True
        elif now_s >= due_s:
            return [self._pop(), *self._release()]
        return []

    def _accept(self, sensor: str, stamp_ns: int, value: float, now_s: float) -> list[SampleSet]:
        tick = next((tick for tick in self._pending if tick.stamp_ns == stamp_ns), None)
        if tick is None:
            if len(self._pending) == RULES.pending_ticks and stamp_ns < self._pending[0].stamp_ns:
                self.counts[sensor]["late"] += 1
                return []
            tick = SampleSet(stamp_ns, now_s)
            insort(self._pending, tick, key=lambda tick: tick.stamp_ns)
        if sensor in tick.values:
            self.counts[sensor]["duplicate"] += 1
            return []
        tick.values[sensor] = value
        return self._release()

    def _answered(self) -> bool:
        if self._last_ns is None or self._restarted or not self._awaits_command:
            return True
        return self._command_ns is not None and self._command_ns >= self._last_ns

    def _waits(self) -> bool:
        """Whether the oldest tick may still become complete."""
        newer = self._pending[1:]
        if len(newer) >= RULES.pending_ticks:
            return False
        lacking = self.lacking
        return bool(lacking) and not any(lacking <= self._sources_of(tick) for tick in newer)

    def _sources_of(self, tick: SampleSet) -> set[str]:
        came = {name for name, samples in self._optional.items() if tick.stamp_ns in samples}
        return {*tick.values, *came}

    def _release(self) -> list[SampleSet]:
        ticks: list[SampleSet] = []
        while self._pending and not self._waits():
            ticks.append(self._pop())
        return ticks

    def _pop(self) -> SampleSet:
        tick = self._pending.pop(0)
        missed = [sensor for sensor in REQUIRED if sensor not in tick.values]
        for sensor in missed:
            self.counts[sensor]["missing"] += 1
        if not self._answered():
            missed.append("command")
            self._unanswered += 1
            # No commands arrive (replay of a bag, or the arbiter has ended): stop waiting for them
            # at every tick.
            self._awaits_command = self._unanswered < RULES.unanswered
        stamp_ns = tick.stamp_ns
        all_came = {name: samples.pop(stamp_ns, None) for name, samples in self._optional.items()}
        came = {name: value for name, value in all_came.items() if value is not None}
        missed += self._awaited - came.keys()
        self._awaited = set(came) if self._await_drives else set()
        tick.drives = came.pop(DRIVES, None)
        tick.values |= came
        self.missed = frozenset(missed)
        tick.restarted = self._restarted
        self._last_ns, self._restarted = tick.stamp_ns, False
        self._repeated.clear()
        return tick

    def _jump(self, stamp_ns: int, samples: dict[str, float], now_s: float) -> list[SampleSet]:
        """Drop the history; return the first tick after a jump of time, once complete."""
        ticks = [self._pop() for _ in range(len(self._pending))]
        self._last_ns, self._command_ns, self.missed = None, None, frozenset()
        self._restarted = True
        for name, sample in samples.items():
            ticks += self._accept(name, stamp_ns, sample, now_s)
        return ticks
