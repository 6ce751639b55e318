"""Sudden disturbances in the residuals: shifts, which are estimated, and windows to exclude."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fsw_analysis.weld_signals import FloatArray
from fsw_control.weld import TICK_S
from fsw_identification.problem import HEAT, Problem, Shift
from fsw_identification.simulation import OUTPUTS
from fsw_identification.solver import solve

#: samples before and after a shift that are compared, and standard deviations that make it one
_SHIFT_TICKS, SHIFT = 30, 9.0
_MOST_SHIFTS = 12
#: a shift of fewer standard deviations is dropped in the final solution
_REAL_SHIFT = 5.0
#: limit of the residuals, in standard deviations, in the search for shifts, so that spikes do not
#: count
_CLIP = 5.0
#: the same in the search for windows, so that the edge of a shift does not count
_EDGE = 3.0
#: length of a window; it is excluded, with its neighbours, if its mean residual exceeds this many
#: standard deviations
_WINDOW_TICKS, _BIASED = 30, 5.0
#: or if its variance exceeds the noise variance by this factor
_RESTLESS = 3.0
#: number of such searches, and the excluded share of an output from which the model counts as
#: wrong instead of disturbed
_ROUNDS, _LARGEST_SHARE = 4, 0.4


def find_shifts(problem: Problem) -> list[Shift]:
    """The largest shift in the residuals of each output of each segment, if any."""
    # One per output at a time: a large shift biases the model, and with it the residuals in which
    # smaller ones are sought. The caller solves again with these, and repeats the search.
    shifts: list[Shift] = []
    for i, whitened in enumerate(problem.whitened):
        sizes = shift_sizes(whitened / problem.noise, problem.autocorrelation)
        for output, tick in enumerate(1 + sizes.argmax(axis=0)):
            shift = Shift(i, output, int(tick))
            near = [
                s
                for s in problem.shifts
                if s.segment == i and s.output == output and abs(s.tick - tick) < 5
            ]
            if (
                sizes[:, output].max() > SHIFT
                and not near
                and len(problem.shifts) + len(shifts) < _MOST_SHIFTS
            ):
                shifts.append(shift)
                # sensor or process? a second unknown decides how much of a torque shift heats
                heating = [
                    s
                    for s in problem.shifts
                    if s.output == HEAT and abs(s.tick - tick) < _SHIFT_TICKS
                ]
                if output == OUTPUTS.index("torque_nm") and not heating:
                    shifts.append(replace(shift, output=HEAT))
    return shifts


def shift_sizes(whitened: FloatArray, autocorrelation: FloatArray) -> FloatArray:
    """Estimated shift at each tick but the first, in its standard deviations, beside a level.

    For white noise it is the difference of the means after and before (a two-sample test).
    """
    limited, known = np.nan_to_num(np.clip(whitened, -_CLIP, _CLIP)), np.isfinite(whitened)
    sums, counts = (
        np.vstack([np.zeros((1, 3)), np.cumsum(columns, axis=0)]) for columns in (limited, known)
    )
    at = np.arange(1, len(whitened))
    low, high = np.maximum(at - _SHIFT_TICKS, 0), np.minimum(at + _SHIFT_TICKS, len(whitened))
    n_before, n_after = counts[at] - counts[low], counts[high] - counts[at]
    # a whitened level is ``new`` everywhere, a whitened shift 1 at its tick and ``new`` after
    new = 1.0 - autocorrelation
    after = (sums[high] - sums[at]) * new + limited[at] * autocorrelation
    level = (sums[high] - sums[low]) * new
    with np.errstate(all="ignore"):
        of_both, of_level = new * (1.0 + new * (n_after - 1.0)), new**2 * (n_before + n_after)
        variance = 1.0 + new**2 * (n_after - 1.0) - of_both**2 / of_level
        sizes = np.abs(after - of_both / of_level * level) / np.sqrt(variance)
    return np.asarray(
        np.where((n_before < _SHIFT_TICKS / 2) | (n_after < _SHIFT_TICKS / 2), 0.0, sizes)
    )


def drop_small_shifts(problem: Problem) -> None:
    """Drop shifts that became insignificant, e.g. at the end of an excluded window."""
    if not problem.shifts:
        return
    variances = np.diag(np.linalg.pinv(problem.information()))[len(problem.free) : -2]
    real = np.abs(problem.sizes) > _REAL_SHIFT * np.sqrt(variances)
    problem.set_shifts([problem.shifts[i] for i in np.flatnonzero(real)], problem.sizes[real])


def leave_out(problem: Problem, noise: FloatArray, progress: Callable[[], None]) -> list[str]:
    """Exclude windows in which the model does not follow an output; returns notes on them.

    ``noise`` is the whitened sensor noise. Iterated, because a disturbance hides in the parameters
    that it biases.
    """
    left = [np.zeros(segment.measured.shape, dtype=bool) for segment in problem.segments]
    followed, share = np.ones(len(OUTPUTS), dtype=bool), np.zeros(len(OUTPUTS))
    # A window that was left out stays out. An output that would lose more than it may is not
    # disturbed but badly modelled: it keeps its samples, and a note says so.
    for _ in range(_ROUNDS):
        disturbed = [disturbed_windows(whitened, noise) for whitened in problem.whitened]
        share = np.concatenate([new | old for new, old in zip(disturbed, left, strict=True)]).mean(
            axis=0
        )
        followed &= share < _LARGEST_SHARE
        new_ones = [new & ~old & followed for new, old in zip(disturbed, left, strict=True)]
        if not any(new.any() for new in new_ones):
            break
        for i, new in enumerate(new_ones):
            left[i] |= new
            segment = problem.segments[i]
            problem.segments[i] = replace(
                segment, measured=np.where(left[i], np.nan, segment.measured)
            )
        solve(problem, progress)
    notes = [
        f"{OUTPUTS[i]}: the model does not follow it in {100 * share[i]:.0f} % of the time; "
        "do not rely on "
        "parameters that depend on it"
        for i in np.flatnonzero(~followed)
    ]
    for segment, windows in zip(problem.segments, left, strict=True):
        for output, name in enumerate(OUTPUTS):
            edges = np.flatnonzero(np.diff(windows[:, output], prepend=False, append=False))
            for begin, end in edges.reshape(-1, 2):
                begin_s, end_s = segment.time_s[begin], segment.time_s[end - 1] + TICK_S
                notes.append(
                    f"{name}: disturbed at {begin_s:.0f} to {end_s:.0f} s, left out: "
                    "the model does not follow it there"
                )
    return notes


def disturbed_windows(residuals: FloatArray, noise: FloatArray) -> NDArray[np.bool_]:
    """Samples in windows, or next to them, whose mean or variance is not that of noise."""
    # windows that overlap by half; tests for mean and variance of clipped, whitened residuals
    parts = np.array_split(np.arange(len(residuals)), max(1, 2 * len(residuals) // _WINDOW_TICKS))
    marked = np.zeros(residuals.shape, dtype=bool)
    for output in range(residuals.shape[1]):
        sizes, squares = np.zeros(len(parts)), np.zeros(len(parts))
        for i, part in enumerate(parts):
            values = residuals[part[0] : part[0] + _WINDOW_TICKS, output]
            values = np.clip(values[np.isfinite(values)] / noise[output], -_EDGE, _EDGE)
            if values.size:
                sizes[i] = abs(values.mean()) * np.sqrt(values.size)
                squares[i] = np.mean(values**2)
        # coloured noise has larger means everywhere
        disturbed = sizes > _BIASED * max(1.0, float(np.median(sizes)) / 0.6745)
        disturbed |= squares > _RESTLESS * max(1.0, float(np.median(squares)))
        for window in np.flatnonzero(disturbed):
            begin = int(parts[window][0])
            marked[max(begin - _WINDOW_TICKS, 0) : begin + 2 * _WINDOW_TICKS, output] = True
    return marked
