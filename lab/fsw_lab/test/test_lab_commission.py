"""``fsw.py commission``: its course, and what its steps are judged by."""

import signal
from contextlib import contextmanager
from dataclasses import replace
from math import inf, nan
from types import SimpleNamespace

import numpy as np
import pytest
import yaml

from fsw.errors import CommandError
from fsw.main import main
from fsw_control.cause import Severity
from fsw_control.schema.models import InputError
from fsw_lab import commission, commission_ros
from fsw_lab.commissioning import (
    STEPS,
    Course,
    Guard,
    Heard,
    Outcome,
    Row,
    Session,
    accept_rows,
    check_experiment,
    check_rows,
    identify_rows,
    margin_rows,
    outcome_of,
)
from fsw_model import MachineData, ModelParameters
from fsw_scenario import scenario_file
from fsw_scenario.closed_loop import ClosedLoop

BAD = Row(what="noise", value="1", limit="0", good=False)


class Script:
    """A session with answers given in advance; ``failing``: steps that fail once."""

    def __init__(self, *answers, failing=(), course=None):
        self.answers, self.carried, self.said, self.saved = list(answers), [], [], []
        self.failing = list(failing)
        steps = {name: lambda name=name: self._carry(name) for name in STEPS}
        self.session = Session(
            course or Course(),
            steps,
            lambda _: self.answers.pop(0),
            self.said.append,
            self.saved.append,
            (CommandError,),
        )

    def _carry(self, name):
        self.carried.append(name)
        if name in self.failing:
            self.failing.remove(name)
            raise CommandError("no graph\nthere")
        return outcome_of([], "now")

    def verdicts(self):
        return [self.session.course.of(name).verdict for name in STEPS]


def test_all_steps_with_yes():
    script = Script(*["yes"] * 6)
    assert script.session.run()
    assert (
        script.carried == list(STEPS)
        and script.verdicts() == ["done"] * 6
        and script.saved[-1].next is None
    )


def test_nothing_is_carried_out_without_a_yes():
    script = Script("", "what", "quit")
    assert not script.session.run()
    assert script.carried == [] and script.verdicts() == ["open"] * 6


def test_a_step_is_refused_and_nothing_after_it_is_done():
    script = Script("yes", "no")
    assert not script.session.run()
    assert script.carried == ["check"] and script.verdicts()[:3] == ["done", "refused", "open"]


def test_commissioning_resumes_where_it_was_left():
    script = Script("y", "quit")
    script.session.run()
    again = Script(*["y"] * 5, course=script.saved[-1])
    assert again.session.run() and again.carried == list(STEPS)[1:]


def test_an_earlier_step_is_repeated_with_all_after_it():
    script = Script("y", "y", "check", *["y"] * 6)
    assert script.session.run()
    assert script.carried == ["check", "experiment", *STEPS]


def test_a_failure_is_said_in_one_line_and_the_step_may_be_repeated():
    script = Script("y", *["y"] * 6, failing=["check"])
    assert script.session.run()
    assert script.carried == ["check", *STEPS]
    assert any("check: failed," in line for line in script.said)
    script = Script("y", failing=["check"])
    assert not script.session.run(once=True)
    assert script.verdicts()[0] == "failed"


def test_a_bad_row_fails_its_step():
    assert outcome_of([BAD], "now").verdict == "failed"
    course = Course().after("check", outcome_of([BAD], "now"))
    assert course.next == "check"
    assert (
        Course.model_validate(yaml.safe_load(yaml.safe_dump(course.model_dump(mode="json"))))
        == course
    )


def heard(**changes):
    noise = np.random.default_rng(1).normal(size=(3, 100))
    values = dict(
        time_s=np.arange(100) * 0.1,
        depth_mm=2.66 + 2e-3 * noise[0],
        torque_nm=1050.0 + 2.0 * noise[1],
        temperature_c=816.4 + 0.1 * noise[2],
        force_kn=np.zeros(100),
        speed_rpm=np.zeros(100),
        reference=(2.66, 816.4),
        mode="auto",
        controller="decentral",
        ready=["decentral", "nmpc"],
        interlocks={},
        held=["start-up"],
    )
    return Heard(**(values | changes))


def test_a_graph_at_rest_passes_the_check():
    rows = check_rows(heard(), ["decentral"])
    assert all(row.good for row in rows), rows


