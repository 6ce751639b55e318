"""Depth channels: share of deflection and growth in each, its uncertainty, and its health.

All figures are chosen, except where a source is named.
"""

from __future__ import annotations

from typing import Annotated

from fsw_control import weld
from fsw_control.coded import Coded
from fsw_control.schema.models import Model, Whole
from fsw_control.schema.ranges import Range
from fsw_control.sensors import SENSORS, SURFACE_MM

_LENGTH = Range(0.0, 5.0, "mm")


class ChannelHealth(Coded):
    """Health of a depth channel; a number on the wire."""

    GOOD = 0, "good"
    MISSING = 1, "no sample"
    OUT_OF_RANGE = 2, "out of range"
    SPIKE = 3, "spike"
    STUCK = 4, "stuck"
    SLIP = 5, "slipped"
    DRIFT = 6, "drifts from the others"
    DUST = 7, "noisy or interrupted"
    SUSPECT = 8, "disagrees with another channel, unknown which is wrong"
    STEPPED = 9, "moved from the others: watched until it is clear why"
    UNKNOWN = 255, "unknown"


class DepthChannel(Model):
    """A depth channel as the estimator sees it.

    Its sample is depth + ``deflection_mm_per_kn`` * (force - force of the calibration) +
    ``growth_share`` * growth + bias + noise.
    """

    minimum_mm: Annotated[float, Range(-10.0, 20.0, "mm")] = SURFACE_MM
    """Minimum plausible sample."""
    maximum_mm: Annotated[float, Range(-10.0, 20.0, "mm")] = SENSORS["depth"].maximum
    """Maximum plausible sample."""
    noise_mm: Annotated[float, Range(1e-5, 1.0, "mm")] = 0.01
    """Standard deviation of the noise."""
    deflection_mm_per_kn: Annotated[float, Range(-0.2, 0.2, "mm/kN")] = 0.0
    """Deflection of the machine that the channel shows as depth."""
    deflection_deviation_mm_per_kn: Annotated[float, Range(0.0, 0.2, "mm/kN")] = 0.0
    """Standard deviation of that."""
    growth_share: Annotated[float, Range(-2.0, 2.0, "")] = 0.0
    """Share of the thermal growth that the channel shows as depth; negative, if it hides it."""
    rides: bool = True
    """Whether it rides on the surface, and so meets its edges; else it shows the machine's
    position."""
    lead_mm: Annotated[float, Range(-500.0, 500.0, "mm")] = 0.0
    """How far ahead of the tool it rides; negative: behind it."""
    bias_mm: Annotated[float, Range(-5.0, 5.0, "mm")] = 0.0
    """Bias, as known from touch-off and footprint."""
    bias_deviation_mm: Annotated[float, _LENGTH] = 0.02
    """Standard deviation of the bias after touch-off."""
    wander_mm: Annotated[float, _LENGTH] = 0.005
    """Standard deviation of the change of the bias within ``wander_s``."""
    wander_s: Annotated[float, Range(1.0, 10_000.0, "s")] = 300.0
    """Time of that change."""

    def shown(self, force_kn: float) -> float:
        """Offset of the channel by deflection, at a force beyond the calibration's."""
        pushed = force_kn if force_kn == force_kn else 0.0
        return self.bias_mm + self.deflection_mm_per_kn * pushed


class DepthFusionSettings(Model):
    """Parameters of the depth estimator."""

    calibration_force_kn: Annotated[float, Range(0.0, 200.0, "kN")] = weld.FORCE_KN
    """Force at which the channels agree with the depth: that of their calibration."""
    rate_mm_per_s: Annotated[float, Range(1e-4, 1.0, "mm/s")] = 0.02
    """Standard deviation of the rate of the depth."""
    rate_s: Annotated[float, Range(0.1, 60.0, "s")] = 1.0
    """Time constant of that rate."""
    growth_mm_per_kw: Annotated[float, Range(-0.1, 0.1, "mm/kW")] = 0.0
    """Thermal growth since the calibration per power that has soaked in since then."""
    growth_deviation_mm_per_kw: Annotated[float, Range(0.0, 0.1, "mm/kW")] = 0.005
    """Standard deviation of that."""
    growth_s: Annotated[float, Range(1.0, 10_000.0, "s")] = 900.0
    """Time constant with which power soaks in."""
    calibration_power_kw: Annotated[float, Range(0.0, 200.0, "kW")] = 0.0
    """Power that had soaked in at the calibration."""
    shared_deviation_mm: Annotated[float, _LENGTH] = 0.02
    """Standard deviation of the error common to all channels: the zero of their touch-off. Only a
    footprint reveals it."""
    shared_deflection_mm_per_kn: Annotated[float, Range(0.0, 0.2, "mm/kN")] = 0.002
    """Standard deviation of the deflection that no channel shows: of tool and holder."""
    repeat_mm: Annotated[float, _LENGTH] = 0.01
    """Standard deviation of the change of a bias from a weld to the next, for a footprint."""
    witness_deviation_mm: Annotated[float, Range(0.001, 1.0, "mm")] = 0.05
    """Standard deviation of changes of the depth as the torque shows them within seconds; the
    copper's hardness is in it."""
    hardness_s: Annotated[float, Range(1.0, 600.0, "s")] = 30.0
    """Time over which the torque's level follows the copper's hardness."""
    hold_s: Annotated[float, Range(0.0, 60.0, "s")] = 0.3
    """Time for which the depth is held without a usable channel."""
    confirm_samples: Annotated[Whole, Range(1, 100, "")] = 5
    """Samples in a row that must disagree before a channel counts as slipped."""
    stuck_samples: Annotated[Whole, Range(0, 1000, "")] = 10
    """Minimum number of equal samples in a row before a channel counts as stuck; 0: never."""
    readmit_s: Annotated[float, Range(0.0, 600.0, "s")] = 10.0
    """Time for which a channel that slipped must be back before it is used again; one that drifts
    stays out."""


#: begin of the name of a channel's row in the table of sensors
SENSOR = "depth_"
#: an LVDT is noisier here than in ``SENSORS``: its run-out, aliased, is noise to the fusion
_LVDT_NOISE_MM = 0.008
#: the four channels of Posiva SKB Report 08 (2018); their figures are chosen
CHANNELS = {
    "laser": DepthChannel(
        noise_mm=SENSORS[f"{SENSOR}laser"].noise,
        growth_share=-0.1,
        bias_deviation_mm=0.04,
        lead_mm=45.0,
    ),
    "lvdt_lead": DepthChannel(noise_mm=_LVDT_NOISE_MM, growth_share=-0.1, lead_mm=60.0),
    "lvdt_trail": DepthChannel(noise_mm=_LVDT_NOISE_MM, growth_share=-0.1, lead_mm=-60.0),
    "axial": DepthChannel(
        noise_mm=SENSORS[f"{SENSOR}axial"].noise,
        deflection_mm_per_kn=0.03,
        deflection_deviation_mm_per_kn=0.01,
        growth_share=-1.0,
        rides=False,
    ),
}
