"""The depth of a plant with several sensors of it, as all nodes take it from fsw/depth."""

from __future__ import annotations

from collections.abc import Mapping

from fsw_control.contract import Command
from fsw_control.depth_fusion import DepthEstimate, DepthFusion
from fsw_control.sensors import DEPTH_CHANNELS
from fsw_control.units import KW_PER_NM_RPM


def fuse(
    fusion: DepthFusion, time_s: float, values: Mapping[str, float], drives: Command
) -> DepthEstimate:
    """Fuse the samples of a tick, by sensor, with force, torque and power that act."""
    torque_nm = values.get("torque", float("nan"))
    return fusion.update(
        time_s,
        {channel: values.get(name) for name, channel in DEPTH_CHANNELS.items()},
        drives.force_kn,
        torque_nm,
        torque_nm * drives.speed_rpm * KW_PER_NM_RPM,
        drives.speed_rpm,
    )
