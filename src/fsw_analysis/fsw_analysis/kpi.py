"""Figures of merit from the signals of a weld: simulated, run in the graph, or recorded."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from fsw_analysis.changes import Change, changes
from fsw_analysis.weld_signals import FloatArray, TruthSignals, WeldSignals
from fsw_control.schema.errors import InputError

#: Dead-bands of the paper's controller, section IV.
DEAD_BAND_DEPTH_MM = 0.002
DEAD_BAND_TEMPERATURE_C = 0.1
#: An output has settled when its error stays within this share of the step (at least within the
#: dead-band).
SETTLED_SHARE = 0.05
#: Largest error of one output while the other is changed alone: by key, the quantity
#: that is changed and the sign of its change (0: either).
_COUPLING = {
    "peak_temperature_in_depth_step_up_c": ("depth_reference", 1.0),
    "peak_temperature_in_depth_step_down_c": ("depth_reference", -1.0),
    "peak_depth_in_temperature_step_mm": ("temperature_reference", 0.0),
    "peak_temperature_after_depth_disturbance_c": ("depth_disturbance", 0.0),
    "peak_depth_after_temperature_disturbance_mm": ("temperature_disturbance", 0.0),
}
_PEAKS = {"c": "peak_temperature_error_c", "mm": "peak_depth_error_mm"}


def compute(signals: WeldSignals, label: str = "") -> dict[str, Any]:
    """Figures of merit of one run.

    Errors are those of the true outputs (disturbances included, sensor noise not) where the bag
    has the emulator's truth, else of the measured ones; ``outputs`` says which.

    Parameters
    ----------
    signals : WeldSignals
    label : str
        Name of the run in tables; its folder's name by default.

    Returns
    -------
    dict
        Ready for JSON: numbers under flat keys with their unit in the name, None where a figure
        does not exist in this run, and ``events``, a list with the figures of each change of a
        set-point or a disturbance.

    Raises
    ------
    InputError
        With fewer than two ticks.
    """
    if signals.n_ticks < 2:
        raise InputError(
            f"{signals.path}: has {signals.n_ticks} ticks; figures of merit need at least 2"
        )
    dt = np.diff(
        signals.time_s, prepend=signals.time_s[0] - float(np.median(np.diff(signals.time_s)))
    )
    outputs = true_or_measured(signals)
    depth_error = outputs.depth_mm - signals.reference_depth_mm
    temperature_error = outputs.temperature_c - signals.reference_temperature_c
    events = _events(changes(signals), depth_error, temperature_error, signals.time_s, dt)
    result: dict[str, Any] = {
        "label": label or signals.path.name,
        "controllers": [name for name in dict.fromkeys(signals.command_source) if name],
        "outputs": "measured" if outputs is signals else "truth",
        "duration_s": round(signals.duration_s, 9),
        "ticks": signals.n_ticks,
        "ticks_without_output": int(
            np.sum(~np.isfinite(outputs.depth_mm) | ~np.isfinite(outputs.temperature_c))
        ),
        "ticks_without_command": int(np.sum(~np.isfinite(signals.force_kn))),
        **_integrals_of_absolute_errors(depth_error, temperature_error, dt),
        "ise_depth_mm2_s": _integral(depth_error**2, dt),
        "ise_temperature_c2_s": _integral(temperature_error**2, dt),
        "in_dead_band_depth_share": _share(np.abs(depth_error), DEAD_BAND_DEPTH_MM),
        "in_dead_band_temperature_share": _share(
            np.abs(temperature_error), DEAD_BAND_TEMPERATURE_C
        ),
        "total_variation_force_kn": _variation(signals.force_kn),
        "total_variation_speed_rpm": _variation(signals.speed_rpm),
        **_summary(events),
    }
    for name, status in signals.statuses.items():
        times = (
            status.solve_time_s[np.isfinite(status.solve_time_s) & (status.solve_time_s > 0.0)]
            * 1e3
        )
        if times.size:
            result[f"solve_time_{name}_p50_ms"] = float(np.percentile(times, 50))
            result[f"solve_time_{name}_p99_ms"] = float(np.percentile(times, 99))
            result[f"solve_time_{name}_max_ms"] = float(times.max())
    result["events"] = events
    return result


def true_or_measured(signals: WeldSignals) -> WeldSignals | TruthSignals:
    """Outputs: the emulator's truth if the bag has it, else the sensors."""
    truth = signals.truth
    return truth if truth is not None and np.isfinite(truth.depth_mm).any() else signals


