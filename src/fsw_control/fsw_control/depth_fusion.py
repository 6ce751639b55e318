"""Depth of the shoulder from several channels: fused value, its deviation, health of each channel.

The channels are described in :mod:`fsw_control.depth_channels`, the filters are in ``depth_bank``,
the tests in ``depth_tests``. An error common to all channels, such as the zero of their touch-off,
cannot be observed; it is in the deviation only.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import compress

import numpy as np

from fsw_control.depth_bank import DEPTH, Array, DepthBank
from fsw_control.depth_channels import CHANNELS, ChannelHealth, DepthChannel, DepthFusionSettings
from fsw_control.depth_edges import SurfaceEdges
from fsw_control.depth_footprint import Footprint
from fsw_control.depth_tests import DISAGREE, ChannelTests, Mask

#: torque of process and motor at a force [kN], a depth [mm] and a speed [rpm]
TorqueModel = Callable[[float, float, float], float]
#: step of the torque model's slope [mm]
_SLOPE_MM = 0.01


@dataclass(frozen=True, slots=True)
class DepthEstimate:
    """The depth at a tick, and the channels behind it."""

    depth_mm: float  #: NaN if no channel has been usable for ``hold_s``
    deviation_mm: float  #: standard deviation, with what all channels share; NaN as the depth
    health: Mapping[str, ChannelHealth]  #: by channel
    used: tuple[str, ...]  #: channels that the depth of this tick rests on
    footprint_mm: float = 0.0  #: taken off the depth, by the footprint of an earlier weld


class DepthFusion:
    """Fuses the depth channels of a weld, tick by tick.

    Parameters
    ----------
    settings : DepthFusionSettings, optional
    channels : mapping, optional
        The channels that exist, by name; one is enough.
    torque_model : callable, optional
        Torque at a force, a depth and a speed. Its changes decide if channels have no majority;
        without it the channel that jumped is wrong.
    footprint : Footprint, optional
        Of an earlier weld: its bias of the fused depth is one more measurement of this one's.
    """

    def __init__(
        self,
        settings: DepthFusionSettings | None = None,
        channels: Mapping[str, DepthChannel] = CHANNELS,
        torque_model: TorqueModel | None = None,
        footprint: Footprint | None = None,
    ) -> None:
        self.settings = settings or DepthFusionSettings()
        self.channels, self._footprint = dict(channels), footprint
        self._torque_model = torque_model
        self.reset()

    def reset(self) -> None:
        """Forget the past."""
        self._bank = DepthBank(self.settings, self.channels)
        self._edges = SurfaceEdges(self.channels)
        self._tests = ChannelTests(self.settings, self.channels, self._edges)
        self._time_s = self._used_s = -math.inf
        self._hardness = math.nan
        self._estimate: DepthEstimate | None = None

    def update(
        self,
        time_s: float,
        channels_mm: Mapping[str, float | None],
        force_kn: float = math.nan,
        torque_nm: float = math.nan,
        power_kw: float = math.nan,
        speed_rpm: float = math.nan,
        angle_deg: float = math.nan,
        travel_mm: float = math.nan,
    ) -> DepthEstimate:
        """Fuse the samples of a tick; a tick that is not later than the last changes nothing.

        Parameters
        ----------
        time_s : float
        channels_mm : mapping
            Sample by channel; a missing name, None and NaN are a missing sample.
        force_kn, torque_nm, power_kw, speed_rpm : float
            As drives and torque sensor report them; NaN if unknown.
        angle_deg : float
            Angle of the tool, for the footprint; NaN if unknown.
        travel_mm : float
            Distance that the tool has travelled, for edges of the surface; NaN if unknown.
        """
        if self._estimate is not None and time_s <= self._time_s:
            return self._estimate
        known = math.isfinite(force_kn)
        pushed = force_kn - self.settings.calibration_force_kn if known else 0.0
        raw = [_number(channels_mm.get(name)) for name in self.channels]
        values, health = self._tests.screen(raw)
        values -= [row.shown(pushed) for row in self.channels.values()]
        bank = self._bank
        if math.isinf(self._used_s):
            present = sorted(value for value in values if value == value)
            if not present:
                return self._result(time_s, (), health, math.nan, 0.0)
            bank.start(float(present[len(present) // 2]))
        else:
            bank.predict(time_s - self._time_s, power_kw)
        bank.innovate(values, pushed)
        self._edges.move(travel_mm)
        if self._tests.meet_edges(bank, values, health):
            bank.innovate(values, pushed)
        witness = self._witness(force_kn, torque_nm, speed_rpm)
        judgement = self._tests.judge(bank, values, health, witness)
        if judgement.isolated:
            self._isolate(judgement.isolated, values, pushed, judgement.used)
        if judgement.common > DISAGREE:
            bank.loosen(judgement.common_mm**2)
        bank.correct(judgement.used)
        if judgement.used.any():
            self._used_s = time_s
        names = tuple(compress(self.channels, judgement.used))
        variance = float(bank.p[0, DEPTH, DEPTH])
        variance += self.settings.shared_deviation_mm**2
        variance += (self.settings.shared_deflection_mm_per_kn * pushed) ** 2
        footprint_mm, variance = self._by_footprint(variance, angle_deg)
        deviation = math.sqrt(max(variance + judgement.spread_mm**2, 0.0))
        return self._result(time_s, names, judgement.health, deviation, footprint_mm)

    def _by_footprint(self, variance: float, angle_deg: float) -> tuple[float, float]:
        """Correction of the depth by the footprint, and the variance of the result.

        It measured the bias of an earlier weld, with its own error; this weld's differs by what
        does not repeat. So it corrects the output like a sample; the filters cannot observe it.
        """
        if self._footprint is None:
            return 0.0, variance
        bias_mm, deviation_mm = self._footprint.bias_mm("depth", angle_deg)
        if math.isinf(deviation_mm):
            return 0.0, variance
        error = deviation_mm**2 + self.settings.repeat_mm**2
        gain = variance / (variance + error)
        return gain * bias_mm, gain * error

    def _isolate(
        self, channels: tuple[int, ...], values_mm: Array, pushed_kn: float, used: Mask
    ) -> None:
        """Continue with filters that faulty channels have not touched."""
        bank = self._bank
        if len(channels) > max(1, bank.most_left_out):  # every filter has used one of them
            known_mm = values_mm[used]
            bank.start(float(np.median(known_mm) if len(known_mm) else bank.x[0, DEPTH]))
            self._tests.restart()
            bank.innovate(values_mm, pushed_kn)
            return
        for channel in channels:
            self._tests.trust(channel, bank)
            bank.trust(channel)
            bank.innovate(values_mm, pushed_kn)

    def _result(
        self,
        time_s: float,
        used: tuple[str, ...],
        health: list[ChannelHealth],
        deviation: float,
        footprint_mm: float,
    ) -> DepthEstimate:
        blind = not time_s - self._used_s <= self.settings.hold_s + 1e-9
        self._time_s = time_s
        self._estimate = DepthEstimate(
            math.nan if blind else float(self._bank.x[0, DEPTH]) - footprint_mm,
            math.nan if blind else deviation,
            dict(zip(self.channels, health, strict=True)),
            used,
            footprint_mm,
        )
        return self._estimate

    def _witness(self, force_kn: float, torque_nm: float, speed_rpm: float) -> tuple[float, float]:
        """Change of the depth against its prediction according to the torque, and its variance.

        Only changes within seconds count: the torque's level follows the copper's hardness.
        """
        variance = self.settings.witness_deviation_mm**2
        if self._torque_model is None or not math.isfinite(force_kn + torque_nm + speed_rpm):
            return 0.0, variance
        depth = float(self._bank.x[0, DEPTH])
        expected = self._torque_model(force_kn, depth, speed_rpm)
        slope = (self._torque_model(force_kn, depth + _SLOPE_MM, speed_rpm) - expected) / _SLOPE_MM
        ratio = torque_nm / expected
        if ratio <= 0.0:  # a dead sensor
            return 0.0, variance
        if math.isnan(self._hardness):
            self._hardness = ratio
        gained = (torque_nm - self._hardness * expected) / (self._hardness * slope)
        self._hardness += (ratio - self._hardness) * min(1.0, 0.1 / self.settings.hardness_s)
        return gained, variance


def _number(value: float | None) -> float:
    return math.nan if value is None or not math.isfinite(value) else value
