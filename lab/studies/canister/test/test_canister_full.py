"""All finite elements in implicit steps.

Convergence, energy, and the reduced model beside them.
"""

import numpy as np
import pytest

pytest.importorskip(
    "skfem", reason="scikit-fem is not installed: pip install -r requirements/canister.lock"
)

from canister.full import FullCanister, exact_stir_zone_c
from scipy.sparse.linalg import eigsh

from fsw_heat import ReducedCanister
from fsw_heat.elements import Elements
from fsw_heat.history import ToolCourse, heat_history
from fsw_heat.projection import project
from fsw_plant.canister import CanisterParameters

pytestmark = pytest.mark.slow

#: a canister of a fifth of the size
SMALL = CanisterParameters(
    outer_radius_mm=100.0, wall_mm=20.0, rim_mm=60.0, lid_mm=10.0, lid_from_mm=20.0, tube_mm=200.0, lowest_mm=-10.0,
    probe_radius_mm=8.0, probe_length_mm=20.0, shoulder_radius_mm=12.0, clamp_from_mm=60.0, clamp_to_mm=100.0,
    element_mm=4.0, modes=32, properties="constant",
)  # fmt: skip


def inputs(second: float) -> tuple[float, float, float]:
    """Power kW, traverse mm/s and axial position mm of a weld with dwell, descent, a stop and changing power."""
    power = (6.0 if second < 40.0 else 4.0) + 0.8 * np.sign(np.sin(0.35 * second))
    speed = 0.0 if second < 20.0 or 100.0 < second < 120.0 else 1.43
    return (
        power,
        speed,
        float(np.interp(second, [30.0, 60.0, 280.0, 300.0], [30.0, 0.0, 0.0, 20.0])),
    )


@pytest.fixture(scope="module")
def course() -> ToolCourse:
    """Five minutes in steps of 0.25 s."""
    return ToolCourse(*np.array([inputs(0.25 * k) for k in range(1200)]).T)


@pytest.fixture(scope="module")
def exact_c(course: ToolCourse) -> np.ndarray:
    return exact_stir_zone_c(SMALL, course, 0.25)


@pytest.mark.full
def test_the_reduced_stir_zone_follows_all_finite_elements_at_every_step(
    course: ToolCourse, exact_c: np.ndarray
) -> None:
    """Of 290 K, with no error of time in either."""
    reduced = ReducedCanister(SMALL, project(SMALL))
    history = heat_history(reduced, reduced.initial(axial_mm=30.0), course, 0.25)
    assert exact_c.max() > 310.0
    assert np.abs(history.stir_zone_c - exact_c).max() < 0.15


@pytest.mark.full
def test_implicit_steps_of_all_finite_elements_come_near_the_exact_ones(
    course: ToolCourse, exact_c: np.ndarray
) -> None:
    """Two ways to solve the same equations; what differs is of second order in the step."""
    largest = []
    for step_s in (0.25, 0.125):
        full, rises_c = FullCanister(SMALL, step_s), []
        state = full.initial(axial_mm=30.0)
        for k in range(160):
            for _ in range(round(0.25 / step_s)):
                state = full.step(state, *inputs(0.25 * k))
            rises_c.append(full.stir_zone_temperature_c(state))
        largest.append(np.abs(np.array(rises_c) - exact_c[:160])[4:].max())
    assert largest[0] < 0.5
    assert largest[1] < 0.45 * largest[0]


@pytest.mark.full
def test_reduced_thermocouples_follow_all_finite_elements() -> None:
    full, reduced = FullCanister(SMALL, 0.25), ReducedCanister(SMALL, project(SMALL))
    exact, small = full.initial(axial_mm=30.0), reduced.initial(axial_mm=30.0)
    places = ([100.0, 90.0, 80.0, 5.0], [0.2, 1.0, 3.0, 0.0], [-50.0, 20.0, 50.0, 25.0])
    for k in range(400):
        exact, small = (
            full.step(exact, *inputs(0.25 * k)),
            reduced.step(small, *inputs(0.25 * k), 0.25),
        )
        if k % 8 == 7:
            assert reduced.temperature_c(small, *places) == pytest.approx(
                full.temperature_c(exact, *places), abs=1.0
            )


def test_energy_is_kept_without_losses() -> None:
    tight = SMALL.changed(
        convection_w_per_m2_k=0.0, emissivity=0.0, clamp_w_per_m2_k=0.0, tool_share=0.0
    )
    full = FullCanister(tight, 1.0)
    state, brought = full.initial(), 0.0
    for k in range(60):
        power = inputs(k)[0]
        state, brought = full.step(state, power, 1.43, 0.0), brought + 1e3 * power
        assert full.stored_j(state) == pytest.approx(brought, rel=1e-9)


@pytest.mark.full
def test_time_steps_converge_in_second_order() -> None:
    by_step = {}
    for step_s in (4.0, 2.0, 1.0, 0.125):
        full = FullCanister(SMALL, step_s)
        state = full.initial()
        for _ in range(round(16.0 / step_s)):
            state = full.step(state, 5.0, 1.43, 0.0)
        by_step[step_s] = full.stir_zone_temperature_c(state)
    errors = [abs(by_step[step_s] - by_step[0.125]) for step_s in (4.0, 2.0, 1.0)]
    assert np.log2(errors[0] / errors[1]) > 1.8
    assert np.log2(errors[1] / errors[2]) > 1.8


@pytest.mark.full
def test_the_mesh_converges_in_fourth_order() -> None:
    """Quadratic elements.

    The slowest decay of a mode in a tube without a lid, and the heated canister.
    """
    decays, rises = [], []
    for element_mm in (4.0, 2.0, 1.0):
        e = Elements(SMALL.changed(element_mm=element_mm, lid_mm=0.0))
        decays.append(eigsh(e.stiffness(3), k=1, M=e.mass, sigma=0.0)[0][0])
        full = FullCanister(SMALL.changed(element_mm=element_mm), 30.0)
        rises.append(full.stir_zone_temperature_c(full.step(full.initial(), 5.0, 1.43, 0.0)))
    assert np.log2((decays[0] - decays[1]) / (decays[1] - decays[2])) > 3.5
    assert abs(rises[1] - rises[2]) < 0.5 * abs(rises[0] - rises[1]) < 0.0005 * rises[2]


def test_more_modes_change_little() -> None:
    rises = []
    for modes in (32, 64):
        full = FullCanister(SMALL.changed(modes=modes), 30.0)
        rises.append(full.stir_zone_temperature_c(full.step(full.initial(), 5.0, 1.43, 0.0)))
    assert rises[0] == pytest.approx(rises[1], rel=0.01)


@pytest.mark.full
def test_a_basis_made_for_typical_copper_serves_other_copper(course: ToolCourse) -> None:
    other = SMALL.changed(
        conductivity_w_per_m_k=300.0,
        heat_capacity_j_per_kg_k=480.0,
        convection_w_per_m2_k=40.0,
        clamp_w_per_m2_k=1500.0,
    )
    short = ToolCourse(
        course.power_kw[:480], course.traverse_mm_per_s[:480], course.axial_mm[:480]
    )
    reduced = ReducedCanister(other, project(SMALL))
    history = heat_history(reduced, reduced.initial(axial_mm=30.0), short, 0.25)
    assert np.abs(history.stir_zone_c - exact_stir_zone_c(other, short, 0.25)).max() < 0.2
