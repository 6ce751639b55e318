"""Fit of the disturbances to the published statistics of the cascade.

Two parameters (:data:`welds.FITTED`) for four targets: mean, standard deviation and extremes of
the measured temperature's error in a group of eight welds. The error of a weld is nearly linear in
the fall of its power and the size of its random heat, as long as the random numbers are the same,
so that a few more welds give the error for any values of the parameters. Rounds follow, each
linear about the result of the one before, until a round changes no parameter by more than
:data:`CONVERGED`. Other welds, those of the page, verify the result.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import astuple
from typing import Any

import numpy as np

from fsw_analysis.phase_kpi import PUBLISHED
from realistic import welds
from realistic.welds import FITTED, GROUP, STATISTICS, Figures, Task

#: welds of the campaign that are used for the fit, and by nothing else
WELDS = range(16)
#: change of fall and heat for the differences, welds for that of the fall, which is nearly the
#: same for all
_STEP, _FALL_WELDS = 0.3, 2
#: largest relative change of the last round, and the most rounds
CONVERGED, _ROUNDS = 0.02, 4
#: on the shipped values of :data:`welds.FITTED`; the error's trace of each task
Factors = tuple[float, float]
Traces = Callable[[Sequence[Task]], Sequence[Figures]]


def trace(task: Task) -> Figures:
    """Error of the measured temperature over the joint line."""
    signals, inside, _ = welds.joint_line(task)
    return np.asarray((signals.temperature_c - signals.reference_temperature_c)[inside])


def fit(traces: Traces, indices: Sequence[int] = WELDS) -> dict[str, Any]:
    """Factors on the shipped values that explain the published statistics best, by rounds."""
    shipped = welds.shipped_values()
    wanted = np.array(astuple(PUBLISHED["cascade"][1]))
    factors: Factors = (1.0, 1.0)
    rounds: list[dict[str, Any]] = []
    converged = False
    while not converged and len(rounds) < _ROUNDS:
        model = Surrogate(traces, factors, indices)
        before, at_start = factors, model.statistics(factors)
        factors = model.solve(wanted)
        converged = max(abs(f / b - 1.0) for f, b in zip(factors, before, strict=True)) < CONVERGED
        rounds.append(
            {
                "from": dict(zip(FITTED, before, strict=True)),
                "at_start": at_start.tolist(),
                "expected": model.statistics(factors).tolist(),
                "scale": model.scale.tolist(),
            }
        )
    return {
        "values": {name: f * shipped[name] for name, f in zip(FITTED, factors, strict=True)},
        "start": {name: shipped[name] for name in FITTED},
        "statistics": list(STATISTICS),
        "wanted": wanted.tolist(),
        "rounds": rounds,
        "converged": converged,
        "welds": len(indices),
    }


class Surrogate:
    """Error of the welds, linear in fall and heat about given factors on the shipped values."""

    def __init__(self, traces: Traces, about: Factors, indices: Sequence[int]) -> None:
        self._about = fall, heat = about
        more = 1.0 + _STEP
        points = [(about, indices), ((fall, heat * more), indices)]
        points += [((fall * more, heat), indices[:_FALL_WELDS])]
        made = traces(
            [
                Task("decentral", i, tuple(zip(FITTED, factors, strict=True)))
                for factors, chosen in points
                for i in chosen
            ]
        )
        length = min(map(len, made))
        errors = np.array([error[:length] for error in made])
        self._error, warmer, falling = np.split(errors, [len(indices), 2 * len(indices)])
        #: change of the error with the relative change of the fall and of the heat
        self._by_fall = (falling - self._error[:_FALL_WELDS]).mean(0) / _STEP
        self._by_heat = (warmer - self._error) / _STEP
        drawn = welds.grouped(self._figures(about), GROUP)
        self.scale = drawn.std(0)  #: standard deviations of a group's statistics

    def _figures(self, factors: Factors) -> Figures:
        fall, heat = (f / about - 1.0 for f, about in zip(factors, self._about, strict=True))
        error = self._error + fall * self._by_fall + heat * self._by_heat
        return np.stack([error.mean(1), np.square(error).mean(1), error.min(1), error.max(1)], 1)

    def statistics(self, factors: Factors) -> Figures:
        """Expected statistics of a group that is drawn from the welds with replacement.

        The expected extreme is a sum over the sorted extremes of the welds, and so changes
        continuously with the factors.
        """
        mean, square, low, high = self._figures(factors).T
        share = (np.arange(len(mean) + 1) / len(mean)) ** GROUP
        weights = np.diff(share)
        average = mean.mean()
        extremes = np.sort(low)[::-1] @ weights, np.sort(high) @ weights
        return np.array([average, np.sqrt(square.mean() - average**2), *extremes])

    def solve(self, wanted: Figures) -> Factors:
        """Factors with the least squares of the deviations, each relative to its scale."""
        from scipy.optimize import least_squares  # heavy to import

        solution = least_squares(
            lambda f: (self.statistics((f[0], f[1])) - wanted) / self.scale,
            self._about,
            bounds=(0.2, 3.0),
            diff_step=1e-3,
        )
        fall, heat = map(float, solution.x)
        return fall, heat
