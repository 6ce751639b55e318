"""Parameters: YAML, validation, error messages."""

from dataclasses import asdict, fields

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fsw_model import ModelParameters, ParameterError, ProcessModel, nominal
from fsw_model.parameters import ORIGIN

NAMES = [field.name for field in fields(ModelParameters)]


def test_every_parameter_tells_its_origin():
    assert list(ORIGIN) == NAMES
    assert all(text.split(":")[0].split()[0] in ("published", "identified", "chosen") for text in ORIGIN.values())


def test_every_parameter_is_documented():
    assert [name for name in NAMES if name not in (ModelParameters.__doc__ or "")] == []


@given(st.dictionaries(st.sampled_from(NAMES), st.floats(0.9, 1.1), max_size=5))
def test_yaml_round_trip(factors):
    parameters = nominal().scaled(**factors)
    assert ModelParameters.from_yaml(parameters.to_yaml()) == parameters


def test_some_parameters_over_the_nominal_ones(tmp_path):
    path = tmp_path / "some.yaml"
    path.write_text("thermal_time_s: 70\nsticking_stress_pa: 1e5\nspindle_inertia_kgm2: 2.5E0\n")
    parameters = ModelParameters.from_file(path)
    changed = {"thermal_time_s": 70.0, "sticking_stress_pa": 1e5, "spindle_inertia_kgm2": 2.5}
    assert asdict(parameters) == asdict(nominal()) | changed
    assert ModelParameters.from_yaml("") == nominal()


@pytest.mark.parametrize(
    "text, words",
    [
        ("[1, 2]", "expected a mapping"),
        ("a: b: c", "not valid YAML"),
        ("thermal_tim_s: 70", "unknown model parameter thermal_tim_s"),
        ("thermal_time_s: slow", "'thermal_time_s' is 'slow': give a finite number"),
        ("thermal_time_s: true", "give a finite number"),
        ("thermal_time_s: .nan", "give a finite number"),
        ("thermal_time_s: nan", "give a finite number"),
        ("thermal_time_s: 0", "must be > 0"),
        ("bearing_torque_nm: -1", "must be >= 0"),
        ("depth_pole_slow_s: 1.0e-4", "must be larger than 'depth_pole_fast_s'"),
        ("contact_inner_radius_m: 0.04", "would not touch"),
    ],
)
def test_wrong_yaml_is_one_clear_error(text, words):
    with pytest.raises(ParameterError) as caught:
        ModelParameters.from_yaml(text, "my.yaml")
    message = str(caught.value)
    assert message.startswith("my.yaml: ") and words in message and "\n" not in message


def test_unknown_names_in_code():
    with pytest.raises(ParameterError, match=r"scaled\(\): unknown model parameter depth"):
        nominal().scaled(depth=2.0)
    with pytest.raises(ParameterError, match=r"with_values\(\)"):
        nominal().with_values(depth=2.0)


@pytest.mark.parametrize("dead_time_s", [0.04, 2.85])
def test_dead_time_must_be_whole_steps(dead_time_s):
    with pytest.raises(ParameterError, match=r"whole number of 0\.1 s steps"):
        ProcessModel(nominal().with_values(dead_time_s=dead_time_s))
