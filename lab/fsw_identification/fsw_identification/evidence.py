"""What is chosen by the evidence: sizes of the random walks, colour of the sensors' noise, lag of the thermocouple."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy

from fsw_analysis.weld_signals import FloatArray
from fsw_identification.elimination import Eliminated
from fsw_identification.noise import autocorrelation_of
from fsw_identification.problem import STATE_PRIOR, WALK, WALKS_OF, Part, Problem
from fsw_identification.simulation import OUTPUTS

#: largest factor on the size of a walk in one iteration
_WALK_STEP = 4.0
#: what a disturbance has to add to the evidence before its size is e times the smallest
_PARSIMONY = 4.0
#: shortest and longest correlation times of the noise that are tried [s]
_CORRELATION_S = (0.02, 30.0)


def _evidence_of(problem: Problem, border: FloatArray, parts: Sequence[Eliminated]) -> float:
    """Minus twice its logarithm, but for a constant, at the present parameters with the best shifts."""
    n = 1 + len(problem.free)
    cost = border[0, 0] - border[n:, 0] @ np.linalg.solve(border[n:, n:], border[n:, 0])
    cost += 2.0 * np.log(problem.lag_deviation_s)
    return float(cost + np.linalg.slogdet(border[1:, 1:])[1] + sum(part.logdet for part in parts))


def likely_walk(problem: Problem, parts: Sequence[Part]) -> FloatArray:
    """Sizes of the random walks with the largest evidence, of one after the other."""
    found: FloatArray = problem.walk.copy()

    def of_size(log_size: float, of_output: list[Part], at: tuple[int, int]) -> float:
        sizes = found.copy()
        sizes[at] = np.exp(log_size)
        return (
            _evidence_of(problem, *problem.eliminate(of_output, True, sizes))
            + _PARSIMONY * log_size
        )

    for output, which in enumerate(WALKS_OF):
        of_output = [part for part in parts if part.output == output]
        for at in ((i, walk) for walk in which for i in range(2)):
            bounds = np.clip(
                np.log(found[at]) + np.log(_WALK_STEP) * np.array([-1, 1]), *np.log(WALK[::2, *at])
            )
            best = scipy.optimize.minimize_scalar(
                of_size,
                args=(of_output, at),
                method="bounded",
                bounds=bounds,
                options={"xatol": 0.1},
            )
            found[at] = np.exp(best.x)
    return found


def take_likely_colour(problem: Problem, parts: Sequence[Part]) -> None:
    """Take the correlation of each output's noise with the largest evidence."""
    for output in range(len(OUTPUTS)):
        of_output = [part for part in parts if part.output == output]

        def take(log_s: float, output: int = output, of_output: list[Part] = of_output) -> float:
            problem.autocorrelation[output] = autocorrelation_of(np.exp(log_s))
            problem.take_noise(output)
            for part in of_output:
                problem.compress(part)
            return _evidence_of(problem, *problem.eliminate(of_output, True)) + of_samples(
                problem, output
            )

        bounds = np.log(_CORRELATION_S)
        take(
            scipy.optimize.minimize_scalar(
                take, method="bounded", bounds=bounds, options={"xatol": 0.1}
            ).x
        )


def evidence(problem: Problem) -> float:
    """Minus twice the logarithm of the evidence at the last solution, but for a constant."""
    parts = problem.linearised(problem.parameters, True)
    found = _evidence_of(problem, *problem.eliminate(parts, True))
    # a thermocouple that lags is another state
    found += sum(
        2.0 * float(np.log(STATE_PRIOR[p.output][: p.response.gains.size]).sum()) for p in parts
    )
    return found + sum(of_samples(problem, output) for output in range(len(OUTPUTS)))


def of_samples(problem: Problem, output: int) -> float:
    """What the density of the samples of an output adds to minus twice the logarithm of the evidence."""
    found = 0.0
    for i, weights in enumerate(problem.weights):
        scale = problem.whitening(i, output).scale[weights[:, output] > 0.0]
        found += 2.0 * float(np.log(problem.noise[output] / scale).sum())
    return found


def likely_colour(problem: Problem) -> FloatArray:
    """(3,): autocorrelation of the noise from tick to tick with the largest evidence at a solution, which stays."""
    trial = problem.variant(
        autocorrelation=problem.autocorrelation.copy(), noise=problem.noise.copy()
    )
    take_likely_colour(trial, trial.linearised(trial.parameters, True))
    return trial.autocorrelation


def likely_lag(problem: Problem) -> tuple[float, float]:
    """Lag of the thermocouple according to the depth, and its standard deviation.

    Computed at a solution without a lag, which stays as it is.
    """
    border, _ = problem.variant(lagged=True).eliminate(
        problem.linearised(problem.parameters, True), True
    )
    covariance = np.linalg.inv(border[1:, 1:])
    return float(covariance[-1] @ border[1:, 0]), float(np.sqrt(covariance[-1, -1]))
