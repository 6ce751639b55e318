"""Faults that residuals of the model can show.

Their signatures, and the size below which they do not matter.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from fsw_analysis.weld_signals import FloatArray
from fsw_control.units import KW_PER_NM_RPM
from fsw_model import ModelParameters
from fsw_quality.diagnosis import WatchCause
from fsw_quality.residuals import COEFFICIENTS, HEAT, Gains

#: by cause: largest size that does no harm, so that it is no fault, and largest that there can be.
#: In the units of ``monitor_texts.yaml`` before their factors: degC/s, mm/s, kN, N m/s, N m,
#: relative, s (chosen)
SIZES = {
    WatchCause.THERMOCOUPLE_DRIFT: (0.3 / 60.0, 1.0),
    WatchCause.DEPTH_DRIFT: (0.005 / 60.0, 0.005),
    WatchCause.LOAD_CELL_STEP: (0.5, 20.0),
    WatchCause.TORQUE_DRIFT: (1.0 / 60.0, 1.0),
    WatchCause.TORQUE_STEP: (15.0, 500.0),
    WatchCause.TOOL_WEAR: (1.0 / 60.0, 1.0),
    WatchCause.TORQUE_GAIN: (0.03, 0.6),
    WatchCause.DEPTH_GAIN: (0.03, 0.6),
    WatchCause.HEAT_GAIN: (0.03, 0.6),
    WatchCause.DEAD_TIME: (0.4, 5.0),
}
#: faults that show in the heat alone
OF_HEAT = WatchCause.HEAT_GAIN, WatchCause.DEAD_TIME


@dataclass(frozen=True, slots=True)
class Onset:
    """When faults may have begun, and what was there then."""

    time_s: float
    gains: Gains


def signatures(
    p: ModelParameters,
    faults: list[WatchCause],
    onsets: list[Onset],
    time_s: float,
    now: Gains,
    by_model: FloatArray,
) -> FloatArray:
    """What faults of size 1 do to the residuals at a time, shape (3, onsets, faults).

    ``by_model`` are the sensitivities to the coefficients, shape (3, coefficients ...).
    """
    since = np.array([max(time_s - onset.time_s, 0.0) for onset in onsets])
    # gains of the onset: those of now contain the noise that is in the residuals, too
    at: Any = Gains(*np.array([onset.gains for onset in onsets]).T)
    # power reaches the thermocouple behind the dead time, through the lag of the copper
    late = np.maximum(since - p.dead_time_s - p.tool_lag_s, 0.0)
    faded = np.exp(-late / p.copper_lag_s)
    heat_per_nm = -p.thermal_gain_c_per_kw * KW_PER_NM_RPM * at.speed_rpm
    follow = 1.0 - np.exp(-since / p.depth_pole_slow_s)
    sunk_per_kn = -p.depth_gain_mm_per_kn_s * (
        since + (p.depth_zero_s - p.depth_pole_slow_s) * follow
    )
    by_gain = now.creep_mm + now.slow_mm - at.creep_mm - at.slow_mm * (1.0 - follow)
    responses = np.zeros((3, len(onsets), len(faults)))

    def put(cause: WatchCause, **by_residual: FloatArray) -> None:
        if cause in faults:
            for name, value in by_residual.items():
                responses[("torque", "depth", "heat").index(name), :, faults.index(cause)] = value

    put(WatchCause.THERMOCOUPLE_DRIFT, depth=-at.mm_per_c * since, heat=since)
    put(WatchCause.DEPTH_DRIFT, torque=-at.nm_per_mm * since, depth=since)
    put(WatchCause.LOAD_CELL_STEP, torque=-at.nm_per_kn, depth=sunk_per_kn)
    put(
        WatchCause.TORQUE_DRIFT,
        torque=since,
        heat=heat_per_nm * (late - p.copper_lag_s * (1.0 - faded)),
    )
    put(WatchCause.TORQUE_STEP, torque=np.ones(since.size), heat=heat_per_nm * (1.0 - faded))
    put(WatchCause.TOOL_WEAR, torque=since)
    put(WatchCause.TORQUE_GAIN, torque=np.full(since.size, now.process_nm))
    put(WatchCause.DEPTH_GAIN, depth=by_gain)
    put(WatchCause.HEAT_GAIN, heat=now.heated_c - at.heated_c * faded)
    dead_time = by_model[HEAT, COEFFICIENTS.index("dead_time_s")] / p.dead_time_s
    put(WatchCause.DEAD_TIME, heat=np.full(since.size, dead_time))
    return responses
