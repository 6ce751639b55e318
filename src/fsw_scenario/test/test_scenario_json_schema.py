"""The JSON Schema of scenarios, as an editor uses it."""

import re
from collections.abc import Iterator
from typing import Any

import pytest
import yaml

from fsw_control.schema.models import json_schema
from fsw_scenario import scenario_file
from fsw_scenario.scenario import Scenario

SCHEMA = json_schema(Scenario)
TYPES = {
    "object": dict,
    "array": list,
    "string": str,
    "number": (int, float),
    "integer": int,
    "boolean": bool,
}


def problems(value: Any, schema: dict[str, Any]) -> Iterator[str]:
    """What does not fit, as far as a JSON Schema says so with the keywords that ours has."""
    if "$ref" in schema:
        schema = SCHEMA["$defs"][schema["$ref"].rpartition("/")[2]]
    kind = schema.get("type")
    if kind and (
        not isinstance(value, TYPES[kind]) or (isinstance(value, bool) and kind != "boolean")
    ):
        yield f"{value!r} is no {kind}"
    elif isinstance(value, dict):
        yield from (f"{key} is missing" for key in schema.get("required", ()) if key not in value)
        known, patterns = schema.get("properties", {}), schema.get("patternProperties", {})
        for key, inside in value.items():
            if key in known:
                yield from problems(inside, known[key])
            elif not any(re.search(pattern, key) for pattern in patterns) and not schema.get(
                "additionalProperties", True
            ):
                yield f"{key} is unknown"
    elif isinstance(value, list):
        for entry in value:
            yield from problems(entry, schema["items"])
    elif value not in schema.get("enum", [value]) or not re.search(
        schema.get("pattern", ""), str(value)
    ):
        yield f"{value!r} is none of those allowed"
    elif kind in ("number", "integer") and not schema.get("minimum", value) <= value <= schema.get(
        "maximum", value
    ):
        yield f"{value!r} is out of range"


@pytest.mark.parametrize("name", scenario_file.shipped())
def test_shipped_scenarios_match_the_json_schema(name):
    assert list(problems(yaml.safe_load(scenario_file.text_of(name)), SCHEMA)) == []


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("duration_s: 5", "name is missing"),
        ("{name: a, evnts: []}", "evnts is unknown"),
        ("{name: a, plant: {start: {depth: 2.7}}}", "depth is unknown"),
        ("{name: a, plant: {start: {depth_mm: 9.0}}}", "9.0 is out of range"),
        ("{name: a, events: [{fault: {sensor: depth, kind: odd}}]}", "'odd' is none"),
        ("{name: a, events: [{reference: {depth_mm: 9}}]}", "9 is out of range"),
        ("{name: a b}", "'a b' is none"),
    ],
)
def test_json_schema_rejects_invalid_scenarios(text, words):
    assert words in "; ".join(problems(yaml.safe_load(text), SCHEMA))
