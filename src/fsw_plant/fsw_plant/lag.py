"""Exact solution of a first-order lag over a tick."""

from __future__ import annotations

from math import exp, expm1

from fsw_model import STEP_S


def lag_left(lag_s: float) -> float:
    """Share of a deviation that remains after a tick."""
    return exp(-STEP_S / lag_s) if lag_s > 0.0 else 0.0


def lag_mean(lag_s: float) -> float:
    """Mean over a tick of the remaining share of a deviation."""
    return lag_s / STEP_S * (1.0 - lag_left(lag_s))


def lag_risen(lag_s: float) -> float:
    """Share of an input step that is reached after a tick."""
    return -expm1(-STEP_S / lag_s)
