"""The parts of the arbiter one by one: settings, parameters, table, diagram, requests."""

import importlib.util
import re
from dataclasses import replace
from pathlib import Path

import pytest

from fsw_control.cause import Cause
from fsw_control.contract import Command, Limits
from fsw_control.parameters import defaults, validate
from fsw_control.reason import Reason
from fsw_control.schema.models import InputError
from fsw_supervisor.facts import Answer, Code
from fsw_supervisor.in_force import DriveOffset
from fsw_supervisor.operator_requests import SwitchRequest
from fsw_supervisor.parameters import SupervisorParameters
from fsw_supervisor.safety_monitor import SafetyMonitor
from fsw_supervisor.state_machine import TRANSITIONS, Level, Machine, Mode, next_mode
from fsw_supervisor.tick import ProposalInput, check

WORKSPACE = Path(__file__).parents[3]
NAN = float("nan")
DOCUMENT = WORKSPACE / "docs" / "concepts" / "arbiter.md"


@pytest.fixture(scope="module")
def drawing():
    """The script that draws the state machine into the documentation."""
    spec = importlib.util.spec_from_file_location(
        "drawing", WORKSPACE / "scripts" / "draw_state_machine.py"
    )
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_what_is_left_out_has_the_shipped_value():
    shipped = SupervisorParameters.from_values(defaults(SupervisorParameters))
    assert SupervisorParameters.from_values({"warm_ticks": 7}) == shipped.changed(warm_ticks=7)
    with pytest.raises(InputError, match="warm"):
        SupervisorParameters.from_values({"warm": 7})


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"deadline_s": 0.2}, "deadline_s is 0.2 s"),
        ({"force_transition_kn": 2.0}, "force_transition_kn"),
        ({"speed_transition_rpm": 4.0}, "speed_transition_rpm"),
        ({"limits.force_min_kn": 99.0}, "must be below force_max"),
        ({"safe_force_kn": 10.0}, "safe_force_kn must be within 60.0 to 95.0 kN"),
        ({"controller": ""}, "controller must name"),
        ({"fallbacks": ["decentral", "hold"]}, "'hold' cannot be the name of a controller"),
        ({"fallbacks": ["no such"]}, "'no such' cannot be the name of a controller"),
        ({"interlocks.temperature_high.trip": 880.0}, "temperature_high"),
        ({"validity.depth.minimum": 7.0}, "minimum 7.0 must be below"),
    ],
)
def test_parameters_that_contradict_each_other_are_refused_in_words(changes, words):
    with pytest.raises(InputError, match=re.escape(words)):
        validate(SupervisorParameters, changes)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("hold_timeout_s", NAN),
        ("warm_ticks", 0),
        ("takeover_ticks", 0),
        ("duplicate_ticks", 0),
        ("storm_window_s", -1.0),
        ("deadline_s", 0.0),
        ("interlocks.persistence_s", 0.0),
        ("interlocks.depth_high.hysteresis", -1.0),
    ],
)
def test_wrong_numbers_are_refused(name, value):
    with pytest.raises(InputError, match=name):
        validate(SupervisorParameters, {name: value})


def test_unit_rounding_is_not_a_violation():
    before = Command(94.0 - 1e-12, 407.0)
    proposal = ProposalInput(0, "a", Command(95.0 + 1e-9, 410.0 + 1e-9))
    assert check("a", proposal, before, Limits()).refusal == Reason()
    assert (
        check("a", replace(proposal, command=Command(95.001, 410.0)), before, Limits()).refusal
        != Reason()
    )


def test_each_pair_of_mode_and_trigger_leads_to_one_mode():
    assert len({(row.source, row.trigger) for row in TRANSITIONS}) == len(TRANSITIONS)
    assert {row.trigger for row in TRANSITIONS} == set(Cause) - {
        Cause.STARTED,
        Cause.UNKNOWN,
        Cause.SWAP_REQUESTED,
        Cause.SWAP_FAILED,
        Cause.SWAP_BACK,
    }
    assert next_mode(Mode.SAFE_STOP, Cause.CONTROLLER_BACK) is None
    leaving = {row.trigger for row in TRANSITIONS if row.source is Mode.SAFE_STOP}
    assert leaving == {Cause.OPERATOR_AUTO, Cause.OPERATOR_MANUAL, Cause.OPERATOR_HOLD}


