"""The welding procedure: what is refused, and where the shipped one has its figures from."""

from datetime import date
from pathlib import Path
from typing import Any

import pytest
import yaml

from fsw_analysis.procedure import Procedure
from fsw_control import weld
from fsw_control.parameters import defaults
from fsw_control.schema.models import InputError
from fsw_scenario import procedure
from fsw_supervisor.parameters import SupervisorParameters


def content() -> dict[str, Any]:
    values: dict[str, Any] = procedure.load("copper_lid").model_dump(
        mode="json", exclude_none=True
    )
    return values


def written(folder: Path, values: dict[str, Any]) -> Path:
    file = folder / "procedure.yaml"
    file.write_text(yaml.safe_dump(values, sort_keys=False), encoding="utf-8")
    return file


@pytest.mark.parametrize(
    ("path", "value", "problem", "fact"),
    [
        ("essential.0.min", 920.0, ("essential[0]", "value_error"), "min 920"),
        ("essential.0.max", 890.0, ("essential[0]", "problem"), "800 to 900"),
        ("essential.0.phases", ["lid"], ("essential[0]", "problem"), "phase lid,"),
        ("essential.0.variable", "colour", ("essential[0].variable", "literal_error"), ""),
        ("set_points.depth_mm.value", 9.0, ("set_points.depth_mm", "value_error"), "value 9"),
        ("set_points.depth_mm.max", 5.0, ("set_points.depth_mm.max", "problem"), "1.5 to 4 mm"),
        ("phases.2.to_deg", 5.0, ("phases", "problem"), "to_deg"),
        ("phases.1.name", "dwell", ("phases", "problem"), "dwell twice"),
        (
            "controllers.0.parameters_sha256",
            "abc",
            ("controllers[0].parameters_sha256", "value_error"),
            "SHA-256",
        ),
        (
            "sensors.0.calibration_due",
            "tomorrow",
            ("sensors[0].calibration_due", "date_from_datetime_parsing"),
            "'tomorrow'",
        ),
        ("quality.0.min", 0.05, ("quality[0]", "problem"), "error 0,"),
        ("sensors.0.name", "smell", ("sensors[0].name", "value_error"), "known: depth"),
        ("revison", "B", ("revison", "extra_forbidden"), "revision?"),
        ("format", "other", ("format", "literal_error"), ""),
    ],
)
def test_impossible_procedure_is_refused_in_one_line(
    tmp_path: Path, path: str, value: object, problem: tuple[str, str], fact: str
) -> None:
    values = content()
    *steps, last = path.split(".")
    inside: Any = values
    for step in steps:
        inside = inside[int(step)] if step.isdecimal() else inside[step]
    inside[last] = value
    with pytest.raises(InputError) as refused:
        procedure.load(written(tmp_path, values))
    assert refused.value.problems == (problem,)
    text = str(refused.value)
    assert fact in text and "procedure.yaml" in text and "\n" not in text


def test_hash_depends_on_content_not_on_order(tmp_path: Path) -> None:
    shipped, values = procedure.load("copper_lid"), content()
    assert (
        procedure.load(written(tmp_path, dict(reversed(values.items())))).sha256 == shipped.sha256
    )
    values["essential"][0]["max"] += 1e-9
    assert procedure.load(written(tmp_path, values)).sha256 != shipped.sha256


def test_date_without_quotes_is_accepted(tmp_path: Path) -> None:
    values = content()
    values["date"] = date.fromisoformat(values["date"])
    assert (
        procedure.load(written(tmp_path, values)).identity == procedure.load("copper_lid").identity
    )


def test_differences_name_what_changed() -> None:
    old, values = procedure.load("copper_lid"), content()
    values["essential"][0]["max"] = 905.0
    values["sensors"].pop(0)
    new = Procedure.model_validate(values)
    assert procedure.differences(old, new) == [
        ("essential[temperature_c].max", "910", "905"),
        ("sensors[depth].name", "depth", "-"),
    ]
    assert procedure.differences(old, old) == []


def test_limits_of_the_shipped_procedure_match_the_defaults() -> None:
    shipped = procedure.load("copper_lid")
    limits = {limit.variable: limit for _, limit in shipped.limits()}
    interlocks = defaults(SupervisorParameters)
    temperature = limits["temperature_c"]
    assert (temperature.min, temperature.max) == (
        weld.QUALITY_TEMPERATURE_MIN_C,
        weld.QUALITY_TEMPERATURE_MAX_C,
    )
    for variable in ("depth_mm", "force_kn", "torque_nm", "power_kw"):
        name = f"interlocks.{variable.partition('_')[0]}_high.trip"
        assert limits[variable].max == interlocks[name], variable
    assert (limits["speed_rpm"].min, limits["speed_rpm"].max) == (
        weld.SPEED_MIN_RPM,
        weld.SPEED_MAX_RPM,
    )
    assert limits["force_kn"].min == weld.FORCE_MIN_KN
    assert limits["depth_error_mm"].max == weld.QUALITY_DEPTH_MM
    points = shipped.set_points
    assert (points.depth_mm.value, points.temperature_c.value) == (
        weld.DEPTH_MM,
        weld.TEMPERATURE_C,
    )
    assert points.depth_mm.max == interlocks["interlocks.depth_high.warn"]
    assert points.temperature_c.min == interlocks["interlocks.temperature_low.warn"]
    assert points.temperature_c.max == interlocks["interlocks.temperature_high.warn"]
    assert shipped.acceptance.tolerated_s == interlocks["validity.hold"]
    assert shipped.acceptance.tolerated_s == pytest.approx(interlocks["interlocks.persistence_s"])
