"""Parameters of the canister's end: geometry, copper, heat in and out, discretisation.

``fsw_heat`` makes the heat model from them, which the plant steps (``process.py``).
"""

from __future__ import annotations

from math import hypot
from typing import Annotated, Any, Literal

from pydantic import model_validator

from fsw_control.schema.models import InputError, Parameters, Whole
from fsw_control.schema.ranges import Range

ZERO_C = 273.15
STEFAN_BOLTZMANN = 5.670374e-8


class CanisterParameters(Parameters):
    """The canister's end and its heat in and out; values without a named source are chosen."""

    what = "canister parameters"
    example = "wall_mm: 49.0"

    shape: Literal["cylinder", "plate"] = "cylinder"
    """A cylinder with a lid, or unrolled to a plate without one, of the same circumference, for
    comparison with closed-form solutions."""
    outer_radius_mm: Annotated[float, Range(50.0, 5000.0, "mm")] = 525.0
    """Outer radius of the tube: a canister of about 1.05 m; one turn at 86 mm/min takes 38 min."""
    wall_mm: Annotated[float, Range(5.0, 500.0, "mm")] = 50.0
    """Thickness of the wall and of the lid's rim; paper."""
    rim_mm: Annotated[float, Range(20.0, 2000.0, "mm")] = 135.0
    """Height of the rim above the joint line, an adiabatic edge 60 mm above the start line."""
    lid_mm: Annotated[float, Range(0.0, 500.0, "mm")] = 50.0
    """Thickness of the lid's plate; 0 for none."""
    lid_from_mm: Annotated[float, Range(-500.0, 500.0, "mm")] = 35.0
    """Lower face of the lid's plate above the joint line; the shoulder just passes below it."""
    tube_mm: Annotated[float, Range(100.0, 10000.0, "mm")] = 2000.0
    """Length of the modelled tube below the joint line, with an adiabatic end."""
    probe_radius_mm: Annotated[float, Range(1.0, 100.0, "mm")] = 15.0
    """Radius of the probe's uniform heat source, at whose rim the stir zone's temperature is
    taken: the contact at zero depth, paper (21)."""
    probe_length_mm: Annotated[float, Range(1.0, 500.0, "mm")] = 50.0
    """Length of the probe, from the outer surface inwards; paper."""
    shoulder_radius_mm: Annotated[float, Range(2.0, 200.0, "mm")] = 35.0
    """Radius of the shoulder; paper. Its heat is proportional to r outside the probe's radius."""
    shoulder_share: Annotated[float, Range(0.0, 1.0, "")] = 0.77
    """Share of the shoulder in the copper's heat: of G at the operating point, paper (22)."""
    tool_share: Annotated[float, Range(0.0, 0.9, "")] = 0.05
    """Share of the power that flows into tool and machine."""
    conductivity_w_per_m_k: Annotated[float, Range(1.0, 2000.0, "W/(m K)")] = 382.6
    """Conductivity k of copper at the reference temperature; default: Incropera, Table A.1."""
    heat_capacity_j_per_kg_k: Annotated[float, Range(10.0, 5000.0, "J/(kg K)")] = 411.8
    """Specific heat c of copper at the reference temperature; default: Incropera, Table A.1."""
    density_kg_per_m3: Annotated[float, Range(100.0, 30000.0, "kg/m3")] = 8933.0
    """Density of copper in the cold canister, as the geometry is cold; Incropera, Table A.1."""
    properties: Literal["constant", "kirchhoff"] = "kirchhoff"
    """Whether k is constant, or varies as in Table A.1 while k/c is constant."""
    reference_c: Annotated[float, Range(0.0, 1000.0, "degC")] = 275.0
    """Temperature of k and c; with the default the linear model errs by 2 to 3 % of the rise."""
    convection_w_per_m2_k: Annotated[float, Range(0.0, 1000.0, "W/(m2 K)")] = 10.0
    """Convection to air at the outer surface, the rim and the lid's top."""
    emissivity: Annotated[float, Range(0.0, 1.0, "")] = 0.3
    """Emissivity of the same surfaces, between polished and oxidised copper."""
    radiation_c: Annotated[float, Range(0.0, 1000.0, "degC")] = 200.0
    """Surface temperature at which radiation is linearised."""
    clamp_w_per_m2_k: Annotated[float, Range(0.0, 20000.0, "W/(m2 K)")] = 300.0
    """Heat transfer to the clamp around the tube."""
    clamp_from_mm: Annotated[float, Range(0.0, 10000.0, "mm")] = 200.0
    """Upper end of the clamp, below the joint line."""
    clamp_to_mm: Annotated[float, Range(0.0, 10000.0, "mm")] = 300.0
    """Lower end of the clamp, below the joint line."""
    ambient_c: Annotated[float, Range(-50.0, 500.0, "degC")] = 20.0
    """Temperature of air, clamp and cold canister."""
    lowest_mm: Annotated[float, Range(-1000.0, 0.0, "mm")] = -30.0
    """Lowest tool position relative to the joint line; the highest is at the rim's edge."""
    element_mm: Annotated[float, Range(0.5, 50.0, "mm")] = 7.5
    """Size of the quadratic finite elements along the tool's path; they grow away from it."""
    tolerance_k: Annotated[float, Range(1e-5, 1.0, "K")] = 0.008
    """Hankel singular value below which the reduction drops a direction, at 50 kW."""
    modes: Annotated[Whole, Range(8, 2000, "")] = 160
    """Fourier modes around the circumference."""

    @model_validator(mode="after")
    def _check(self) -> CanisterParameters:
        if self.shape == "cylinder" and self.wall_mm >= self.outer_radius_mm:
            raise ValueError("wall_mm must be less than outer_radius_mm")
        if self.probe_length_mm > self.wall_mm:
            raise ValueError(
                "probe_length_mm must be at most wall_mm: the probe ends in the copper"
            )
        if self.shoulder_radius_mm <= self.probe_radius_mm:
            raise ValueError("shoulder_radius_mm must be more than probe_radius_mm")
        if (
            not -self.tube_mm < self.lid_from_mm <= self.rim_mm - self.lid_mm
            and self.shape == "cylinder"
        ):
            raise ValueError("lid_from_mm puts the lid's plate outside the rim and the tube")
        if self.highest_mm <= self.lowest_mm:
            raise ValueError(
                f"rim_mm leaves the tool no place: its highest position is {self.highest_mm:g} mm"
            )
        if self.tube_mm + self.lowest_mm < self.shoulder_radius_mm + 2 * self.element_mm:
            raise ValueError("tube_mm must reach below the tool's lowest position")
        if not self.clamp_from_mm < self.clamp_to_mm <= self.tube_mm:
            raise ValueError("clamp_to_mm must be more than clamp_from_mm and at most tube_mm")
        if self.element_mm > 0.5 * self.probe_radius_mm:
            raise ValueError(
                f"element_mm is too coarse for the probe: "
                f"at most {0.5 * self.probe_radius_mm:g} mm"
            )
        if self.modes < (least := 2.5 * self.outer_radius_mm / self.probe_radius_mm):
            raise ValueError(f"modes are too few for the probe: at least {least:.0f}")
        return self

    @property
    def highest_mm(self) -> float:
        """Highest tool position above the joint line: the shoulder meets the edge of the rim."""
        return self.rim_mm - self.shoulder_radius_mm

    def checked(self, axial_mm: float) -> float:
        """The tool's position; InputError if it is off the copper there."""
        if not self.lowest_mm - 1e-9 <= axial_mm <= self.highest_mm + 1e-9:
            raise InputError(
                f"canister: tool at {axial_mm:g} mm is off the copper; "
                f"{self.lowest_mm:g} to {self.highest_mm:g} mm above the joint"
            )
        return axial_mm

    @property
    def surface_w_per_m2_k(self) -> float:
        """Convection and linearised radiation (secant at ``radiation_c``)."""
        surface, air = self.radiation_c + ZERO_C, self.ambient_c + ZERO_C
        radiation = self.emissivity * STEFAN_BOLTZMANN * hypot(surface, air) ** 2 * (surface + air)
        return self.convection_w_per_m2_k + radiation

    @property
    def heat_capacity_j_per_m3_k(self) -> float:
        """Heat capacity per volume."""
        return self.density_kg_per_m3 * self.heat_capacity_j_per_kg_k

    def into_copper(self, probe: Any, shoulder: Any) -> Any:
        """Effect of 1 kW, from the effects of 1 W of probe and of shoulder into the copper."""
        shared = (1.0 - self.shoulder_share) * probe + self.shoulder_share * shoulder
        return 1e3 * (1.0 - self.tool_share) * shared
