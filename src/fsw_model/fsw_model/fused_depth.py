"""The depth of a machine with several sensors of it, as all nodes take it from fsw/depth."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from math import nan

from fsw_control.contract import Command
from fsw_control.depth_channels import CHANNELS, DepthFusionSettings
from fsw_control.depth_footprint import Footprint
from fsw_control.depth_fusion import DepthEstimate, DepthFusion
from fsw_control.sensors import DEPTH_CHANNELS
from fsw_model import nominal
from fsw_model.equations import friction_torque_nm, power_kw, process_torque_nm


class FusedDepth:
    """Fuses the samples of the depth's channels with force, torque and power that are measured.

    Parameters
    ----------
    footprint : Footprint or None
        Of an earlier weld.
    touch_off_kn : float
        Axial force at the touch-off.
    sensors : collection of str
        Those that the machine has, of ``DEPTH_CHANNELS``.
    """

    def __init__(
        self,
        footprint: Footprint | None,
        touch_off_kn: float,
        sensors: Collection[str] = tuple(DEPTH_CHANNELS),
    ) -> None:
        settings = DepthFusionSettings(calibration_force_kn=touch_off_kn)
        names = [DEPTH_CHANNELS[sensor] for sensor in sensors]
        channels = {name: row for name, row in CHANNELS.items() if name in names}
        self._fusion = DepthFusion(settings, channels, _torque_nm, footprint)

    def reset(self) -> None:
        """Forget the past: the sensors have touched off."""
        self._fusion.reset()

    def update(
        self,
        time_s: float,
        values: Mapping[str, float],
        drives: Command,
        angle_deg: float = nan,
        travel_mm: float = nan,
    ) -> DepthEstimate:
        """Fuse the samples of a tick, by sensor."""
        torque_nm, speed_rpm = values.get("torque", nan), drives.speed_rpm
        return self._fusion.update(
            time_s,
            {channel: values.get(name) for name, channel in DEPTH_CHANNELS.items()},
            drives.force_kn,
            torque_nm,
            power_kw(torque_nm - _friction_nm(speed_rpm), speed_rpm),
            speed_rpm,
            angle_deg,
            travel_mm,
        )


def _friction_nm(speed_rpm: float) -> float:
    friction_nm: float = friction_torque_nm(nominal(), speed_rpm)  # type: ignore[arg-type, assignment]
    return friction_nm


def _torque_nm(force_kn: float, depth_mm: float, speed_rpm: float) -> float:
    """Torque of process and motor by the nominal model, not the plant's."""
    process_nm: float = process_torque_nm(nominal(), force_kn, depth_mm)  # type: ignore[arg-type, assignment]
    return process_nm + _friction_nm(speed_rpm)
