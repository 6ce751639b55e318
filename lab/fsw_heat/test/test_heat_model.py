"""Properties of copper and the Kirchhoff transform."""

import numpy as np
import pytest

from fsw_heat.heat_model import DENSITY_KG_PER_M3, Kirchhoff, conductivity, heat_capacity
from fsw_plant.canister import CanisterParameters


def test_defaults_are_those_of_the_table() -> None:
    p = CanisterParameters()
    assert p.conductivity_w_per_m_k == pytest.approx(float(conductivity(p.reference_c)), rel=2e-3)
    assert p.heat_capacity_j_per_kg_k == pytest.approx(
        float(heat_capacity(p.reference_c)), rel=2e-3
    )
    assert p.density_kg_per_m3 == DENSITY_KG_PER_M3
    assert conductivity([26.85, 726.85]) == pytest.approx([401.0, 352.0])
    assert heat_capacity([26.85, 926.85]) == pytest.approx([385.0, 480.0])


def test_kirchhoffs_transform_is_the_integral_of_k_and_inverts() -> None:
    kirchhoff = Kirchhoff(CanisterParameters())
    temperatures = np.array([20.0, 300.0, 816.4])
    assert kirchhoff.temperature_c(kirchhoff.theta(temperatures)) == pytest.approx(
        temperatures, abs=1e-6
    )
    grid = np.linspace(20.0, 816.4, 20001)
    values = conductivity(grid) / conductivity(275.0)
    assert float(kirchhoff.theta(816.4)) == pytest.approx(
        0.5 * (values[1:] + values[:-1]) @ np.diff(grid), rel=1e-5
    )
    constant = Kirchhoff(CanisterParameters(properties="constant"))
    assert float(constant.theta(816.4)) == pytest.approx(796.4)
