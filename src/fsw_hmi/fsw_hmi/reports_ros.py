"""What the page shows of the graph's own reports: states and predictions as frames."""

from __future__ import annotations

from math import degrees
from typing import Any

from fsw_control import messages_ros as convert
from fsw_control import units
from fsw_control.units import NANOSECONDS
from fsw_hmi.frames import readable, short
from fsw_msgs.msg import ControllerHealth, Prediction, SupervisorState, WeldProgress

_WORDS = ("target_controller", "actual_controller", "target_mode", "actual_mode", "reason", "requested_by")
MOST_CONTROLLERS = 20
#: before the supervisor has reported
NO_STATE: dict[str, Any] = {
    **dict.fromkeys(_WORDS, ""),
    **{"controllers": [], "interlocks": [], "acknowledged": False},
}


def state(message: SupervisorState) -> dict[str, Any]:
    """The supervisor's state; of more controllers or interlocks than can be, the first."""
    return {
        **{name: readable(getattr(message, name)) for name in _WORDS},
        "controllers": [_controller(one) for one in message.controllers[:MOST_CONTROLLERS]],
        "interlocks": [readable(one) for one in message.interlocks[:MOST_CONTROLLERS]],
        "acknowledged": bool(message.acknowledged),
    }


def _controller(one: ControllerHealth) -> dict[str, Any]:
    return {
        "name": readable(one.name, 100),
        "ready": bool(one.warm) and not one.reason,
        "healthy": bool(one.healthy),
        "inhibited": bool(one.latched_out),
        "reason": readable(one.reason),
        "latency_ms": short(1e3 * one.latency_mean),
        "latency_max_ms": short(1e3 * one.latency_max),
        "missed": one.missed,
        "late": one.late,
        "rejected": one.rejected,
    }


def progress(message: WeldProgress) -> dict[str, Any]:
    """How far the programme has come."""
    return {
        "state": readable(message.state),
        "phase": readable(message.phase),
        "angle_deg": short(degrees(message.angle)),
        "length_mm": short(units.mm_from_m(message.length)),
        "time_left_s": short(message.time_left),
        "depth_mm": short(units.mm_from_m(message.depth)),
        "temperature_c": short(message.temperature),
        "left": bool(message.left),
        "way_back_s": short(message.way_back),
    }


def prediction(controller: str, message: Prediction) -> dict[str, Any]:
    """A controller's plan, at times of the weld."""
    begin_s = convert.stamp_ns(message.header.stamp) / NANOSECONDS
    return {
        "controller": controller,
        "time_s": [round(begin_s + one, 3) for one in message.time],
        "depth_mm": [short(units.mm_from_m(one)) for one in message.depth],
        "temperature_c": [short(one) for one in message.temperature],
        "force_kn": [short(units.kn_from_n(one)) for one in message.axial_force],
        "speed_rpm": [short(units.rpm_from_rad_s(one)) for one in message.spindle_speed],
        "depth_mm:deviation": [short(units.mm_from_m(one)) for one in message.depth_deviation],
        "temperature_c:deviation": [short(one) for one in message.temperature_deviation],
    }