@pytest.mark.parametrize(
    ("what", "changes"),
    [
        ("mode", {"mode": "hold"}),
        ("controllers", {"ready": ["nmpc"]}),
        ("interlocks", {"interlocks": {"temperature_high": Severity.WARN}}),
        ("tick", {"time_s": np.arange(100) * 0.2}),
        ("samples lost", {"time_s": np.r_[np.arange(50) * 0.1, 10.0 + np.arange(50) * 0.1]}),
        ("noise, depth", {"depth_mm": np.full(100, 2.66)}),
        (
            "noise, temperature",
            {"temperature_c": 816.4 + 5.0 * np.random.default_rng(2).normal(size=100)},
        ),
        ("noise, torque", {"torque_nm": np.full(100, nan)}),
        ("commanded by a controller", {"held": ["the arbiter was stalled"] * 2}),
        ("set-points", {"reference": None}),
        ("set-points", {"reference": (2.7, 816.4)}),
        ("depth, off", {"depth_mm": heard().depth_mm + 0.05}),
        ("temperature, off", {"temperature_c": heard().temperature_c - 4.0}),
        ("force, off its command", {"force_kn": np.full(100, -1.5)}),
        ("speed, off its command", {"speed_rpm": np.full(100, 4.0)}),
    ],
)
def test_wrong_state_of_the_graph_fails_the_check(what, changes):
    assert what in [
        row.what for row in check_rows(heard(**changes), ["decentral"]) if not row.good
    ]


def test_the_guard_ends_by_three_samples_outside_not_by_a_spike():
    guard = Guard()
    assert [guard.take("depth", value) for value in (2.9, 2.9, 2.66, 2.4, nan)] == [""] * 5
    why = guard.take("depth", 2.9)
    assert why.startswith("depth 2.9 mm ") and "0.15 mm" in why and why.endswith(" 2.66 mm")
    assert [bool(guard.take("temperature", 830.0)) for _ in range(3)] == [False, False, True]


def test_an_experiment_steps_set_points_within_bounds():
    for name in ("identify_closed_loop", "acceptance"):
        check_experiment(scenario_file.load(name))
    for name, words in (
        ("identify_open_loop", "no commands"),
        ("output_disturbances", "no step"),
        ("reference_tracking", r"than 0\.15 mm"),
        ("canister_weld", "no phases"),
    ):
        with pytest.raises(InputError, match=words):
            check_experiment(scenario_file.load(name))


def test_uncertain_model_fails_its_identification():
    parameters = ModelParameters()
    known = {name: 0.02 * abs(value) for name, value in dict(parameters).items()}
    assert all(row.good for row in identify_rows(parameters, known))
    del known["dead_time_s"]
    assert [row.what for row in identify_rows(parameters, known) if not row.good] == [
        "dead_time_s"
    ]


def test_a_model_that_tuning_cannot_try_fails_its_identification():
    strange = ModelParameters().changed(depth_zero_s=1.65)
    [row] = [row for row in identify_rows(strange, {}) if row.what == "depth_zero_s"]
    assert not row.good and row.value.startswith("0.056 ") and row.limit.startswith("0.1 to 10; ")


def test_the_nmpc_has_the_margins_of_the_tight_tuning():
    least = {
        "depth_gain": inf,
        "temperature_gain": 2.70,
        "depth_delay_s": 1.1,
        "temperature_delay_s": 6.2,
    }
    measured = {
        "depth_gain": inf,
        "temperature_gain": 2.65,
        "depth_delay_s": 1.8,
        "temperature_delay_s": 5.7,
    }
    rows = margin_rows(measured, least, ModelParameters())
    assert [row.good for row in rows] == [True, True, True, False]
    assert rows[3].what.startswith("nmpc: ") and "temperature, delay" in rows[3].what
    assert rows[3].value == "5.7 s"
    assert "> 8" in rows[0].limit and "decentral:tight" in rows[0].limit


def test_acceptance_is_measured_against_what_the_model_predicts():
    predicted = {"iae_depth_mm_s": 1.0, "iae_temperature_c_s": 100.0}
    commands = [("nmpc", "")] * 99 + [("hold", "stalled")]
    good = accept_rows(
        {"iae_depth_mm_s": 1.3, "iae_temperature_c_s": 90.0}, predicted, commands, "nmpc"
    )
    assert good[0].value == "99.0 %, stalled"
    assert len(good) == 3 and all(row.good for row in good)
    bad = accept_rows(
        {"iae_depth_mm_s": 1.4, "iae_temperature_c_s": None}, predicted, commands, "decentral"
    )
    assert not any(row.good for row in bad)


def test_acceptance_is_cut_out_of_its_bag():
    scenario = scenario_file.load(
        "acceptance", ["duration_s=4", "events=[{at_s: 1.0, reference: {depth_mm: 2.7}}]"]
    )
    weld = ClosedLoop(
        scenario_file.parse("{name: rest, duration_s: 8.0, controller: none}", "rest")
    ).run()
    depth = np.where(np.arange(80) < 30, 2.66, 2.7)
    still = np.full(80, 816.4)
    cut = commission.cut(
        replace(weld, reference_depth_mm=depth, reference_temperature_c=still), scenario
    )
    assert (cut.n_ticks, cut.reference_depth_mm[9], cut.reference_depth_mm[10]) == (40, 2.66, 2.7)
    with pytest.raises(InputError, match="do not change"):
        commission.cut(
            replace(weld, reference_depth_mm=still, reference_temperature_c=still), scenario
        )


