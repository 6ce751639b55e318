"""Finds changes of set-points and disturbances in a weld, and the end of its scenario."""

from __future__ import annotations

from dataclasses import dataclass, fields, is_dataclass, replace
from math import inf, nan
from typing import Any

import numpy as np
import numpy.typing as npt
import yaml

from fsw_analysis.weld_signals import WeldSignals
from fsw_control.schema.yaml_text import load_yaml
from fsw_control.weld import TICK_S

#: Changes closer together than this belong to one event (a ramp or a sine is one message per
#: tick).
_GROUP_TICKS = 10
#: smaller steps are rounding
_SMALLEST_STEP = 1e-9
#: a tick at the scenario's end may be later by this
_LATE_S = 1e-6
#: the last tick of a scenario on a real clock may be earlier by this
_SHORT_S = 2.5 * TICK_S


@dataclass(frozen=True, slots=True)
class Change:
    """One quantity starts to change."""

    #: ``depth_reference``, ``temperature_reference``, ``depth_disturbance`` or
    #: ``temperature_disturbance``
    quantity: str
    #: first and last tick of the change; equal for a step
    begin: int
    end: int
    #: new minus old value; of a lasting change (ramp, sine) the largest excursion, with its sign
    size: float

    @property
    def is_step(self) -> bool:
        """Whether the whole change happened at one tick."""
        return self.begin == self.end


def marks(signals: WeldSignals) -> dict[str, list[float]]:
    """Times [s] at which set-points, disturbances and faults change, as the bag shows them."""
    by_kind: dict[str, list[int]] = {"set-point": [], "disturbance": [], "fault on, off": []}
    for change in changes(signals):
        by_kind["set-point" if change.quantity.endswith("reference") else "disturbance"].append(
            change.begin
        )
    if signals.truth is not None:
        for values in (signals.truth.force_disturbance_kn, signals.truth.speed_disturbance_rpm):
            by_kind["disturbance"] += [change.begin for change in _changes("", values)]
        faults = signals.truth.active_faults
        by_kind["fault on, off"] = (np.flatnonzero(faults[1:] != faults[:-1]) + 1).tolist()
    return {kind: signals.time_s[sorted(set(ticks))].tolist() for kind, ticks in by_kind.items()}


def changes(signals: WeldSignals) -> list[Change]:
    """All changes of set-points and output disturbances, in order of time."""
    series = {
        "depth_reference": signals.reference_depth_mm,
        "temperature_reference": signals.reference_temperature_c,
    }
    if signals.truth is not None:
        series["depth_disturbance"] = signals.truth.depth_disturbance_mm
        series["temperature_disturbance"] = signals.truth.temperature_disturbance_c
    steps = [
        change for quantity, values in series.items() for change in _changes(quantity, values)
    ]
    return sorted(steps, key=lambda change: change.begin)


def _changes(quantity: str, values: npt.NDArray[np.float64]) -> list[Change]:
    if values.size < 2:
        return []
    slopes = np.diff(values)
    ticks = (
        np.flatnonzero(np.abs(slopes) > _SMALLEST_STEP) + 1
    )  # NaN compares false: a value that appears is not a change
    steps: list[Change] = []
    for group in np.split(ticks, np.flatnonzero(np.diff(ticks) > _GROUP_TICKS) + 1):
        if not group.size:
            continue
        begin, end = int(group[0]), int(group[-1])
        excursion = values[begin : end + 1] - values[begin - 1]
        steps.append(Change(quantity, begin, end, float(excursion[np.argmax(np.abs(excursion))])))
    return steps


def cut_to_scenario(signals: WeldSignals) -> WeldSignals:
    """Cut the ticks after the end of the attached scenario; unchanged without one."""
    n = int(np.searchsorted(signals.time_s, _scenario_s(signals) + _LATE_S, side="right"))
    return signals if n >= signals.n_ticks else part(signals, slice(n))


def _scenario_s(signals: WeldSignals) -> float:
    """Duration of the scenario that is attached to the bag.

    Infinite where it has none, as one of phases.
    """
    text = signals.attachments.get("scenario.yaml")
    try:
        content = load_yaml(text.decode()) if text else None
        return float(content["duration_s"]) if isinstance(content, dict) else inf
    except (yaml.YAMLError, KeyError, TypeError, ValueError):
        return inf


def missing_at_end_s(signals: WeldSignals) -> float:
    """Seconds of a weld missing at the end of its record; NaN if their number is unknown.

    How long it should be is known from its scenario; of a programme without a duration, that its
    end was reported.
    """
    lasts_s = _scenario_s(signals)
    if lasts_s < inf:
        missing_s = lasts_s - float(signals.time_s[-1])
        return missing_s if missing_s > _SHORT_S else 0.0
    over = any(
        event.kind == "weld" and event.subject in ("done", "aborted") for event in signals.events
    )
    return nan if signals.phases and not over else 0.0


def part(value: Any, ticks: slice) -> Any:
    """A copy of signals with some ticks of every array."""
    if isinstance(value, np.ndarray):
        return value[ticks]
    if isinstance(value, dict):
        return {name: part(inner, ticks) for name, inner in value.items()}
    if is_dataclass(value) and not isinstance(value, type):
        return replace(
            value, **{item.name: part(getattr(value, item.name), ticks) for item in fields(value)}
        )
    return value
