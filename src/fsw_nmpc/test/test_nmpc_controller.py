"""The controller in closed loop.

Offset-free, as planned, with sensors missing, and taking over.
"""

import math

import pytest

from fsw_control import Command, Reference
from fsw_control.reason import Reason, ReasonCode
from fsw_model import ProcessModel, nominal
from fsw_nmpc import NmpcController
from fsw_test_support.nmpc_ipopt import ReferenceSolver
from fsw_test_support.nmpc_loop import TARGET, Loop
from fsw_test_support.nmpc_problems import use_solver

NAN = float("nan")


@pytest.mark.slow
def test_rests_at_the_operating_point():
    loop = Loop()
    for _ in range(50):
        proposal = loop.step()
        assert proposal.healthy
        assert proposal.diagnosis.solver_status == "rti: solved"
    assert loop.shown.depth_mm == pytest.approx(2.66, abs=1e-6)
    assert loop.shown.temperature_c == pytest.approx(816.4, abs=1e-4)
    estimates = proposal.diagnosis.disturbances
    assert estimates["copper_temperature_c"] == pytest.approx(816.4, abs=1e-3)
    assert (
        estimates["force_kn"],
        estimates["torque_scale"],
        estimates["depth_gain"],
    ) == pytest.approx((0.0, 1.0, 1.0), abs=1e-3)
    assert (
        0.0 < estimates["depth_deviation_mm"] < 0.01
        and 0.0 < estimates["depth_gain_deviation"] < 0.3
    )
    assert (estimates["attainable_depth_mm"], estimates["attainable_temperature_c"]) == (
        2.66,
        816.4,
    )
    assert len(estimates) == 19


@pytest.mark.slow
@pytest.mark.parametrize(
    ("preset", "depth_mm", "temperature_c"), [("default", 1e-4, 0.01), ("paper", 3e-3, 0.2)]
)
def test_tracks_both_set_points(preset, depth_mm, temperature_c):
    loop = Loop(NmpcController({"preset": preset}))
    for _ in range(10):
        loop.step()
    for _ in range(500):
        proposal = loop.step(Reference(2.72, 822.4))
    assert loop.shown.depth_mm == pytest.approx(2.72, abs=depth_mm)
    assert loop.shown.temperature_c == pytest.approx(822.4, abs=temperature_c)
    assert len(proposal.diagnosis.plan.time_s) == 54
    assert proposal.diagnosis.plan.time_s[-1] == pytest.approx(30.0)


@pytest.mark.slow
@pytest.mark.parametrize(("preset", "estimates"), [("paper", True), ("paper:letter", False)])
def test_the_paper_to_the_letter_estimates_no_disturbance(preset, estimates):
    loop = Loop(NmpcController({"preset": preset}))
    for _ in range(10):
        before = loop.step().diagnosis.disturbances
    for _ in range(30):
        diagnosis = loop.step(
            depth_mm=loop.shown.depth_mm + 0.1, temperature_c=loop.shown.temperature_c - 5.0
        ).diagnosis
    names = ("force_kn", "power_kw", "torque_scale", "depth_mm", "temperature_c", "depth_gain")
    moved = [abs(diagnosis.disturbances[name] - before[name]) for name in names]
    assert moved[-1] == 0.0
    assert all(moved[:-1]) if estimates else not any(moved)


def test_far_solution_is_improved_by_a_second_solve_if_the_first_was_short(tmp_path):
    file, iterations = tmp_path / "tuning.yaml", []
    for text in (
        "second_solve_iterations: 100",
        "second_solve_iterations: 0",
        "{second_solve_iterations: 100, second_solve_distance: 2.5}",
    ):
        file.write_text(text)
        loop = Loop(NmpcController({"tuning_file": str(file)}))
        loop.step()
        iterations.append(loop.step(Reference(2.96, 816.4)).diagnosis.iterations)
    assert iterations[0] > iterations[1] == iterations[2]


def test_outputs_follow_the_plan():
    """Nominal process, no noise: with inputs as planned, the outputs are as planned."""
    loop = Loop()
    for _ in range(5):
        loop.step()
    for _ in range(3):
        plan = loop.step(Reference(2.8, 826.4)).diagnosis.plan
    for k in range(1, 45):
        assert loop.shown.depth_mm == pytest.approx(plan.depth_mm[k - 1], abs=5e-4)
        assert loop.shown.temperature_c == pytest.approx(plan.temperature_c[k - 1], abs=0.2)
        loop.step(Reference(2.8, 826.4), follow=Command(plan.force_kn[k], plan.speed_rpm[k]))


