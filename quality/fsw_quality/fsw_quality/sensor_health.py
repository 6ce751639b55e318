"""Health of sensors and drives, before anything is concluded from what they show.

A sensor is judged by its own samples, a drive by how it tracks its command, and by its time at a
limit.
"""

from __future__ import annotations

from collections import deque
from math import ceil, isfinite, log, nan, pi, sqrt

import numpy as np

from fsw_analysis.weld_signals import FloatArray
from fsw_control.sensors import SENSORS
from fsw_control.weld import TICK_S
from fsw_quality.diagnosis import Finding, WatchCause

_SECOND = round(1.0 / TICK_S)
#: probability with which a healthy sensor repeats its value as often as a stuck one; fewest
#: repetitions (chosen)
_BY_CHANCE, _FEWEST = 1e-9, 10
#: weight of a new sample in running means (chosen)
_FOLLOW = 0.01
#: jump from a sample to the next that is no process, in mean changes; spikes in half a minute that
#: are a fault (chosen)
_JUMP, _SPIKES, _SPIKES_S = 12.0, 3, 30.0
#: time over which noise is estimated, time in which its normal size is learnt [s], and ratios that
#: are faults (chosen)
_NOISE_S, LEARN_S, _GROWN, _GONE = 20, 90.0, 2.0, 0.5
#: a sensor that was at fault is trusted again after this time [s] (chosen)
_TRUSTED_S = 3.0
#: fall of the temperature in so many seconds that no process makes while the power stays [degC]
#: (chosen)
_FALL_S, _FALL_C = 5, 20.0
#: share of the fall by which the model, which may lag behind, cools if the power makes it (chosen)
_COOLS = 0.15
#: windows of tracking and of saturation [s]
_TRACKING_S, _SATURATION_S = 30, 60
#: longest lag that is looked for [ticks]; lag [s], share of standstill and share at a limit that
#: are faults (chosen)
_LARGEST_LAG, _LAG_S, _STANDSTILL, _SATURATED = 15, 0.25, 0.1, 0.8
#: a shorter delay explains nearly as well up to this ratio of variances (chosen); what rounding
#: adds
_NEARLY, _ROUNDING = 1.5, 1e-12


class SensorHealth:
    """Stuck, spikes, noise.

    Nothing clears it but another weld: a failover is often what a stuck sensor causes.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        row = SENSORS[name]  # its noise and resolution count until its own are known
        self._sigma, self._resolution = row.noise, row.resolution
        self._repeats = self._resolution / (
            2.0 * sqrt(pi) * self._sigma
        )  # share of samples like the one before
        self._last = self._before = self._carried = self._carried_before = nan
        self._run, self._doubtful = 0, False
        self._change = 2.0 * self._sigma
        self._spikes: deque[float] = deque()
        self._second_changes: deque[float] = deque(maxlen=_NOISE_S * _SECOND)
        self._learnt: list[float] = []
        self._normal = self.noise = (
            self._sigma
        )  # the second is the present one, which grows at once
        self._time_s, self._begun_s, self._sick_s = nan, nan, -np.inf

    def _cause(self, what: str) -> WatchCause:
        return WatchCause[f"{self.name.upper()}_{what}"]

    @property
    def _allowed(self) -> int:
        """Repetitions that may be chance."""
        return max(_FEWEST, ceil(log(_BY_CHANCE) / log(min(max(self._repeats, 1e-4), 0.99))))

    @property
    def stuck(self) -> bool:
        """Whether the same value has come again and again."""
        return self._run >= self._allowed

    def push(self, time_s: float, value: float, carrier: float) -> bool:
        """Take a sample, and the same without what the process does to it.

        Returns whether it may be used.
        """
        if not isfinite(value):
            return False
        if not isfinite(self._begun_s):
            self._begun_s = time_s
        self._time_s = time_s
        change, self._before, self._last = value - self._last, self._last, value
        if abs(change) < 1e-3 * self._resolution:
            self._run += 1
        elif isfinite(change):
            if not self.stuck:  # a stuck sensor's silence is not learnt as normal
                weight = min(_FOLLOW * (self._run + 1), 0.5)
                self._repeats += weight * (self._run / (self._run + 1) - self._repeats)
            self._run = 0
        usable = not self.stuck and self._no_spike(time_s, change)
        if usable:
            second = carrier - 2.0 * self._carried + self._carried_before
            if isfinite(second) and self._run < 2 * _SECOND:
                self._second_changes.append(abs(second))
        self._carried_before, self._carried = self._carried, carrier
        if self.stuck:
            self._sick_s = time_s
        return usable and time_s - self._sick_s > _TRUSTED_S

    def _no_spike(self, time_s: float, change: float) -> bool:
        if not isfinite(change):
            return True
        if abs(change) > _JUMP * self._change and not self._doubtful:
            self._doubtful, self._jump = True, change
            return False
        if self._doubtful:
            self._doubtful = False
            if abs(change + self._jump) < 0.5 * abs(self._jump):  # back where it was
                self._spikes.append(time_s)
        else:
            self._change += _FOLLOW * (abs(change) - self._change)
        return True

    def second(self) -> list[Finding]:
        """Findings at a second."""
        if self.stuck:
            return [Finding(self._cause("STUCK"), size=TICK_S * self._run)]
        findings = []
        while self._spikes and self._time_s - self._spikes[0] > _SPIKES_S:
            self._spikes.popleft()
        if len(self._spikes) >= _SPIKES:
            findings.append(Finding(self._cause("SPIKES"), size=float(len(self._spikes))))
        changes = np.array(self._second_changes)
        if changes.size >= 2 * _SECOND:
            noise, newest = (
                1.4826 * float(np.median(some)) / sqrt(6.0)
                for some in (changes, changes[-2 * _SECOND :])
            )
            self.noise = max(noise, newest)
        if changes.size == self._second_changes.maxlen:
            if self._time_s - self._begun_s <= LEARN_S:
                self._learnt.append(noise)
                self._normal = float(np.median(self._learnt))
            elif self._learnt and self._normal > 0.3 * self._resolution:
                ratio = noise / self._normal
                if ratio > _GROWN:
                    findings.append(Finding(self._cause("NOISE_GROWN"), size=ratio))
                elif ratio < _GONE:
                    self._sick_s = self._time_s
                    findings.append(Finding(self._cause("NOISE_GONE"), size=ratio))
        return findings


class Detached:
    """Whether the thermocouple has lost its contact.

    The temperature falls, and the power does not.
    """

    def __init__(self) -> None:
        self._shown: deque[tuple[float, float]] = deque(maxlen=_FALL_S + 1)
        self._before_c = nan

    @property
    def present(self) -> bool:
        """Whether it is so now."""
        return isfinite(self._before_c)

    def second(self, temperature_c: float, heated_c: float) -> list[Finding]:
        """Take the temperature of a second, and what the model's would be."""
        self._shown.append((temperature_c, heated_c))
        fell, cooled = (self._shown[-1][i] - self._shown[0][i] for i in range(2))
        if fell < -_FALL_C and cooled > _COOLS * fell and not self.present:
            self._before_c = self._shown[0][0]
        if not self.present:
            return []
        if temperature_c > self._before_c - 0.5 * _FALL_C:
            self._before_c = nan
            return []
        return [Finding(WatchCause.THERMOCOUPLE_DETACHED, size=self._before_c - temperature_c)]


