"""Whatever a controller does, there is an answer; whatever references come, one holds."""

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fsw_control import Command, Measurement, Proposal, Reference
from fsw_control.host import answer
from fsw_control.reason import Reason, ReasonCode

APPLIED = Command(78.0, 400.0)
REFERENCE = Reference(2.66, 850.0)
GOOD = Measurement(0.0, 2.66, 1052.0, 850.0)


class Scripted:
    """A controller that does what the test says."""

    name = "scripted"
    tolerated_sensors = ("torque",)

    def __init__(self, result):
        self.result = result

    def step(self, measurement, reference, applied, dt_s):
        if isinstance(self.result, Exception):
            raise self.result
        return self.result

    def reset(self, applied):
        pass


def test_good_proposal_passes_unchanged():
    proposal = Proposal(Command(79.0, 401.0))
    assert answer(Scripted(proposal), GOOD, REFERENCE, APPLIED, 0.1) is proposal


def test_exception_becomes_an_unhealthy_proposal_in_one_line():
    proposal = answer(Scripted(RuntimeError("no\nsolution")), GOOD, REFERENCE, APPLIED, 0.1)
    assert proposal.command == APPLIED and not proposal.healthy
    assert proposal.reason.code is ReasonCode.RAISED
    text, place = proposal.reason.detail.split(" (")
    assert (text, place.partition(":")[0]) == ("RuntimeError: no solution", Path(__file__).name)


@pytest.mark.parametrize(
    "result",
    [
        None,
        "nonsense",
        Proposal(Command("a", 1.0)),
        Proposal(None),
        Proposal(APPLIED, healthy="yes"),
        Proposal(APPLIED, healthy=None),
        Proposal(APPLIED, reason=3),
    ],
)
def test_nonsense_becomes_an_unhealthy_proposal(result):
    proposal = answer(Scripted(result), GOOD, REFERENCE, APPLIED, 0.1)
    assert proposal.command == APPLIED and not proposal.healthy and proposal.reason


@given(st.floats(), st.floats())
def test_the_command_is_always_finite(force, speed):
    proposal = answer(Scripted(Proposal(Command(force, speed))), GOOD, REFERENCE, APPLIED, 0.1)
    assert math.isfinite(proposal.command.force_kn) and math.isfinite(proposal.command.speed_rpm)
    assert proposal.healthy == (math.isfinite(force) and math.isfinite(speed))


def test_needed_sensor_makes_unhealthy_and_tolerated_does_not():
    proposal = Proposal(APPLIED)
    no_torque = Measurement(0.0, 2.66, math.nan, 850.0, torque_valid=False)
    assert answer(Scripted(proposal), no_torque, REFERENCE, APPLIED, 0.1).healthy
    no_depth = Measurement(0.0, math.nan, math.nan, 850.0, depth_valid=False, torque_valid=False)
    refused = answer(Scripted(proposal), no_depth, REFERENCE, APPLIED, 0.1)
    assert not refused.healthy and refused.reason == Reason(ReasonCode.INVALID_SENSOR, ("depth",))


def test_tolerated_sensors_that_are_nonsense_make_unhealthy():
    controller = Scripted(Proposal(APPLIED))
    controller.tolerated_sensors = None
    proposal = answer(
        controller,
        Measurement(0.0, 2.66, math.nan, 850.0, torque_valid=False),
        REFERENCE,
        APPLIED,
        0.1,
    )
    assert proposal.command == APPLIED and not proposal.healthy


def test_proposal_without_reference_is_unhealthy():
    proposal = answer(Scripted(Proposal(Command(1.0, 1.0))), GOOD, None, APPLIED, 0.1)
    assert proposal.command == APPLIED and proposal.reason.code is ReasonCode.NO_SET_POINT
