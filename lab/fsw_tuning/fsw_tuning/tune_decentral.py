"""Tunes the decentralized controller for a process model.

Minimises the errors in set-point steps and output disturbances under bounds: on the peak Ms of the
sensitivity of each loop with the other one closed and one whole tick of delay added, and on the
moves that sensor noise causes. A figure above its target costs much more than the same figure
below it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy
from numpy.typing import NDArray

from fsw_decentral import Gains, tunings
from fsw_model import ModelParameters, OperatingPointError, nominal
from fsw_plant.process import process_model
from fsw_tuning.decentral_loop import errors, noise_moves, sensitivity
from fsw_tuning.standard_cases import REST

Vector = NDArray[np.float64]
#: Margins by which bounds and targets are kept, so that they hold after rounding.
_BOUND_MARGIN, _TARGET_MARGIN = 0.985, 0.995
#: cost of exceeding a target or a bound, per relative excess
_MISSED, _BROKEN = 5.0, 50.0
#: beyond this excess over the bounds nothing is simulated; the loop may be unstable
_UNUSABLE = 0.5
_SWINGING_C = 2.0
#: how far the first simplex of the search reaches from the start, in logarithms of the gains
_REACH = 0.25
EVALUATIONS = 3000
NAMES = tuple(tunings())


def _by_name(table: dict[str, tuple[float, float]]) -> dict[str, dict[str, float]]:
    """By the names of the tunings.

    The first column of a table for the conservative one, the second for all others.
    """
    return {
        name: {key: row[name != "conservative"] for key, row in table.items()} for name in NAMES
    }


#: Upper bounds: Ms of each loop, standard deviation of the moves per tick under sensor noise.
BOUNDS = _by_name(
    {
        "ms_depth": (1.6, 2.0),
        "ms_temperature": (1.6, 2.0),
        "noise_move_kn": (0.03, 0.12),
        "noise_move_rpm": (0.5, 0.8),
    }
)
#: Targets of the search: figures of another, independent tuning of such loops on the paper's
#: process.
TARGETS = _by_name(
    {
        "tracking_iae_depth_mm_s": (4.08, 1.48),
        "tracking_iae_temperature_c_s": (300.0, 207.0),
        "disturbance_iae_depth_mm_s": (0.93, 0.34),
        "disturbance_iae_temperature_c_s": (45.0, 45.0),
        "depth_up_iae_mm_s": (1.82, 0.679),
        "depth_down_iae_mm_s": (1.78, 0.654),
        "depth_disturbance_iae_mm_s": (0.778, 0.302),
        "temperature_up_iae_c_s": (136.0, 82.4),
        "temperature_down_iae_c_s": (137.0, 84.1),
        "temperature_disturbance_iae_c_s": (39.1, 38.3),
        "depth_up_peak_c": (0.85, 1.42),
        "depth_down_peak_c": (0.86, 3.24),
        "depth_disturbance_peak_c": (0.86, 3.24),
    }
)

#: Searched for, with the range: all gains but the model's (decoupling, predictor). The unit is
#: that of the gain. The events hardly reach the bounds of the speed, so the range is what keeps
#: the tracking times short enough for a speed that rests at a bound.
SEARCHED = {
    "depth_gain": (1.0, 500.0),
    "depth_integral_time": (0.3, 100.0),
    "depth_derivative_time": (0.001, 2.0),
    "depth_filter": (0.02, 5.0),
    "depth_weight": (0.001, 1.0),
    "depth_reference_filter": (0.01, 20.0),
    "depth_tracking_time": (0.1, 100.0),
    "temperature_gain": (0.01, 2.0),
    "temperature_integral_time": (3.0, 200.0),
    "temperature_derivative_time": (0.001, 4.0),
    "temperature_filter": (0.02, 5.0),
    "temperature_weight": (0.01, 1.0),
    "temperature_reference_filter": (0.01, 20.0),
    "temperature_tracking_time": (1.0, 25.0),
    "power_gain": (0.02, 15.0),
    "power_integral_time": (0.2, 20.0),
    "power_filter": (0.02, 3.0),
    "power_tracking_time": (0.1, 30.0),
    "feedforward_filter": (0.02, 10.0),
}


def start_of(name: str, parameters: ModelParameters) -> Gains:
    """Where the search for one of ``NAMES`` starts.

    Internal model control of the loops by themselves.
    """
    # Internal model control (Morari and Zafiriou 1989): the temperature is a lag with dead time,
    # so that its PI has the copper's lag as integral time and a gain by the time constant wanted
    # of the closed loop; the depth integrates the force, so that its gain is the bandwidth over
    # that.
    p, tight = parameters, name != "conservative"
    predicts = name == "smith"
    closed_s = (0.35 if predicts else 1.0 if tight else 1.4) * p.dead_time_s
    heat_c_per_kw_s = p.thermal_gain_c_per_kw / p.copper_lag_s
    creep_mm_per_kn_s = p.depth_gain_mm_per_kn_s * p.depth_zero_s / p.depth_pole_slow_s
    return Gains(
        depth_gain=(0.6 if tight else 0.25) / creep_mm_per_kn_s,
        depth_integral_time=3.0 if tight else 5.5,
        depth_derivative_time=0.05,
        depth_filter=0.2 if tight else 0.5,
        depth_weight=0.07 if tight else 0.3,
        depth_reference_filter=0.05 if tight else 1.0,
        depth_tracking_time=0.2 if tight else 1.0,
        temperature_gain=1.0 / (heat_c_per_kw_s * (closed_s + p.dead_time_s)),
        temperature_integral_time=p.copper_lag_s + p.tool_lag_s,
        temperature_derivative_time=1.5 * p.tool_lag_s,
        temperature_filter=(0.7 if predicts else 0.35) * p.tool_lag_s,
        temperature_weight=0.95,
        temperature_reference_filter=0.1 if tight else 1.0,
        temperature_tracking_time=20.0,
        power_gain=2.0 if tight else 1.5,
        power_integral_time=0.25,
        power_filter=0.15,
        power_tracking_time=20.0,
        feedforward_filter=0.15 if tight else 0.25,
        **(_model_of(p) if predicts else {}),
    )


def _model_of(parameters: ModelParameters) -> dict[str, float]:
    """Gains that are the model's, linearised at the operating point."""
    p, model = parameters, process_model(parameters)
    at = model.equilibrium(REST.depth_mm, REST.temperature_c)
    more = model.outputs(at.state, at.force_kn + 1.0, at.speed_rpm)
    return {
        "predictor_gain": p.thermal_gain_c_per_kw,
        "predictor_copper_lag": p.copper_lag_s,
        "predictor_tool_lag": p.tool_lag_s,
        "predictor_dead_time": p.dead_time_s,
        "decoupling_torque": float(f"{more.process_torque_nm - at.outputs.process_torque_nm:.4g}"),
        "decoupling_lag": p.motor_lag_s,
    }


