"""The machine and its copper: deflection, growth, hardness, and where the depth is measured."""

from __future__ import annotations

from math import pi
from typing import TYPE_CHECKING, Annotated, Literal, NamedTuple

import numpy as np

from fsw_control import weld
from fsw_control.schema.models import Model
from fsw_control.schema.ranges import Range
from fsw_control.sensors import DEPTH_CHANNELS

if TYPE_CHECKING:
    DepthSensor = str
else:  # so that the schema has the names
    DepthSensor = Literal["ideal", *DEPTH_CHANNELS]
#: stream of the random numbers of the hardness; the sensors have the first ones
_HARDNESS_STREAM = 1000


class Machine(Model):
    """Parameters ``machine.*``; by default the machine is rigid and the copper even."""

    depth_channels: bool = False
    """Whether the machine has several sensors of the depth, from which fsw/depth is fused."""
    depth_sensor: DepthSensor = "ideal"
    """Without depth_channels: the channel behind fsw/depth, with that channel's errors."""
    footprint_file: str = ""
    """JSON file of fsw.py footprint, of an earlier weld on the machine: its bias of the depth is
    taken off; empty: none."""
    compliance_mm_per_kn: Annotated[float, Range(0.0, 0.2, "mm/kN")] = 0.0
    """Deflection of the machine by the axial force; the axial position shows it as depth."""
    touch_off_kn: Annotated[float, Range(0.0, 200.0, "kN")] = weld.FORCE_KN
    """Axial force at which the touch-off has removed the deflection from the shown depth."""
    tool_growth_mm_per_kw: Annotated[float, Range(0.0, 0.1, "mm/kW")] = 0.0
    """Thermal growth of tool and spindle in steady state, since the touch-off; the tool is deeper
    than it is shown."""
    tool_growth_s: Annotated[float, Range(1.0, 100_000.0, "s")] = 600.0
    """Time constant of that growth, first order (chosen)."""
    canister_growth_mm_per_kw: Annotated[float, Range(0.0, 0.1, "mm/kW")] = 0.0
    """Thermal growth of the canister towards the machine in steady state."""
    canister_growth_s: Annotated[float, Range(1.0, 100_000.0, "s")] = 1500.0
    """Time constant of that growth, first order (chosen)."""
    hardness: Annotated[float, Range(0.5, 2.0, "")] = 1.0
    """Hardness of this canister's copper, as a factor on all stresses: force and torque that the
    same depth needs are proportional to it."""
    hardness_variation: Annotated[float, Range(0.0, 0.2, "")] = 0.0
    """Standard deviation of the hardness along the circumference, as a share; the seed decides
    where the copper is hard."""
    hardness_length_mm: Annotated[float, Range(1.0, 2000.0, "mm")] = 200.0
    """Length along the circumference within which the hardness is similar (chosen)."""
    runout_mm: Annotated[float, Range(0.0, 1.0, "mm")] = 0.0
    """Amplitude of the head's movement once per turn of the spindle, aliased by the tick."""
    swelling_mm_per_mm: Annotated[float, Range(0.0, 5.0, "")] = 0.0
    """Height of flash and swollen copper beside the shoulder per depth beyond swelling_from_mm."""
    swelling_from_mm: Annotated[float, Range(0.0, 10.0, "mm")] = 2.4
    """Depth at which copper begins to swell (chosen)."""
    edge_mm: Annotated[float, Range(-2.0, 2.0, "mm")] = 0.0
    """Height of an edge of the surface across the path of the tool."""
    edge_at_mm: Annotated[float, Range(0.0, 10_000.0, "mm")] = 100.0
    """Where on the path the edge is."""


class Mount(NamedTuple):
    """Share of deflection and growth in a sensor: ``fsw_plant_mount`` in C; all chosen.

    The axial position is that of the machine: deflection, growth and edge lie between it and the
    surface. Laser and LVDTs ride beside the shoulder and miss only the growth of the tool below
    them.
    """

    deflection: float = 0.0
    tool: float = 0.0
    canister: float = 0.0
    swelling: float = 0.0
    runout: float = 0.0
    edge_here: float = 0.0
    edge_ahead: float = 0.0
    lead_mm: float = 0.0


def _rider(swelling: float, runout: float, lead_mm: float) -> Mount:
    return Mount(0.0, -0.1, 0.0, swelling, runout, -1.0, 1.0, lead_mm)


MOUNTS = {
    "ideal": Mount(),
    "depth_laser": _rider(1.0, 0.5, 45.0),
    "depth_lvdt_lead": _rider(0.0, 1.0, 60.0),
    "depth_lvdt_trail": _rider(0.3, -1.0, -60.0),
    "depth_axial": Mount(deflection=1.0, tool=-1.0, canister=-1.0, edge_here=-1.0),
}


def hardness_waves(
    machine: Machine, seed: int, circumference_mm: float, harmonics: int
) -> tuple[list[float], list[float]]:
    """Amplitudes and phases of the hardness along the circumference, by harmonic.

    The amplitudes fall beyond the length within which the hardness is similar as those of a
    first-order Gauss-Markov process.
    """
    harmonic = np.arange(1, harmonics + 1)
    wave = 1.0 / np.hypot(1.0, 2.0 * pi * harmonic * machine.hardness_length_mm / circumference_mm)
    wave *= machine.hardness_variation / np.sqrt(0.5 * np.sum(wave**2))
    draws = np.random.Generator(np.random.PCG64([seed, _HARDNESS_STREAM]))
    return wave.tolist(), draws.uniform(0.0, 2.0 * pi, harmonics).tolist()
