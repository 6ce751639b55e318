"""Rates of the drives, from their feedback in recorded welds."""

from __future__ import annotations

from collections.abc import Sequence
from math import log

import numpy as np

from fsw_analysis.weld_signals import FloatArray, WeldSignals
from fsw_control.weld import TICK_S

#: lags and dead times that a drive may have as well, so that neither passes for a rate
_LAGS_S, _DEAD_TICKS = np.geomspace(0.01, 2.0, 16), range(4)
#: of the largest move of a command; the last one is no limit
_SHARES = np.append(np.geomspace(0.01, 0.95, 24), 1.0)
#: times that the surroundings of the most likely lag and rate are looked at more closely
_ZOOMS = 3
#: errors below this share of the largest move do not matter
_HARMLESS = 1e-3
#: of the likelihood ratio of a rate: a chi-squared of one degree of freedom, at 0.1 %
_SIGNIFICANT = 10.8
#: ticks that are used at most
_MOST_TICKS = 6000


def drive_rates(welds: Sequence[WeldSignals]) -> tuple[float | None, float | None]:
    """Rates [kN/s], [rpm/s] that limit the drives in welds; None: no limit shows."""
    found: tuple[list[float], list[float]] = ([], [])
    for weld in welds:
        if weld.drives is None:
            continue
        pairs = (
            (weld.force_kn, weld.drives.force_kn),
            (weld.speed_rpm, weld.drives.speed_rpm),
        )
        for rates, (commands, acting) in zip(found, pairs, strict=True):
            if (rate := _rate(commands[:_MOST_TICKS], acting[:_MOST_TICKS])) is not None:
                rates.append(rate)
    force, speed = (min(rates, default=None) for rates in found)
    return force, speed


def _rate(commands: FloatArray, acting: FloatArray) -> float | None:
    """Most likely rate of a drive, if it is significantly more likely than none.

    A drive follows its command after a dead time, limited in rate, through a first-order lag, and
    its feedback has white errors: the likelihood falls with the sum of their squares.
    """
    known = np.isfinite(commands) & np.isfinite(acting)
    commands, acting = commands[known], acting[known]
    largest = float(np.abs(np.diff(commands)).max(initial=0.0))
    if largest == 0.0:
        return None
    errors = {
        ticks: _errors(commands, acting, ticks, _LAGS_S, _SHARES * largest)
        for ticks in _DEAD_TICKS
    }
    dead, free = (
        min(errors, key=lambda ticks: errors[ticks][:, part].min()) for part in (slice(None), -1)
    )
    limited, step = _closer(commands, acting, dead, _SHARES * largest)
    unlimited, _ = _closer(commands, acting, free, _SHARES[-1:] * largest)
    harmless = commands.size * (_HARMLESS * largest) ** 2
    ratio = commands.size * log((unlimited + harmless) / (limited + harmless))
    return step / TICK_S if ratio > _SIGNIFICANT else None


def _closer(
    commands: FloatArray, acting: FloatArray, dead: int, steps: FloatArray
) -> tuple[float, float]:
    """Least sum of squared errors by lag and largest step, with that step."""
    lags_s = _LAGS_S
    for zoom in range(_ZOOMS + 1):
        errors = _errors(commands, acting, dead, lags_s, steps)
        i, k = np.unravel_index(np.argmin(errors), errors.shape)
        least, step = float(errors[i, k]), float(steps[k])
        if zoom < _ZOOMS:
            lags_s, steps = _around(lags_s, int(i)), _around(steps, int(k))
    return least, step


def _around(grid: FloatArray, k: int) -> FloatArray:
    """A finer grid between the neighbours of a value."""
    low, high = grid[max(k - 1, 0)], grid[min(k + 1, grid.size - 1)]
    return np.geomspace(low, high, 9) if high > low else grid


def _errors(
    commands: FloatArray, acting: FloatArray, dead: int, lags_s: FloatArray, steps: FloatArray
) -> FloatArray:
    """Sum of the squared errors of a drive's feedback, by lag and largest step of a tick."""
    left = np.exp(-TICK_S / lags_s)[:, None]
    setpoint = np.full(steps.shape, acting[0])
    position = np.full((left.size, steps.size), acting[0])
    errors = np.zeros_like(position)
    for k in range(dead, commands.size - 1):
        setpoint = setpoint + np.clip(commands[k - dead] - setpoint, -steps, steps)
        position = setpoint + (position - setpoint) * left
        errors += (position - acting[k + 1]) ** 2
    return errors
