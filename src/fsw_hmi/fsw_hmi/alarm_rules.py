"""When there is an alarm. The texts are data."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import isfinite
from typing import Any

from fsw_control.contract import SENSORS
from fsw_hmi.alarms import Alarm
from fsw_hmi.limits import QUALITY_DEPTH_MM, QUALITY_TEMPERATURE_C

#: time without measurements, without samples of one sensor, and without reports of a node, after which that is an alarm
_NO_TICK_S, _NO_SAMPLE_S, NO_REPORT_S = 0.5, 0.5, 3.5
#: time for which a controller must not be ready before that is an alarm
_NOT_READY_S = 3.0
#: how far a value must come back inside its quality limits, chosen
_BACK_MM, _BACK_C = 0.02, 2.0
#: parts, behind the name of their node, that other rules cover
_OTHER_RULES = ("controller", "process", "arbiter")

_INTERLOCKS = {
    "temperature_low": ("Temperature too low", "Look for the cause; raise the temperature's set-point"),
    "temperature_high": ("Temperature too high", "Look for the cause; lower the temperature's set-point"),
    "depth_high": ("Shoulder too deep", "Lower the depth's set-point; check the depth sensors"),
    "force_high": ("Axial force too high", "Check force drive and load cell; lower the depth's set-point"),
    "torque_high": ("Torque too high", "Check tool and temperature: cold copper is stiff"),
    "power_high": ("Power too high", "Check spindle speed and torque; lower the temperature's set-point"),
}
#: priority and what follows, by level of an interlock
_LEVELS = {"warn": ("medium", "warning"), "trip": ("high", "tripped")}
#: by kind: priority, what is wrong, what to do
_TEXTS: dict[str, tuple[str, str, str]] = {
    "measurements": ("high", "No measurements: {why}", "Check plant or gateway; be ready to stop at the machine"),
    "supervisor": ("high", "No supervisor: no commands", "Start one; the drives hold, then go to safe values"),
    "safe_stop": (
        "high",
        "Safe stop: {why}",
        "Remove the cause, acknowledge; then mode auto goes on",
    ),
    "hold": ("medium", "Command held: {why}", "Get a controller ready, or choose manual; a safe stop follows"),
    "failover": (
        "medium",
        "{actual} commands in place of {target}: {why}",
        "Find out why, then switch back",
    ),
    "inhibited": ("medium", "Controller {name} inhibited: {why}", "See its log; choosing mode auto readmits it"),
    "not_ready": (
        "low",
        "Controller {name} not ready: {why}",
        "No fallback while it lasts; restart its node",
    ),
    "sensor": ("medium", "Sensor {name}: {why}", "Check sensor and cable; no controller does without it for long"),
    "quality_depth": ("medium", "Depth outside its quality limits", "Note time and angle; check set-point, controller"),
    "quality_temperature": (
        "medium",
        "Temperature outside its quality limits",
        "Note time and angle; check set-point, controller",
    ),
    "part_error": ("medium", "{name}: {why}", "See the log of this node"),
    "node_silent": ("low", "{name}: no more reports", "Check whether this node still runs"),
}


def _alarm(kind: str, **values: str) -> Alarm:
    priority, text, advice = _TEXTS[kind]
    return Alarm(text.format(**values), advice.format(**values), priority)


@dataclass(frozen=True, slots=True)
class Part:
    """Diagnostics of a part: ``ok``, ``warn``, ``error`` or ``stale``."""

    level: str
    text: str


@dataclass(slots=True)
class Situation:
    """What the rules look at. Ages in s, None before the first.

    Attributes
    ----------
    state : mapping or None
        The supervisor's state as the page gets it.
    state_age_s, tick_age_s : float or None
    sample_age_s : mapping of str to float
        Age of the last finite sample by sensor.
    sensor_reasons : mapping of str to str
        What the supervisor says of each sensor, ``good`` if nothing is wrong.
    depth_error_mm, temperature_c : float
        NaN where unknown.
    parts : mapping of str to Part
    """

    state: Mapping[str, Any] | None = None
    state_age_s: float | None = None
    tick_age_s: float | None = None
    sample_age_s: Mapping[str, float] = field(default_factory=dict)
    sensor_reasons: Mapping[str, str] = field(default_factory=dict)
    depth_error_mm: float = float("nan")
    temperature_c: float = float("nan")
    parts: Mapping[str, Part] = field(default_factory=dict)


class AlarmRules:
    """Says which alarms are present; knows what must last for a while.

    Parameters
    ----------
    quality_persistence_s : callable
        How long a value must be outside its quality limits, and inside again.
    """

    def __init__(self, quality_persistence_s: Callable[[], float]) -> None:
        self._quality_persistence_s = quality_persistence_s
        self._outside: dict[str, _Lasting] = {name: _Lasting() for name in ("quality_depth", "quality_temperature")}
        self._not_ready: dict[str, _Lasting] = {}
        self._no_supervisor = _Lasting()

    def present(self, now: Situation, now_s: float) -> dict[str, Alarm]:
        """The alarms that are present by name; ``now_s`` on a steady clock."""
        found: dict[str, Alarm] = {}
        self._measurements(now, found)
        self._supervisor(now, now_s, found)
        self._quality(now, now_s, found)
        self._parts(now, found)
        return found

    def _parts(self, now: Situation, found: dict[str, Alarm]) -> None:
        """Errors of parts, and nodes of which no part reports any longer."""
        reporting: dict[str, bool] = {}
        for name, part in now.parts.items():
            node, _, what = name.partition(": ")
            reporting[node] = reporting.get(node, False) or part.level != "stale"
            if part.level == "error" and not what.startswith(_OTHER_RULES):
                found[f"part:{name}"] = _alarm("part_error", name=name, why=part.text)
        for node, reports in reporting.items():
            if not reports:
                found[f"node:{node}"] = _alarm("node_silent", name=node)

    def _measurements(self, now: Situation, found: dict[str, Alarm]) -> None:
        if now.tick_age_s is None:
            return
        if now.tick_age_s > _NO_TICK_S:
            found["measurements"] = _alarm("measurements", why="nothing comes from the plant")
            return
        for name in SENSORS:
            why = now.sensor_reasons.get(name, "good")
            if name in now.sample_age_s and now.sample_age_s[name] > _NO_SAMPLE_S and why == "good":
                why = "no samples"
            if why != "good":
                found[f"sensor:{name}"] = _alarm("sensor", name=name, why=why)

    def _supervisor(self, now: Situation, now_s: float, found: dict[str, Alarm]) -> None:
        state, age_s = now.state, now.state_age_s
        never = self._no_supervisor.update(age_s is None and now.tick_age_s is not None, NO_REPORT_S, 0.0, now_s)
        if never or (age_s is not None and age_s > NO_REPORT_S):
            found["supervisor"] = _alarm("supervisor")
        if state is None or "supervisor" in found:
            return
        for interlock in state["interlocks"]:
            name, _, level = interlock.partition(":")
            priority, word = _LEVELS.get(level, ("medium", level))
            text, advice = _INTERLOCKS.get(name, (name, "See the supervisor's log"))
            found[f"interlock:{name}"] = Alarm(f"{text}: {word}", advice, priority)
        mode, target_mode = state["actual_mode"], state["target_mode"]
        actual, target = state["actual_controller"], state["target_controller"]
        if mode == "safe_stop":
            found["safe_stop"] = _alarm("safe_stop", why=state["reason"])
        elif mode == "hold" and target_mode != "hold" and state["requested_by"] != "start":
            found["hold"] = _alarm("hold", why=state["reason"])
        elif mode == "auto" and actual and target and actual != target:
            found["failover"] = _alarm("failover", actual=actual, target=target, why=state["reason"])
        for one in state["controllers"]:
            self._controller(one, now_s, found)

    def _controller(self, one: Mapping[str, Any], now_s: float, found: dict[str, Alarm]) -> None:
        name = one["name"]
        lasting = self._not_ready.setdefault(name, _Lasting()).update(not one["ready"], _NOT_READY_S, 0.0, now_s)
        why = one["reason"] or "it has not proposed enough"
        if one["inhibited"]:
            found[f"controller:{name}"] = _alarm("inhibited", name=name, why=why)
        elif lasting:
            found[f"controller:{name}"] = _alarm("not_ready", name=name, why=why)

    def _quality(self, now: Situation, now_s: float, found: dict[str, Alarm]) -> None:
        values = {
            "quality_depth": (now.depth_error_mm, QUALITY_DEPTH_MM, _BACK_MM),
            "quality_temperature": (now.temperature_c, QUALITY_TEMPERATURE_C, _BACK_C),
        }
        persistence_s = self._quality_persistence_s()
        for name, (value, (low, high), back) in values.items():
            lasting = self._outside[name]
            margin = back if lasting.on else 0.0
            outside = isfinite(value) and not low + margin <= value <= high - margin
            if lasting.update(outside, persistence_s, persistence_s, now_s):
                found[name] = _alarm(name)


@dataclass(slots=True)
class _Lasting:
    """Becomes on or off only when that has lasted."""

    on: bool = False
    since_s: float | None = None

    def update(self, wanted: bool, on_s: float, off_s: float, now_s: float) -> bool:
        if wanted == self.on:
            self.since_s = None
        elif self.since_s is None:
            self.since_s = now_s
        if self.since_s is not None and now_s - self.since_s >= (on_s if wanted else off_s):
            self.on, self.since_s = wanted, None
        return self.on