def test_the_experiment_returns_to_the_operating_point(tmp_path):
    class Arguments:
        out, experiment, controller = tmp_path, "identify_closed_loop", "decentral"

    made = commission.Work(Arguments).scenario("experiment")
    assert (made.duration_s, made.events[-1].at_s) == (330.0, 300.0)
    assert (made.events[-1].reference.depth_mm, made.events[-1].reference.temperature_c) == (
        2.66,
        816.4,
    )


def test_the_nmpc_gets_what_the_experiment_shows_of_the_machine(tmp_path, monkeypatch):
    class Arguments:
        out, controller, tuning, drive_lag, evaluations = tmp_path, "nmpc", "", 0.1, 1

    rest = ClosedLoop(
        scenario_file.parse("{name: rest, duration_s: 1.0, controller: none}", "rest")
    ).run()
    seen = MachineData(temperature_noise_c=0.4, speed_rate_rpm_per_s=10.0)
    identified = SimpleNamespace(text="{}\n", machine=seen, parameters=ModelParameters(), std={})
    margins = dict.fromkeys(("depth_gain", "temperature_gain"), 2.0)
    margins |= dict.fromkeys(("depth_delay_s", "temperature_delay_s"), 6.0)
    loops = SimpleNamespace(margins=lambda: margins, has=lambda *_: True)
    monkeypatch.setattr(commission, "read_weld", lambda bag: rest)
    monkeypatch.setattr(commission.fsw, "identify", lambda *_, **__: identified)
    monkeypatch.setattr(commission.report, "write", lambda *_: None)
    monkeypatch.setattr(commission.summary, "remarks", lambda _: [])
    monkeypatch.setattr("fsw_lab.tune_command.margins.Loops", lambda *_: loops)
    (tmp_path / "experiment_1").mkdir()
    (tmp_path / "experiment_1" / "data.mcap").touch()
    work = commission.Work(Arguments)
    work.identify()
    work.tune()
    tuning = (tmp_path / "tuned" / "decentral_conservative.yaml").read_text()
    assert tuning.startswith("# Origin: model.yaml, SHA-256 ")
    content = yaml.safe_load((tmp_path / "tuned" / "nmpc.yaml").read_text())
    parameters = content["fsw_nmpc"]["ros__parameters"]
    assert MachineData.from_file(parameters["machine_file"]) == seen
    has = dict(parameters)
    monkeypatch.setattr(commission_ros, "parameter", lambda _, node, name: has[name])
    assert work.apply().verdict == "done"
    has["machine_file"] = ""
    with pytest.raises(CommandError, match="machine_file"):
        work.apply()


def test_left_without_an_answer_and_reported(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("builtins.input", lambda _: (_ for _ in ()).throw(EOFError))
    out = tmp_path / "out"
    assert main(["commission", "--out", str(out)]) == 1
    assert "left at check" in capsys.readouterr().out
    assert "## 1. check: open" in (out / "report.md").read_text()
    (out / "commission.yaml").write_text("outcomes: {check: {verdict: perhaps}}")
    assert main(["commission", "--out", str(out)]) == 1
    assert "verdict" in capsys.readouterr().err
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "notes.txt").touch()
    assert main(["commission", "--out", str(tmp_path / "other")]) == 1
    assert "not empty" in capsys.readouterr().err


def test_the_report_has_every_step_with_what_failed(tmp_path):
    class Arguments:
        out, controller = tmp_path, "decentral"

    commission.Work(Arguments).save(Course().after("check", outcome_of([BAD], "now", "a note")))
    text = (tmp_path / "report.md").read_text()
    assert (
        "## 1. check: failed" in text
        and "| noise | 1 | 0 | not met |" in text
        and "## 6. accept: open" in text
    )
    assert Outcome().verdict == "open"


def test_neither_ctrl_c_nor_sigterm_keeps_a_weld_from_being_aborted(monkeypatch):
    asked = []

    @contextmanager
    def operator(arguments):
        asked.append(arguments)
        if len(asked) == 1:
            raise KeyboardInterrupt
        yield None

    def aborted(node):
        for sign in (signal.SIGTERM, signal.SIGINT):
            signal.raise_signal(sign)
        return "the weld was aborted"

    monkeypatch.setattr(commission_ros, "operator", operator)
    monkeypatch.setattr(commission_ros, "aborted", aborted)
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt, match="was aborted"):
            commission_ros.welded(None, "", None, None)
        assert signal.getsignal(signal.SIGTERM) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGTERM, before)


def test_a_weld_is_cancelled_once_more_where_the_request_came_before_its_goal(monkeypatch):
    answers = [False, True]
    monkeypatch.setattr(commission_ros, "abort", lambda _: answers.pop(0))
    assert "was aborted" in commission_ros.aborted(None)
    answers = [False, False]
    assert "no weld" in commission_ros.aborted(None)

    def no_answer(_):
        raise CommandError("no answer")

    monkeypatch.setattr(commission_ros, "abort", no_answer)
    assert commission_ros.aborted(None).startswith("no answer; ")
