"""Health of a drive: command tracking, and time at a limit."""

from __future__ import annotations

from collections import deque

import numpy as np

from fsw_analysis.weld_signals import FloatArray
from fsw_control.weld import TICK_S
from fsw_quality.diagnosis import Finding, WatchCause

_SECOND = round(1.0 / TICK_S)
#: windows of tracking and of saturation [s]
_TRACKING_S, _SATURATION_S = 30, 60
#: longest lag that is looked for [ticks]; lag [s], share of standstill and share at a limit that
#: are faults (chosen)
_LARGEST, _LAG_S, _STANDSTILL, _SATURATED = 15, 0.25, 0.1, 0.8
#: a shorter delay explains nearly as well up to this ratio of variances (chosen); what rounding
#: adds
_NEARLY, _ROUNDING = 1.5, 1e-12


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
                lag_s = TICK_S * best_delay(commands, positions, _LARGEST)
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
