"""A small source that moves on the surface of a copper body.

Green's function in time, Rosenthal where it is steady.

At the speed of a weld the field near the tool is not steady after a minute: at rest a point source
still lacks ``distance / sqrt(pi alpha t)``, 12 % at 15 mm after 50 s. Ten times as fast, it is
within seconds.
"""

from math import pi

import numpy as np
import pytest

pytest.importorskip(
    "skfem", reason="scikit-fem is not installed: pip install -r requirements/canister.lock"
)

from canister.full import FullCanister
from scipy.special import erf

from fsw_plant.canister import CanisterParameters

pytestmark = [pytest.mark.slow, pytest.mark.full]

K, RHO_C, RADIUS_M, DEPTH_M = 350.0, 3.75e6, 3e-3, 3e-3
ALPHA = K / RHO_C
WALL_M, RIM_M, TUBE_M, AROUND_M = 0.018, 0.03, 0.1, 2.0 * pi * 0.05
BODY = CanisterParameters(
    shape="plate", outer_radius_mm=50.0, wall_mm=18.0, rim_mm=30.0, tube_mm=100.0, lowest_mm=0.0,
    clamp_from_mm=50.0, clamp_to_mm=60.0, probe_radius_mm=3.0, probe_length_mm=3.0, shoulder_radius_mm=5.0,
    shoulder_share=0.0, tool_share=0.0, element_mm=1.5, modes=96, convection_w_per_m2_k=0.0, emissivity=0.0,
    clamp_w_per_m2_k=0.0, conductivity_w_per_m_k=K, heat_capacity_j_per_kg_k=RHO_C / 8933.0, properties="constant",
)  # fmt: skip
#: ahead of the source, towards the edge, below the surface [m]
PLACES = [
    (0.0, 0.012, 0.0),
    (0.01, 0.0, 0.0),
    (-0.012, 0.0, 0.0),
    (0.009, 0.009, 0.0),
    (0.0, 0.0, 0.012),
    (-0.02, 0.01, 0.006),
]


def images(x: float, period: float, mirrored: float | None = None) -> np.ndarray:
    """Distances along an axis from a source and its images.

    ``mirrored``: the distance from its image in a face.
    """
    turns = period * np.arange(-6, 7)
    return np.concatenate([x + turns, [] if mirrored is None else mirrored + turns])


def source() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points, evenly over the disc of the source, and their weights."""
    x, weight = np.polynomial.legendre.leggauss(4)
    rho, turn = 0.5 * RADIUS_M * (x + 1.0), (np.arange(12) + 0.5) * pi / 6.0
    share = np.repeat(weight * rho, 12)
    return (
        np.outer(rho, np.cos(turn)).ravel(),
        np.outer(rho, np.sin(turn)).ravel(),
        share / share.sum(),
    )


def green_k(after_s: float, place: tuple[float, float, float], speed: float) -> float:
    """Rise by 1 kW that has moved for a while.

    Green's function of heat conduction over source and time.
    """
    ahead, aside, depth = place
    log_age = np.linspace(np.log(1e-3), np.log(after_s), 1200)
    age = np.exp(log_age)
    width = np.sqrt(4.0 * ALPHA * age)
    length = 2.0 * (RIM_M + TUBE_M)
    total = np.zeros(age.size)
    for x, y, share in zip(*source(), strict=True):
        along = images(ahead - x, AROUND_M) + speed * age[:, None]
        around = np.exp(-((along / width[:, None]) ** 2)).sum(axis=1)
        over = images(aside - y, length, 2.0 * RIM_M - aside - y)
        across = np.exp(-((over / width[:, None]) ** 2)).sum(axis=1)
        total += share * around * across
    below = images(depth, 2.0 * WALL_M)[None] / width[:, None]
    half = DEPTH_M / width[:, None]
    inward = (
        (erf(below + half) - erf(below - half)).sum(axis=1) * width / DEPTH_M * np.sqrt(pi) / 4.0
    )
    rate = 2.0 * total * inward / (RHO_C * pi**1.5 * width**3)
    return float(1e3 * np.trapezoid(rate * age, log_age))


def rosenthal_k(place: tuple[float, float, float], speed: float) -> float:
    """Steady rise by 1 kW far from where it began, with the source's images in the faces of the body."""
    ahead, aside, depth = place
    rate, total = speed / (2.0 * ALPHA), 0.0
    over = images(aside, 2.0 * (RIM_M + TUBE_M), 2.0 * RIM_M - aside)
    x_disc, y_disc, share = source()
    for deep in np.array([-0.77459667, 0.0, 0.77459667]) * DEPTH_M:
        weight = 8.0 / 18.0 if deep == 0.0 else 5.0 / 18.0
        for below in images(depth - deep, 2.0 * WALL_M):
            for mode in over:
                x = ahead - x_disc
                distance = np.sqrt(x**2 + (mode - y_disc) ** 2 + below**2)
                total += weight * float((share * np.exp(-rate * (distance + x)) / distance).sum())
    return 1e3 / (2.0 * pi * K) * total


def rises(state, full: FullCanister) -> np.ndarray:
    ahead, aside, depth = np.array(PLACES).T
    return (
        full.temperature_c(state, 50.0 - 1e3 * depth, state.angle_rad + ahead / 0.05, 1e3 * aside)
        - 20.0
    )


def test_a_moving_point_source_heats_a_body_as_greens_function_in_time() -> None:
    full, speed = FullCanister(BODY, 0.1), 0.086 / 60.0
    state, seconds = full.initial(), 0.0
    for after in (2.0, 5.0, 15.0):
        for _ in range(round(10.0 * (after - seconds))):
            state = full.step(state, 1.0, 1e3 * speed, 0.0)
        seconds = after
        assert rises(state, full) == pytest.approx(
            [green_k(after, place, speed) for place in PLACES], rel=0.02
        )


def test_a_fast_point_source_reaches_the_steady_field_of_rosenthal() -> None:
    speed, full = 0.015, FullCanister(BODY, 0.1)
    state = full.initial()
    for _ in range(60):
        state = full.step(state, 1.0, 1e3 * speed, 0.0)
    full = FullCanister(BODY, 0.03)  # what is long ago does not need short steps
    for _ in range(100):
        state = full.step(state, 1.0, 1e3 * speed, 0.0)
    rises_c = rises(state, full)
    assert rises_c == pytest.approx([green_k(9.0, place, speed) for place in PLACES], rel=0.02)
    assert rises_c == pytest.approx([rosenthal_k(place, speed) for place in PLACES], rel=0.02)