@pytest.mark.slow
@pytest.mark.parametrize(
    "factors",
    [
        {"sticking_stress_pa": 1.1, "sliding_friction": 1.1},
        {"thermal_gain_c_per_kw": 0.7},
        {"thermal_gain_c_per_kw": 1.4},
        {"depth_gain_mm_per_kn_s": 0.7},
        {"depth_gain_mm_per_kn_s": 1.4},
        {"softening_per_c": 1.5},
        {"dead_time_s": 1.2},
        {"copper_lag_s": 1.5},
    ],
    ids=lambda factors: " ".join(f"{name}x{factor}" for name, factor in factors.items()),
)
@pytest.mark.full
def test_no_offset_on_another_process(factors):
    loop = Loop(model=ProcessModel(nominal().scaled(**factors)))
    for _ in range(30):
        loop.step()
    for _ in range(1300):
        loop.step(Reference(2.76, 824.4))
    assert loop.shown.depth_mm == pytest.approx(2.76, abs=5e-4)
    assert loop.shown.temperature_c == pytest.approx(824.4, abs=0.05)


def test_no_offset_under_output_disturbances():
    loop = Loop()
    for _ in range(900):
        shown = loop.shown
        loop.step(depth_mm=shown.depth_mm + 0.05, temperature_c=shown.temperature_c - 3.0)
    assert loop.shown.depth_mm + 0.05 == pytest.approx(2.66, abs=2e-4)
    assert loop.shown.temperature_c - 3.0 == pytest.approx(816.4, abs=0.02)


def test_predicts_through_a_missing_sensor_then_gives_up():
    loop = Loop()
    for _ in range(30):
        loop.step()
    for k in range(30):
        assert loop.step(depth_mm=NAN, depth_valid=False).healthy, k
    assert loop.shown.depth_mm == pytest.approx(2.66, abs=1e-3)
    proposal = loop.step(depth_mm=NAN, depth_valid=False)
    assert not proposal.healthy
    assert proposal.reason == Reason(ReasonCode.BLIND, ("depth",), 3.0)
    assert loop.step().healthy


def test_held_values_are_no_measurements():
    """A depth sensor hangs while the set-point moves.

    Its held value must not make the estimator stand still.
    """
    loop, held = Loop(), None
    for k in range(40):
        if k < 10:
            loop.step()
            held = loop.shown.depth_mm
        elif k < 25:
            proposal = loop.step(Reference(2.76, 816.4), depth_mm=held, held=("depth",))
        else:
            proposal = loop.step(Reference(2.76, 816.4))
        if k >= 10:
            assert proposal.diagnosis.depth_estimate_mm == pytest.approx(
                loop.shown.depth_mm, abs=5e-3
            )


def test_saturation_without_failures():
    """Set-points out of reach: no failed solve, and the set-points that can be reached are."""
    loop = Loop()
    for k in range(600):
        sign = 1 if k // 150 % 2 else -1
        proposal = loop.step(Reference(2.66 + 0.5 * sign, 816.4 + (60.0 if sign > 0 else -40.0)))
    assert proposal.diagnosis.bad_cycles == 0
    for _ in range(900):
        loop.step()
    assert loop.shown.depth_mm == pytest.approx(2.66, abs=1e-3)
    assert loop.shown.temperature_c == pytest.approx(816.4, abs=0.1)


@pytest.mark.requirement("S12")
def test_follows_another_controller_and_takes_over_without_a_bump():
    """Another one moves the inputs about while this one only watches.

    Then it is in command, and nothing jumps.
    """
    loop = Loop()
    for k in range(100):
        before = loop.applied
        other = Command(
            before.force_kn + 0.1 * math.sin(0.3 * k), before.speed_rpm + 0.5 * math.cos(0.2 * k)
        )
        assert loop.step(follow=other).healthy
    here = Reference(loop.shown.depth_mm, loop.shown.temperature_c)
    watched, last = loop.controller.library.output, loop.applied
    assert watched.depth_mm == pytest.approx(here.depth_mm, abs=1e-3)
    moves = []
    for _ in range(30):
        loop.step(here)
        moves.append(
            (loop.applied.force_kn - last.force_kn, loop.applied.speed_rpm - last.speed_rpm)
        )
        last = loop.applied
    rest = Loop()
    for _ in range(100):
        rest.step()
    still = rest.applied
    first = rest.step()
    assert (
        abs(first.command.force_kn - still.force_kn) < 1e-3
    )  # at rest a swap moves nothing at all
    assert abs(first.command.speed_rpm - still.speed_rpm) < 1e-2
    assert all(abs(force) <= 1.0 + 1e-9 and abs(speed) <= 3.0 + 1e-9 for force, speed in moves)


@pytest.mark.slow
@pytest.mark.full
def test_reference_solver_in_the_loop_does_the_same():
    """Real-time iterations against problems solved to convergence, over a step of both set-points."""
    loops = [Loop(), Loop(converged := NmpcController())]
    use_solver(converged, ReferenceSolver(converged.library, nominal()))
    for k in range(40):
        for loop in loops:
            proposal = loop.step(TARGET if k < 3 else Reference(2.76, 822.4))
            assert proposal.healthy, proposal.reason
    assert loops[0].shown.depth_mm == pytest.approx(loops[1].shown.depth_mm, abs=5e-4)
    assert loops[0].applied.force_kn == pytest.approx(loops[1].applied.force_kn, abs=0.2)
    assert loops[0].applied.speed_rpm == pytest.approx(
        loops[1].applied.speed_rpm, abs=1.0
    )  # of 33 rpm moved
