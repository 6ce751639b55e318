"""Exact solution of a first-order lag over a tick."""

from __future__ import annotations

from math import expm1

from fsw_model import STEP_S


def lag_mean(lag_s: float) -> float:
    """Mean over a tick of the remaining share of a deviation."""
    return lag_s / STEP_S * lag_risen(lag_s)


def lag_risen(lag_s: float) -> float:
    """Share of an input step that is reached after a tick."""
    return -expm1(-STEP_S / lag_s)
