"""The canister's heat against what can be integrated: a moving line source in a plate."""

from functools import cache
from math import pi

import numpy as np
import pytest

pytest.importorskip(
    "skfem", reason="scikit-fem is not installed: pip install -r requirements/canister.lock"
)

from scipy.integrate import quad
from scipy.special import k0

from fsw_heat import ReducedCanister, load_or_reduce
from fsw_plant.canister import CanisterParameters

pytestmark = pytest.mark.slow

K, RHO_C, SPEED_M_PER_S = 350.0, 3.75e6, 0.086 / 60.0
ALPHA = K / RHO_C
#: insulated; the plate is 8 mm thick, so that a power of 0.16 kW is 1 kW in 50 mm
PLATE = {
    "shape": "plate", "outer_radius_mm": 320.0, "wall_mm": 8.0, "probe_length_mm": 8.0, "probe_radius_mm": 8.0,
    "shoulder_radius_mm": 10.0, "shoulder_share": 0.0, "tool_share": 0.0, "tube_mm": 1200.0, "lowest_mm": 0.0,
    "element_mm": 4.0, "modes": 128, "tolerance_k": 2e-4,
    "convection_w_per_m2_k": 0.0, "emissivity": 0.0, "clamp_w_per_m2_k": 0.0,
    "conductivity_w_per_m_k": K, "heat_capacity_j_per_kg_k": RHO_C / 8933.0, "properties": "constant",
}  # fmt: skip
#: of a line source of 1 kW in 50 mm, at 25 mm from it, with an edge [mm], here far away or near:
#: after s, K
TABLE = {
    250.0: {5: 3.73, 10: 6.14, 30: 10.3, 60: 12.7, 120: 14.6, 300: 16.1, 600: 16.4},
    60.0: {5: 3.73, 10: 6.15, 30: 10.8, 60: 14.1, 120: 17.3, 300: 19.9, 600: 20.5},
}


def line_k(after_s: float, ahead_m: float, aside_m: float, edge_m: float) -> float:
    """Green's function.

    A line source of 20 kW/m that has moved for a while, and its image in the edge.
    """

    def integrand(age_s: float) -> float:
        ahead = ahead_m + SPEED_M_PER_S * age_s
        squares = [ahead**2 + (aside_m - image) ** 2 for image in (0.0, 2.0 * edge_m)]
        return sum(np.exp(-square / (4.0 * ALPHA * age_s)) for square in squares) / age_s

    return float(
        20e3
        / (4.0 * pi * K)
        * quad(integrand, 0.0, after_s, limit=300, points=[0.01 * after_s])[0]
    )


def around(distance_m: float, count: int = 12) -> tuple[np.ndarray, np.ndarray]:
    """Ahead and aside of points on a circle."""
    turn = (np.arange(count) + 0.5) * 2.0 * pi / count
    return distance_m * np.cos(turn), distance_m * np.sin(turn)


@cache
def plate(edge_mm: float) -> ReducedCanister:
    return load_or_reduce(CanisterParameters(**PLATE, rim_mm=edge_mm))


@pytest.mark.parametrize("edge_mm", [60.0, pytest.param(250.0, marks=pytest.mark.full)])
def test_a_moving_line_source_heats_a_plate_as_in_the_table(edge_mm: float) -> None:
    ahead, aside = around(0.025)
    canister, seconds = plate(edge_mm), 0
    state = canister.initial()
    for after, expected in TABLE[edge_mm].items():
        state = canister.step(state, 0.16, 1e3 * SPEED_M_PER_S, 0.0, after - seconds)
        seconds = after
        rise = (
            canister.temperature_c(
                state, 316.0, state.angle_rad + ahead / 0.32, 1e3 * aside
            ).mean()
            - 20.0
        )
        assert rise == pytest.approx(expected, rel=0.02)
        green = np.mean(
            [line_k(after, a, b, 1e-3 * edge_mm) for a, b in zip(ahead, aside, strict=True)]
        )
        assert rise == pytest.approx(green, rel=0.02)


@pytest.mark.full
def test_a_line_source_far_from_edges_reaches_the_steady_field_of_rosenthal() -> None:
    """Edges at 250 mm, whose image belongs to the closed form.

    Before the period of 2 m is noticed.
    """
    wide = plate(250.0)
    state = wide.step(wide.initial(), 0.16, 1e3 * SPEED_M_PER_S, 0.0, 700.0)
    for ahead, aside in (
        (0.03, 0.0),
        (-0.03, 0.0),
        (0.0, 0.03),
        (0.0, -0.06),
        (0.06, 0.04),
        (-0.08, 0.02),
    ):
        distances = np.array([np.hypot(ahead, aside), np.hypot(ahead, aside - 0.5)])
        rate = SPEED_M_PER_S / (2.0 * ALPHA)
        rosenthal = 20e3 / (2.0 * pi * K) * np.exp(-rate * ahead) * k0(rate * distances).sum()
        rise = wide.temperature_c(state, 316.0, state.angle_rad + ahead / 0.32, 1e3 * aside) - 20.0
        assert rise == pytest.approx(rosenthal, rel=0.02)