class DriveWatch:
    """One drive.

    ``least`` is the smallest change of a command that must show, ``step`` the largest within a
    tick.
    """

    def __init__(self, name: str, least: float, low: float, high: float, step: float) -> None:
        self._name, self._least, self._low, self._high, self._step = (
            name.upper(),
            least,
            low,
            high,
            step,
        )
        self._commands: deque[float] = deque(maxlen=_TRACKING_S * _SECOND)
        self._positions: deque[float] = deque(maxlen=_TRACKING_S * _SECOND)
        self._limited: deque[bool] = deque(maxlen=_SATURATION_S * _SECOND)

    def push(self, command: float, position: float) -> None:
        """Take the command for the step that ended, and where the drive is."""
        last = self._commands[-1] if self._commands else command
        at_bound = not self._low + 1e-6 < command < self._high - 1e-6
        self._limited.append(at_bound or abs(command - last) >= self._step - 1e-6)
        self._commands.append(command)
        self._positions.append(position)

    def second(self) -> list[Finding]:
        """Findings at a second."""
        findings = []
        if len(self._commands) == self._commands.maxlen:
            commands, positions = np.array(self._commands), np.array(self._positions)
            # share of the time for which it has stood still since the command was elsewhere
            moves = np.abs(np.diff(positions, prepend=positions[0])) >= 0.05 * self._least
            since = np.maximum.accumulate(np.where(moves, np.arange(positions.size), 0))
            commanded, moved = (np.abs(values - values[since]) for values in (commands, positions))
            # a slow drive moves too little in a tick, and follows all the same
            stands = (commanded > self._least) & (moved < 0.5 * commanded)
            standstill = float(np.mean(stands))
            if standstill > _STANDSTILL:
                findings.append(Finding(WatchCause[f"{self._name}_STICKS"], size=standstill))
            if float(np.sqrt(np.mean(np.diff(commands) ** 2))) > 0.1 * self._least:
                lag_s = TICK_S * best_delay(commands, positions, _LARGEST_LAG)
                if lag_s > _LAG_S:
                    findings.append(Finding(WatchCause[f"{self._name}_LAGS"], size=lag_s))
        if (
            len(self._limited) == self._limited.maxlen
            and (share := float(np.mean(self._limited))) > _SATURATED
        ):
            findings.append(
                Finding(WatchCause[f"{self._name}_SATURATED"], alarm=False, size=share)
            )
        return findings


def best_delay(commands: FloatArray, positions: FloatArray, largest: int) -> int:
    """Samples by which the positions at least lag behind the commands, offset aside.

    The shortest delay that explains them nearly as well as the best: on a ramp a delay is an
    offset, too.
    """
    n = commands.size
    variances = [
        np.var(positions[largest:] - commands[largest - delay : n - delay])
        for delay in range(largest + 1)
    ]
    return int(np.argmax(np.array(variances) <= _NEARLY * min(variances) + _ROUNDING))
