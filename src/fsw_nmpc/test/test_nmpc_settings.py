"""Parameters: complete, checked, and changed while it runs."""

from dataclasses import fields

import pytest

import fsw_nmpc
from fsw_control import Command, Measurement, Reference
from fsw_control.parameters import load
from fsw_nmpc import kernel_build
from fsw_nmpc.configured import ConfiguredNmpc
from fsw_nmpc.estimator import EstimatorTuning
from fsw_nmpc.settings import Settings
from fsw_nmpc.tuning import PRESETS, Tuning

REST = Command(78.4, 407.576)
TARGET = Reference(2.66, 850.0)


def step(controller, reference=TARGET):
    return controller.step(Measurement(0.0, 2.66, 1052.86, 850.0), reference, REST, 0.1)


def test_every_tuning_is_a_parameter():
    specs = load("fsw_nmpc", "nmpc.yaml")
    wanted = {f.name for f in fields(Tuning)} | {"estimator." + f.name for f in fields(EstimatorTuning)}
    assert wanted <= set(specs)
    assert set(specs["preset"].options) == set(PRESETS)
    numbers = [s for s in specs.values() if s.type in ("double", "int")]
    assert all(s.range is not None for s in numbers)


def test_shipped_values_are_allowed_by_their_ranges():
    specs = load("fsw_nmpc", "nmpc.yaml")
    for name in PRESETS:
        for field in fields(Tuning):
            value = getattr(Tuning.preset(name), field.name)
            if isinstance(value, float):
                assert specs[field.name].check(value) == value
    for field in fields(EstimatorTuning):
        assert specs["estimator." + field.name].check(field.default) == field.default


def test_defaults_are_the_presets():
    assert Settings.of({}).tuning == Tuning.preset("default")
    assert Settings.of({"preset": "paper"}).tuning == Tuning.preset("paper")
    assert Settings.of({}).estimator == EstimatorTuning()


def test_single_values_override_the_preset():
    settings = Settings.of({"preset": "paper", "weight_depth_per_mm": 7.0, "estimator.torque_noise_nm": 9.0})
    assert settings.tuning.weight_depth_per_mm == 7.0
    assert settings.tuning.dead_band_depth_mm == Tuning.preset("paper").dead_band_depth_mm
    assert settings.estimator.torque_noise_nm == 9.0


@pytest.mark.parametrize(
    ("values", "word"),
    [
        ({"blocks": 21}, "blocks"),
        ({"solver": "magic"}, "solver"),
        ({"weight_depth_per_mm": 1e9}, "weight_depth_per_mm"),
        ({"weight_depth_per_mm": float("nan")}, "finite"),
        ({"force_min": 99.0}, "force_min"),
        ({"no_such": 1.0}, "no_such"),
        ({"preset": "best"}, "preset"),
    ],
)
def test_wrong_values_are_refused_with_a_word(values, word):
    with pytest.raises(ValueError, match=word):
        Settings.of(values)
    if "no_such" not in values:
        assert word in ConfiguredNmpc().check(values)


def test_wrong_model_file(tmp_path):
    with pytest.raises((ValueError, OSError)):
        ConfiguredNmpc({"model": str(tmp_path / "none.yaml")})


def test_public_name():
    assert fsw_nmpc.NmpcController is ConfiguredNmpc


def test_runtime_change_of_everything_without_a_bump():
    said = []
    controller = ConfiguredNmpc(log=said.append)
    for _ in range(10):
        step(controller)
    for values in (
        {"preset": "paper"},
        {"blocks": 54},
        {"solver": "casadi", "blocks": 20},
        {"estimator.torque_noise_nm": 20.0, "weight_temperature_per_c": 3.0},
        {"preset": "default", "solver": "auto", "corridor": "continuing"},
    ):
        assert controller.check(values) is None
        controller.configure(values)
        during = step(controller)
        controller.finish_changes()
        after = [step(controller) for _ in range(5)][-1]
        for proposal in (during, after):
            assert proposal.healthy
            assert abs(proposal.command.force_kn - REST.force_kn) < 0.05
            assert abs(proposal.command.speed_rpm - REST.speed_rpm) < 0.3
    assert len(said) == 4  # one at the start, one for each change of the solver
    assert said[2].startswith("solver: casadi")


def test_limits_act_at_once():
    controller = ConfiguredNmpc()
    step(controller)
    controller.configure({"force_step": 0.01})
    proposal = step(controller, Reference(2.9, 850.0))
    assert abs(proposal.command.force_kn - REST.force_kn) <= 0.01 + 1e-9


def test_without_a_compiler_the_fallback_takes_over(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(kernel_build, "find", lambda: None)
    monkeypatch.setattr(kernel_build, "compiler", lambda: None)
    said = []
    controller = ConfiguredNmpc(log=said.append)
    assert "casadi" in said[0]
    assert "compiler" in said[0]
    assert step(controller).healthy
    assert "compiler" in controller.check({"solver": "rti"})
    with pytest.raises(ValueError, match="rti"):
        ConfiguredNmpc({"solver": "rti"})


def test_a_compiler_that_fails_is_no_failure(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(kernel_build, "find", lambda: None)
    monkeypatch.setattr(kernel_build, "compiler", lambda: ["false"])
    said = []
    assert step(ConfiguredNmpc(log=said.append)).healthy
    assert "did not compile" in said[0]


def test_kernel_is_built_once_into_the_users_cache(monkeypatch, tmp_path):
    if kernel_build.compiler() is None:
        pytest.skip("no C compiler")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    built = kernel_build.build()
    assert built.is_relative_to(tmp_path)
    assert kernel_build.is_usable(built)
    assert kernel_build.find() == built
    (tmp_path / "broken.so").write_bytes(b"no library")
    assert not kernel_build.is_usable(tmp_path / "broken.so")