@pytest.mark.requirement("S3")
def test_a_safe_stop_can_be_reached_from_everywhere_at_once():
    for mode in Mode:
        if mode is not Mode.SAFE_STOP:
            assert next_mode(mode, Cause.OPERATOR_SAFE_STOP) is Mode.SAFE_STOP
            assert next_mode(mode, Cause.INTERLOCK_TRIP) is Mode.SAFE_STOP


def test_the_diagram_in_the_documentation_is_up_to_date(drawing):
    text = DOCUMENT.read_text(encoding="utf-8")
    assert drawing.renew_document(text) == text, "run scripts/draw_state_machine.py"


def test_the_diagram_needs_its_marks(drawing, tmp_path):
    with pytest.raises(ValueError, match="marks"):
        drawing.renew_document("no marks here")
    page = tmp_path / "page.md"
    page.write_text(f"before\n{drawing.BEGIN}\nold\n{drawing.END}\nafter\n")
    assert drawing.main([str(page)]) == 0
    assert page.read_text() == f"before\n{drawing.document_block()}\nafter\n"


def test_events_that_nobody_takes_do_not_fill_the_memory():
    machine = Machine(SupervisorParameters.from_values({}))
    for count in range(1000):
        machine.log(Level.INFO, "a", Code.STALLED, time_s=count)
    assert machine.events[-1].fact.data == {"time_s": 999}
    assert len(machine.events) == 200


def test_only_the_first_answer_to_a_request_counts():
    request, answers = SwitchRequest("a", True, 0.0, 0, "b"), []
    request.on_done = lambda: answers.append(request.reply)
    yes = Answer.done(Code.APPLIED, controller="a")
    request.answer(yes)
    request.answer(Answer.refused(Code.OTHER_LEADS))
    assert answers == [yes]
    assert request.ok


def test_new_interlock_limits_hold_at_once():
    changes = {
        "persistence_s": 0.2,
        "temperature_high.warn": 840.0,
        "temperature_high.trip": 845.0,
    }
    safety = SafetyMonitor(Machine(SupervisorParameters()))
    values = {f"interlocks.{key}": value for key, value in changes.items()}
    safety.configure(SupervisorParameters.from_values(values))
    for _ in range(2):
        safety.watch({"temperature_c": 850.0})
    assert safety.tripped == ("temperature_high",)


@pytest.fixture
def push():
    """What pushes a drive that has followed its command for long; one move is 1."""
    push = DriveOffset()
    for _ in range(20):
        push.learn(0.0, 1.0)
    return push


def test_a_push_sets_in_at_once_and_stays(push):
    for difference in (4.0, 4.2, 3.9):
        push.learn(difference, 1.0)
    assert push.value == pytest.approx(4.0, abs=0.2)
    push.interrupt()
    assert push.value == pytest.approx(4.0, abs=0.2)


def test_spike_is_not_an_offset(push):
    for difference in (4.0, 0.0, 4.0, 4.0, 0.0):
        push.learn(difference, 1.0)
    assert push.value == 0.0


@pytest.mark.parametrize("ramp", [-0.15, -0.2, -0.9, 0.3])
@pytest.mark.parametrize("ticks", [6, 7, 8, 12, 60])
@pytest.mark.parametrize("stands", [0, 20])
def test_a_drive_that_ramps_by_itself_is_taken_over_where_it_is(push, ramp, ticks, stands):
    """A command that is refused, and a PLC that ramps down and then stands still."""
    for count in range(1, ticks + 1):
        push.learn(ramp * count, 1.0)
    for _ in range(stands):
        push.learn(ramp * ticks, 1.0)
    push.interrupt()
    assert push.value == 0.0


def test_a_drift_slower_than_any_ramp_is_a_push(push):
    for count in range(1, 101):
        push.learn(0.03 * count, 1.0)
    push.interrupt()
    assert push.value == pytest.approx(3.0)


def test_excessive_difference_is_not_an_offset(push):
    for _ in range(10):
        push.learn(-18.4, 1.0)
    push.interrupt()
    assert push.value == 0.0


def test_a_push_that_ends_is_forgotten(push):
    for difference in (4.0,) * 5 + (0.0,) * 5:
        push.learn(difference, 1.0)
    assert push.value == 0.0


def test_a_takeover_that_is_refused_is_not_repeated(push):
    for _ in range(5):
        push.learn(4.0, 1.0)
    push.interrupt()
    assert push.value == 4.0
    push.learn(None, 1.0)
    push.interrupt()
    assert push.value == 0.0
