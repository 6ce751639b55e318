"""Parameters: YAML, validation, error messages."""

import pytest
import yaml

from fsw_control.schema.models import InputError
from fsw_model import ModelParameters, nominal

ORIGIN = {name: field.description or "" for name, field in ModelParameters.model_fields.items()}
NAMES = list(ORIGIN)


def test_every_parameter_has_a_source():
    assert all(
        text.startswith("paper (") or text.startswith("chosen: ") for text in ORIGIN.values()
    )


def test_coefficients_are_those_of_the_paper():
    """Typed from the text of (15)-(23) and (27), in the order of the parameters."""
    paper = [
        78.4,
        2.66,
        816.4,
        43.6,
        18.1,
        30.5,
        1.2,
        2.8,
        0.0016,
        29.6,
        14.7,
        0.00095,
        0.27,
        152800.0,
        0.435,
    ]
    paper += [0.015, 20 / 3, 2.3e-5, 2.408, 243.11, -1.305, 0.001927, 0.0021]
    shipped = dict(nominal())
    assert [shipped[name] for name in NAMES if ORIGIN[name].startswith("paper")] == paper


def test_every_parameter_is_documented():
    assert [name for name in NAMES if name not in (ModelParameters.__doc__ or "")] == []


def test_all_parameters_from_yaml():
    parameters = nominal().scaled(**dict.fromkeys(NAMES, 1.05))
    assert ModelParameters.from_yaml(yaml.safe_dump(dict(parameters))) == parameters


def test_some_parameters_over_the_nominal_ones(tmp_path):
    path = tmp_path / "some.yaml"
    path.write_text("copper_lag_s: 70\nsticking_stress_pa: 1e5\nspindle_inertia_kgm2: 2.5E0\n")
    parameters = ModelParameters.from_file(path)
    changed = {"copper_lag_s": 70.0, "sticking_stress_pa": 1e5, "spindle_inertia_kgm2": 2.5}
    assert dict(parameters) == dict(nominal()) | changed


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "no parameters"),
        (b"# nothing\n", "no parameters"),
        (b"\x89PNG\xff\xfe", "UTF-8"),
        (b"\x00\x01", "valid YAML"),
    ],
)
def test_invalid_model_file_is_rejected(tmp_path, content, words):
    path = tmp_path / "model.yaml"
    path.write_bytes(content)
    with pytest.raises(InputError, match=words):
        ModelParameters.from_file(path)
    with pytest.raises(InputError, match="cannot read model"):
        ModelParameters.from_file(tmp_path)


@pytest.mark.parametrize(
    ("text", "problem", "fact"),
    [
        ("[1, 2]", ("", "model_type"), ""),
        ("a: b: c", None, "valid YAML"),
        ("coper_lag_s: 70", ("coper_lag_s", "extra_forbidden"), "copper_lag_s?"),
        ("copper_lag_s: slow", ("copper_lag_s", "float_type"), "'slow'"),
        ("copper_lag_s: true", ("copper_lag_s", "float_type"), ""),
        ("copper_lag_s: .nan", ("copper_lag_s", "finite_number"), ""),
        ("copper_lag_s: nan", ("copper_lag_s", "float_type"), ""),
        (f"copper_lag_s: {10**400}", ("copper_lag_s", "float_type"), ""),
        ("copper_lag_s: 2026-13-45", None, "valid YAML"),
        ("[" * 2000, None, "valid YAML"),
        ("copper_lag_s: 0", ("copper_lag_s", "greater_than"), "than 0"),
        ("spindle_inertia_kgm2: -1", ("spindle_inertia_kgm2", "greater_than_equal"), "to 0"),
        ("depth_pole_slow_s: 1.0e-4", ("depth_pole_slow_s", "problem"), "depth_pole_fast_s"),
        ("dead_time_s: 0.04", ("dead_time_s", "outside"), "0.1 to 10 s"),
        ("dead_time_s: 10.1", ("dead_time_s", "outside"), "0.1 to 10 s"),
        ("depth_pole_fast_s: 0.1", ("depth_pole_fast_s", "outside"), "1e-06 to 0.005 s"),
    ],
)
def test_wrong_yaml_is_one_clear_error(text, problem, fact):
    with pytest.raises(InputError) as caught:
        ModelParameters.from_yaml(text, "my.yaml")
    assert caught.value.problems == (() if problem is None else (problem,))
    message = str(caught.value)
    assert message.startswith("my.yaml") and fact in message and "\n" not in message


def test_unknown_names_in_code():
    with pytest.raises(InputError, match=r"depth .*unknown key"):
        nominal().scaled(depth=2.0)
