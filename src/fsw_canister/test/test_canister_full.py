"""All finite elements in implicit steps: convergence, energy, the reduced model beside them, and what is nonlinear."""

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("skfem", reason="scikit-fem is not installed: pip install -r requirements/canister.lock")

from scipy.sparse.linalg import eigsh

from fsw_canister import CanisterParameters, ReducedCanister, load_or_reduce
from fsw_canister.elements import Elements
from fsw_canister.full import FullCanister
from fsw_canister.projection import project

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
    return power, speed, float(np.interp(second, [30.0, 60.0, 280.0, 300.0], [30.0, 0.0, 0.0, 20.0]))


def test_the_reduced_model_follows_all_finite_elements() -> None:
    """In the stir zone and at thermocouples, of 500 K."""
    full, reduced = FullCanister(SMALL, 0.25), ReducedCanister(SMALL, project(SMALL))
    one, other = full.initial(axial_mm=30.0), reduced.initial(axial_mm=30.0)
    places = ([100.0, 90.0, 80.0, 5.0], [0.2, 1.0, 3.0, 0.0], [-50.0, 20.0, 50.0, 25.0])
    for k in range(600):
        at = inputs(0.25 * k)
        one, other = full.step(one, *at), reduced.step(other, *at, 0.25)
        if k % 8 == 7:
            exact = full.stir_zone_temperature_c(one)
            assert reduced.stir_zone_temperature_c(other) == pytest.approx(exact, abs=0.5)
            assert reduced.temperature_c(other, *places) == pytest.approx(full.temperature_c(one, *places), abs=1.0)
    assert exact > 150.0


@pytest.mark.full
def test_the_reduced_model_follows_all_finite_elements_over_45_min() -> None:
    full, reduced = FullCanister(SMALL, 1.0), ReducedCanister(SMALL, project(SMALL))
    one, other = full.initial(axial_mm=30.0), reduced.initial(axial_mm=30.0)
    for k in range(2700):
        power, speed, axial = inputs(0.11 * k)
        one, other = full.step(one, 0.5 * power, speed, axial), reduced.step(other, 0.5 * power, speed, axial, 1.0)
        if k > 5:
            exact = full.stir_zone_temperature_c(one)
            assert reduced.stir_zone_temperature_c(other) == pytest.approx(exact, abs=0.5)


def test_energy_is_kept_without_losses() -> None:
    tight = SMALL.changed(convection_w_per_m2_k=0.0, emissivity=0.0, clamp_w_per_m2_k=0.0, tool_share=0.0)
    full = FullCanister(tight, 1.0)
    state, brought = full.initial(), 0.0
    for k in range(60):
        power = inputs(k)[0]
        state, brought = full.step(state, power, 1.43, 0.0), brought + 1e3 * power
        assert full.stored_j(state) == pytest.approx(brought, rel=1e-9)


def test_time_steps_converge_in_second_order() -> None:
    found = {}
    for step_s in (4.0, 2.0, 1.0, 0.125):
        full = FullCanister(SMALL, step_s)
        state = full.initial()
        for _ in range(round(16.0 / step_s)):
            state = full.step(state, 5.0, 1.43, 0.0)
        found[step_s] = full.stir_zone_temperature_c(state)
    errors = [abs(found[step_s] - found[0.125]) for step_s in (4.0, 2.0, 1.0)]
    assert np.log2(errors[0] / errors[1]) > 1.8
    assert np.log2(errors[1] / errors[2]) > 1.8


def test_the_mesh_converges_in_fourth_order() -> None:
    """Quadratic elements: the slowest decay of a mode in a tube without a lid, and the heated canister."""
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


def test_a_basis_made_for_typical_copper_serves_other_copper() -> None:
    other = SMALL.changed(
        conductivity_w_per_m_k=300.0,
        heat_capacity_j_per_kg_k=480.0,
        convection_w_per_m2_k=40.0,
        clamp_w_per_m2_k=1500.0,
    )
    full, reduced = FullCanister(other, 0.5), ReducedCanister(other, project(SMALL))
    one, another = full.initial(axial_mm=30.0), reduced.initial(axial_mm=30.0)
    for k in range(240):
        one, another = full.step(one, *inputs(0.5 * k)), reduced.step(another, *inputs(0.5 * k), 0.5)
        if k > 4:
            exact = full.stir_zone_temperature_c(one)
            assert reduced.stir_zone_temperature_c(another) == pytest.approx(exact, abs=0.7)


@pytest.mark.full
def test_kirchhoffs_transform_keeps_most_of_what_is_nonlinear(tmp_path: Path) -> None:
    """The true k(T), c(T) and radiation against the linear models."""
    truth, errors = FullCanister(SMALL.changed(properties="kirchhoff"), 2.0, nonlinear=True), {}
    state = truth.initial()
    for _ in range(30):
        state = truth.step(state, 9.0, 1.43, 0.0)
    exact = truth.stir_zone_temperature_c(state)
    for kind in ("kirchhoff", "constant"):
        model = load_or_reduce(SMALL.changed(properties=kind), tmp_path)
        found = model.initial()
        for _ in range(30):
            found = model.step(found, 9.0, 1.43, 0.0, 2.0)
        errors[kind] = abs(model.stir_zone_temperature_c(found) - exact)
    assert exact > 350.0
    assert errors["kirchhoff"] < 0.05 * exact
    brought = 30 * 2.0 * 9e3 * (1.0 - SMALL.tool_share)
    assert truth.stored_j(state) < brought
