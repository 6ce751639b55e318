"""Depth of the shoulder from several channels: fused value, its deviation, health of each channel.

What the channels are is in :mod:`fsw_control.depth_channels`. All channels share the zero of their
touch-off, and the machine's deflection and growth as far as no channel is free of them: that part
cannot be observed. It has only its prior, and stays in the deviation.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fsw_control.depth_channels import CHANNELS, ChannelHealth, DepthChannel, DepthFusionSettings


@dataclass(frozen=True, slots=True)
class DepthEstimate:
    """The depth at a tick, and what it rests on."""

    depth_mm: float  #: NaN if no channel has been usable for ``hold_s``
    deviation_mm: float  #: standard deviation, with what all channels share; NaN as the depth
    health: Mapping[str, ChannelHealth]  #: by channel
    used: tuple[str, ...]  #: channels that the depth of this tick rests on


class DepthFusion:
    """Fuses the depth channels of a weld, tick by tick.

    Parameters
    ----------
    settings : DepthFusionSettings, optional
    channels : mapping, optional
        The channels that exist, by name; one is enough.
    """

    def __init__(
        self,
        settings: DepthFusionSettings | None = None,
        channels: Mapping[str, DepthChannel] = CHANNELS,
    ) -> None:
        self.settings = settings or DepthFusionSettings()
        self.channels = dict(channels)
        self.reset()

    def reset(self) -> None:
        """Forget the past, as after a touch-off."""
        self._depth_mm, self._variance, self._last_s = math.nan, math.nan, -math.inf

    def update(
        self,
        time_s: float,
        channels_mm: Mapping[str, float | None],
        force_kn: float = math.nan,
        torque_nm: float = math.nan,
        power_kw: float = math.nan,
        speed_rpm: float = math.nan,
    ) -> DepthEstimate:
        """Fuse the samples of a tick.

        Parameters
        ----------
        time_s : float
        channels_mm : mapping
            Sample by channel; a missing name, None and NaN are a missing sample.
        force_kn, torque_nm, power_kw, speed_rpm : float
            As drives and torque sensor report them; NaN if unknown.
        """
        values, weights, health = [], [], {}
        for name, channel in self.channels.items():
            value = channels_mm.get(name)
            if value is None or not math.isfinite(value):
                health[name] = ChannelHealth.MISSING
            elif not channel.minimum_mm <= value <= channel.maximum_mm:
                health[name] = ChannelHealth.OUT_OF_RANGE
            else:
                health[name] = ChannelHealth.GOOD
                values.append(value - channel.shown(force_kn - self.settings.calibration_force_kn))
                weights.append(1.0 / channel.noise_mm**2)
        if values:
            self._depth_mm = float(np.average(values, weights=weights))
            self._variance, self._last_s = 1.0 / sum(weights), time_s
        elif not time_s - self._last_s <= self.settings.hold_s:
            self._depth_mm = self._variance = math.nan
        used = tuple(name for name in self.channels if health[name] is ChannelHealth.GOOD)
        return DepthEstimate(self._depth_mm, math.sqrt(self._variance), health, used)