def _integrals_of_absolute_errors(
    depth_error: FloatArray, temperature_error: FloatArray, dt: FloatArray
) -> dict[str, float | None]:
    return {
        "iae_depth_mm_s": _integral(np.abs(depth_error), dt),
        "iae_temperature_c_s": _integral(np.abs(temperature_error), dt),
    }


def _integral(values: FloatArray, dt: FloatArray) -> float | None:
    known = np.isfinite(values)
    return float(np.sum(values[known] * dt[known])) if known.any() else None


def _share(error: FloatArray, band: float) -> float | None:
    return _of_known(error, lambda known: np.mean(known <= band))


def _variation(values: FloatArray) -> float | None:
    return _of_known(values, lambda known: np.sum(np.abs(np.diff(known))))


def _peak(error: FloatArray) -> float | None:
    return _of_known(error, lambda known: np.abs(known).max())


def _of_known(values: FloatArray, figure: Callable[[FloatArray], Any]) -> float | None:
    known = values[np.isfinite(values)]
    return float(figure(known)) if known.size else None


def _events(
    changed: list[Change],
    depth_error: FloatArray,
    temperature_error: FloatArray,
    time_s: FloatArray,
    dt: FloatArray,
) -> list[dict[str, Any]]:
    """Figures of each change, in the window until the next change begins."""
    begins = [*sorted({change.begin for change in changed}), len(time_s)]
    events: list[dict[str, Any]] = []
    for change in changed:
        window = slice(change.begin, next(begin for begin in begins if begin > change.begin))
        of_depth = change.quantity.startswith("depth")
        error = depth_error[window] if of_depth else temperature_error[window]
        unit, band = ("mm", DEAD_BAND_DEPTH_MM) if of_depth else ("c", DEAD_BAND_TEMPERATURE_C)
        entry: dict[str, Any] = {
            "time_s": round(float(time_s[change.begin]), 9),
            "quantity": change.quantity,
            "kind": "step" if change.is_step else "lasting",
            f"size_{unit}": change.size,
            "until_s": round(float(time_s[window.stop - 1] + dt[-1]), 9),
            "alone": sum(other.begin == change.begin for other in changed) == 1,
            **_integrals_of_absolute_errors(
                depth_error[window], temperature_error[window], dt[window]
            ),
            "peak_depth_error_mm": _peak(depth_error[window]),
            "peak_temperature_error_c": _peak(temperature_error[window]),
        }
        if change.is_step and np.isfinite(error).any():
            entry["settling_s"] = _settling(
                error, max(SETTLED_SHARE * abs(change.size), band), time_s[window]
            )
            # a set-point's overshoot is an error along the step, a disturbance's is one against it
            direction = np.sign(change.size) * (
                1.0 if change.quantity.endswith("reference") else -1.0
            )
            beyond = max(0.0, float(np.nanmax(error * direction)))
            entry[f"overshoot_{unit}"] = beyond
            entry["overshoot_percent"] = 100.0 * beyond / abs(change.size)
        events.append(entry)
    return events


def _settling(error: FloatArray, band: float, time_s: FloatArray) -> float | None:
    outside = np.flatnonzero(~(np.abs(error) <= band))
    if not outside.size:
        return 0.0
    last = int(outside[-1])
    return None if last + 1 >= len(error) else round(float(time_s[last + 1] - time_s[0]), 9)


def _summary(events: list[dict[str, Any]]) -> dict[str, float | None]:
    """Worst value of all events; None without such an event."""

    def largest(key: str, quantity: str = "", sign: float = 0.0) -> float | None:
        """Largest value of all events, or of changes of one quantity alone in one direction."""
        chosen = [
            event.get(key)
            for event in events
            if not quantity
            or (event["quantity"] == quantity and event["alone"] and sign * _size(event) >= 0.0)
        ]
        return max((value for value in chosen if value is not None), default=None)

    return {
        "overshoot_depth_mm": largest("overshoot_mm"),
        "overshoot_temperature_c": largest("overshoot_c"),
        "longest_settling_s": largest("settling_s"),
        "steps_not_settled": float(
            sum("settling_s" in event and event["settling_s"] is None for event in events)
        ),
        **{
            key: largest(_PEAKS[key.rpartition("_")[2]], *change)
            for key, change in _COUPLING.items()
        },
    }


def _size(event: dict[str, Any]) -> float:
    return float(event["size_mm"] if "size_mm" in event else event["size_c"])
