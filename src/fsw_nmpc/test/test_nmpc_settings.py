"""Parameters, knobs and tuning files: complete, checked, and changed while it runs."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from fsw_control import Command, Measurement, Reference
from fsw_control.parameters import describe
from fsw_control.schema.models import InputError
from fsw_model import MachineData, nominal
from fsw_nmpc import NmpcController
from fsw_nmpc.parameters import NmpcParameters
from fsw_nmpc.tuning import PAPER, TRAJECTORIES, Settings, Tuning

REST = Command(78.4, 407.576)
TARGET = Reference(2.66, 816.4)


def step(controller, reference=TARGET):
    return controller.step(Measurement(0.0, 2.66, 1052.86, 816.4), reference, REST, 0.1)


def test_paper_preset_has_the_numbers_of_the_paper():
    """(32)-(37) and the text of section IV."""
    assert (PAPER.weight_depth_per_mm, PAPER.weight_temperature_per_c) == (100.0, 1.0)
    assert (PAPER.move_force_per_kn, PAPER.move_speed_per_rpm) == (1.0, 0.01)
    assert (PAPER.depth_time_s, PAPER.temperature_time_s) == (5.0, 5.0)
    assert (PAPER.dead_band_depth_mm, PAPER.dead_band_temperature_c) == (0.002, 0.1)
    assert (PAPER.depth_scale_mm, PAPER.temperature_scale_c, PAPER.full_move_cost) == (
        0.0,
        0.0,
        0.0,
    )
    limits = Settings.of({"preset": "paper"}).limits
    assert (limits.force_step_kn, limits.speed_step_rpm) == (1.0, 3.0)


def test_presets():
    assert Settings.of({}).tuning == Tuning.preset("default", nominal())
    assert Settings.of({"preset": "paper"}).tuning == PAPER
    slower = nominal().changed(dead_time_s=4.0)
    assert Tuning.preset("default", slower).temperature_time_s == pytest.approx(0.3 * 4.0)


def test_tuning_file_over_a_preset(tmp_path):
    file = tmp_path / "tuning.yaml"
    file.write_text(
        "weight_depth_per_mm: 7\nestimator: {torque_noise_nm: 9.0}\ntrajectory: constant\n"
    )
    tuning = Settings.of({"preset": "paper", "tuning_file": str(file)}).tuning
    assert (tuning.weight_depth_per_mm, tuning.estimator.torque_noise_nm, tuning.trajectory) == (
        7,
        9.0,
        "constant",
    )
    assert tuning.dead_band_depth_mm == PAPER.dead_band_depth_mm
    assert set(TRAJECTORIES) == {
        "approach",
        "constant",
        "cold_start",
        "recentred",
        "recentred_ahead",
    }


@pytest.mark.parametrize(
    ("text", "problem", "fact"),
    [
        ("[1]", ("", "model_type"), "[1]"),
        ("a: b: c", None, "valid YAML"),
        (
            "weight_depht_per_mm: 1",
            ("weight_depht_per_mm", "extra_forbidden"),
            "weight_depth_per_mm? known: trajectory, depth_time_s",
        ),
        ("estimator: {noise: 1}", ("estimator.noise", "extra_forbidden"), "known: depth_noise_mm"),
        ("estimator: 3", ("estimator", "model_type"), ""),
        ("depth_time_s: .nan", ("depth_time_s", "finite_number"), ""),
        ("depth_time_s: fast", ("depth_time_s", "float_type"), "'fast'"),
        ("depth_time_s: 0.1", ("depth_time_s", "problem"), "0.2 s"),
        ("blocks: 21", ("blocks", "literal_error"), "20 or 54"),
        ("trajectory: shortest", ("trajectory", "literal_error"), "'approach', 'constant'"),
        ("estimator: {heat_sigmas: 5}", ("estimator.heat_sigmas", "extra_forbidden"), "known:"),
    ],
)
def test_wrong_tuning_files_are_one_clear_line(tmp_path, text, problem, fact):
    file = tmp_path / "tuning.yaml"
    file.write_text(text)
    with pytest.raises(InputError) as caught:
        Settings.of({"tuning_file": str(file)})
    assert caught.value.problems == (() if problem is None else (problem,))
    assert fact in str(caught.value) and "\n" not in str(caught.value)


def test_missing_files():
    with pytest.raises(ValueError, match="tuning_file /nowhere"):
        Settings.of({"tuning_file": "/nowhere"})
    with pytest.raises(ValueError, match="model /nowhere"):
        Settings.of({"model_file": "/nowhere"})


@pytest.mark.parametrize(
    ("values", "word"),
    [
        ({"calmness": 1e9}, "calmness"),
        ({"calmness": float("nan")}, "calmness"),
        ({"force_min": 99.0}, "force_min"),
        ({"no_such": 1.0}, "no_such"),
        ({"preset": "best"}, "preset"),
    ],
)
def test_wrong_values_are_refused_by_name(values, word):
    with pytest.raises(ValueError, match=word):
        Settings.of(values)
    assert word in NmpcController().check(values)


def test_all_numbers_have_a_range():
    assert all(
        s.range is not None
        for s in describe(NmpcParameters).values()
        if s.type in ("double", "int")
    )


@pytest.mark.parametrize(
    "knob", ["depth_aggressiveness", "temperature_aggressiveness", "calmness"]
)
def test_knob_of_1_is_neutral_and_another_changes_the_tuning(knob):
    assert Tuning().with_knobs(**{knob: 1.0}) == Tuning()
    assert Tuning().with_knobs(**{knob: 2.0}) != Tuning()
    assert PAPER.with_knobs(**{knob: 2.0}) != PAPER


@pytest.mark.slow
@pytest.mark.full
def test_runtime_change_of_everything_without_a_bump():
    messages = []
    controller = NmpcController()
    controller.use_logger(SimpleNamespace(info=messages.append, error=None))
    for _ in range(10):
        step(controller)
    for values in (
        {"preset": "paper"},
        {"calmness": 2.0, "depth_aggressiveness": 0.5, "priority": "temperature"},
        {"preset": "default"},
    ):
        assert controller.check(values) is None
        controller.configure(values)
        during = step(controller)
        controller.finish_changes()
        after = [step(controller) for _ in range(5)][-1]
        for proposal in (during, after):
            assert proposal.healthy, proposal.reason
            assert abs(proposal.command.force_kn - REST.force_kn) < 0.05
            assert abs(proposal.command.speed_rpm - REST.speed_rpm) < 0.3
    assert [text.split(", library")[0] for text in messages] == [
        "solver: rti, 20 blocks", "solver: rti, 54 blocks", "solver: rti, 20 blocks",
    ]  # fmt: skip


def test_limits_act_at_once():
    controller = NmpcController()
    step(controller)
    controller.configure({"force_step": 0.01})
    proposal = step(controller, Reference(2.9, 816.4))
    assert abs(proposal.command.force_kn - REST.force_kn) <= 0.01 + 1e-9


def test_machine_file(tmp_path):
    """Noisier sensors and slower drives count; quieter and faster ones change nothing."""
    file, tuning = tmp_path / "machine.yaml", tmp_path / "tuning.yaml"
    worse = MachineData(temperature_noise_c=0.4, force_rate_kn_per_s=2.5)
    file.write_text(worse.text)
    assert MachineData.from_file(file) == worse
    default, made = Settings.of({}), Settings.of({"machine_file": str(file)})
    expected = default.tuning.estimator.changed(temperature_noise_c=0.4)
    assert made.tuning == default.tuning.changed(estimator=expected)
    assert made.limits == replace(default.limits, force_step_kn=0.25)
    tuning.write_text("estimator: {temperature_noise_c: 0.2}\n")
    own = Settings.of({"machine_file": str(file), "tuning_file": str(tuning)})
    assert own.tuning.estimator.temperature_noise_c == 0.2
    file.write_text(MachineData(depth_noise_mm=1e-6, speed_rate_rpm_per_s=1e3).text)
    better = Settings.of({"machine_file": str(file)})
    assert (better.tuning, better.limits) == (default.tuning, default.limits)
