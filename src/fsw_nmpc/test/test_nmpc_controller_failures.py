"""The controller through failed solves, late ticks, a diverged estimator and changes while it runs."""

import errno
import math
import os
from types import SimpleNamespace

import numpy as np
import pytest

from fsw_control import Command, Measurement, Reference
from fsw_control.reason import Reason, ReasonCode
from fsw_nmpc import NmpcController
from fsw_nmpc import controller as controller_module
from fsw_nmpc.library import SolveStatus
from fsw_test_support.nmpc_loop import TARGET, Loop
from fsw_test_support.nmpc_problems import solve, use_solver

NAN = float("nan")


class Broken:
    """A solver that fails on demand, in a way of one's choice, and remembers where it was started."""

    name = "broken"

    def __init__(self, library):
        self.library, self.how, self.starts = library, "", []

    def solve(self, problem, moves):
        self.starts.append(np.array(moves))
        status, solution, depth, temperature = solve(self.library, problem, moves)
        if self.how == "status":
            status = SolveStatus.ITERATION_CAP
        elif self.how == "nan":
            solution = solution * np.nan
        elif self.how in ("fast", "fast down"):
            solution = np.array(solution)
            solution[0] += 2.0 if self.how == "fast" else -2.0  # the first move of the force only
        elif self.how in ("beyond", "beyond below"):
            solution = np.tile([0.9, 2.9], len(moves) // 2) * (
                1.0 if self.how == "beyond" else -1.0
            )
        return status, solution, depth, temperature


@pytest.mark.parametrize("how", ["status", "nan", "fast", "fast down", "beyond", "beyond below"])
def test_failed_solves_follow_the_plan_then_turn_unhealthy(how):
    controller = NmpcController({"plan_reuse": 4})
    broken = Broken(controller.library)
    use_solver(controller, broken)
    loop = Loop(controller)
    for _ in range(15):
        proposal = loop.step(Reference(2.76, 816.4))
    planned = np.diff([loop.applied.force_kn, *proposal.diagnosis.plan.force_kn[1:4]])
    broken.how = how
    for k in range(4):
        before = loop.applied
        proposal = loop.step(Reference(2.76, 816.4))
        assert proposal.healthy
        assert proposal.reason.code is ReasonCode.SOLVER
        if k < 3:
            assert proposal.command.force_kn - before.force_kn == pytest.approx(
                planned[k], abs=1e-6
            )
        assert len(proposal.diagnosis.plan.time_s) == 54
    proposal = loop.step(Reference(2.76, 816.4))
    assert not proposal.healthy
    assert proposal.diagnosis.bad_cycles == 5
    broken.how, broken.starts = "", []
    assert loop.step(Reference(2.76, 816.4)).healthy
    assert not broken.starts[0].any(), "the solve after a failure starts cold"


def test_late_ticks_are_predicted_over():
    """A gap of 1 s in the ticks: the estimate is where the process is."""
    loop = Loop()
    for _ in range(40):
        loop.step(Reference(2.70, 819.4))
    for _ in range(9):
        loop.model.step(loop.state, loop.applied.force_kn, loop.applied.speed_rpm)
    proposal = loop.controller.step(loop.measure(), Reference(2.70, 819.4), loop.applied, 1.0)
    assert proposal.healthy
    # the first sample after the gap looks like a spike, so this is the prediction alone
    assert proposal.diagnosis.depth_estimate_mm == pytest.approx(loop.shown.depth_mm, abs=5e-4)
    assert proposal.diagnosis.temperature_estimate_c == pytest.approx(
        loop.shown.temperature_c, abs=1e-2
    )


@pytest.mark.parametrize("dt_s", [0.0, -1.0, 1e9, NAN])
def test_irregular_tick_lengths_give_a_finite_command(dt_s):
    loop = Loop()
    for _ in range(5):
        loop.step()
    proposal = loop.controller.step(loop.measure(), TARGET, loop.applied, dt_s)
    assert math.isfinite(proposal.command.force_kn)
    assert loop.step().healthy


def test_diverged_estimator_restarts():
    loop = Loop()
    for _ in range(20):
        loop.step()
    for row in loop.controller.library.state.estimator.p:
        row[0:10] = [NAN] * 10
    proposals = [loop.step() for _ in range(3)]
    assert proposals[-1].healthy
    assert proposals[-1].diagnosis.depth_estimate_mm == pytest.approx(2.66, abs=1e-3)


def test_waits_for_sensors_and_reference():
    controller = NmpcController()
    applied = Command(78.4, 407.576)
    good = Measurement(0.1, 2.66, 1052.86, 816.4)
    proposal = controller.step(good, Reference(NAN, 816.4), applied, 0.1)
    assert (proposal.healthy, proposal.reason) == (False, Reason(ReasonCode.NO_REFERENCE))
    controller.reset(applied)
    proposal = controller.step(
        Measurement(0.0, NAN, NAN, NAN, False, False, False), TARGET, applied, 0.1
    )
    waiting = Reason(ReasonCode.WAITING_FOR_SENSORS, ("depth", "thermocouple"))
    assert (proposal.healthy, proposal.reason) == (False, waiting)
    assert controller.step(good, TARGET, applied, 0.1).healthy
    assert controller.step(good, Reference(NAN, NAN), Command(NAN, NAN), 0.1).healthy


def test_new_horizon_continues_the_plan(tmp_path):
    loop = Loop()
    for _ in range(12):
        before = loop.step(Reference(2.76, 816.4))
    file = tmp_path / "every_interval.yaml"
    file.write_text("blocks: 54")
    loop.controller.configure({"tuning_file": str(file)})
    loop.controller.finish_changes()
    assert loop.controller.library.horizon.n_blocks == 54
    last = loop.applied
    proposal = loop.step(Reference(2.76, 816.4))
    assert proposal.healthy
    planned = before.diagnosis.plan.force_kn[1] - before.diagnosis.plan.force_kn[0]
    assert proposal.command.force_kn - last.force_kn == pytest.approx(planned, abs=0.2)


def test_failed_horizon_is_reported_and_the_next_change_retries(tmp_path, monkeypatch):
    """The disk is full once.

    The old solver works on, the proposals say why, and the next change tries again.
    """
    errors = []
    loop = Loop()
    loop.controller.use_logger(SimpleNamespace(info=lambda _: None, error=errors.append))
    (tmp_path / "54.yaml").write_text("blocks: 54")
    make, full = controller_module._make, [True]

    def make_or_fail(settings):
        if full and full.pop():
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return make(settings)

    monkeypatch.setattr(controller_module, "_make", make_or_fail)
    loop.controller.configure({"tuning_file": str(tmp_path / "54.yaml")})
    loop.controller.finish_changes()
    for _ in range(3):
        proposal = loop.step()
        assert proposal.healthy and os.strerror(errno.ENOSPC) in proposal.reason.detail
    assert len(errors) == 1 and loop.controller.library.horizon.n_blocks == 20
    loop.controller.configure({"tuning_file": str(tmp_path / "54.yaml")})  # the same once more
    loop.controller.finish_changes()
    assert loop.controller.library.horizon.n_blocks == 54 and not loop.step().reason