def robustness(gains: Gains, parameters: ModelParameters) -> dict[str, float]:
    """The figures of a set of gains that have ``BOUNDS``."""
    peaks, moves = sensitivity(gains, parameters), noise_moves(gains, parameters)
    return {
        "ms_depth": peaks[0],
        "ms_temperature": peaks[1],
        "noise_move_kn": moves[0],
        "noise_move_rpm": moves[1],
    }


def cost(gains: Gains, name: str, parameters: ModelParameters) -> float:
    """Mean of the figures over their targets, with penalties for missed targets and bounds."""
    # The robustness is computed in the frequency domain and is cheap: gains that break it by far
    # are not simulated. Penalties grow linearly, so that the simplex finds its way back.
    robust = robustness(gains, parameters)
    excess = sum(
        max(robust[key] / bound - _BOUND_MARGIN, 0.0) for key, bound in BOUNDS[name].items()
    )
    unusable = 1e3 + min(excess, 1e3)
    if excess > _UNUSABLE:
        return unusable
    try:
        figures = errors(gains, parameters)
    except OperatingPointError:
        return unusable
    shares = np.array([figures[key] / target for key, target in TARGETS[name].items()])
    missed = np.maximum(shares - _TARGET_MARGIN, 0.0).sum()
    swing = max(figures["unsettled_c"] - _SWINGING_C, 0.0)
    return float(shares.mean() + _MISSED * missed + _BROKEN * (excess + swing))


def tune(
    name: str,
    parameters: ModelParameters | None = None,
    evaluations: int = EVALUATIONS,
    progress: Callable[[float], None] | None = None,
) -> Gains:
    """Search for a set of gains from ``start_of`` on; rounded to three digits.

    Parameters
    ----------
    name : str
        One of ``NAMES``.
    parameters : ModelParameters, optional
        The paper's by default.
    evaluations : int
        Largest number of evaluations of the cost, some 0.1 s each.
    progress : callable, optional
        Called with the share of the evaluations done, 0 to 1.
    """
    p = parameters or nominal()
    start = start_of(name, p)
    ranges = np.log(list(SEARCHED.values()))
    done = 0

    def gains_of(x: Vector) -> Gains:
        return start.changed(
            **{key: float(f"{v:.3g}") for key, v in zip(SEARCHED, np.exp(x), strict=True)}
        )

    def cost_of(x: Vector) -> float:
        nonlocal done
        done += 1
        if progress is not None:
            progress(min(done / evaluations, 1.0))
        return cost(gains_of(x), name, p)

    # Nelder-Mead, as the cost has kinks at targets and bounds; in logarithms, as gains differ by
    # decades. The adaptive form (Gao and Han 2012) suits the many unknowns.
    x = np.clip(np.log([getattr(start, key) for key in SEARCHED]), *ranges.T)
    reach = np.where(x + _REACH <= ranges[:, 1], _REACH, -_REACH)
    simplex = np.vstack([x, x + np.diag(reach)])
    options = {"adaptive": True, "initial_simplex": simplex, "maxfev": evaluations}
    return gains_of(
        scipy.optimize.minimize(cost_of, x, method="Nelder-Mead", bounds=ranges, options=options).x
    )
