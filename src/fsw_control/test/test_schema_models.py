"""Models of files and requests: what fits, what is said of the rest, and the JSON Schema."""

import json
from typing import Annotated, Literal

import pytest
from pydantic import Field, ValidationError, model_validator

from fsw_control.schema import models
from fsw_control.schema.models import InputError, Many, Model, Name, Whole
from fsw_control.schema.ranges import Range

DEPTH_MM = Range(1.5, 4.0, "mm")


class Bump(Model):
    """A bump."""

    kind: Literal["bump"]
    height_mm: Annotated[float, DEPTH_MM]
    """how high it is"""
    low_mm: Annotated[float, DEPTH_MM] | None = None

    @model_validator(mode="after")
    def _check(self):
        if self.low_mm is not None and self.low_mm > self.height_mm:
            raise models.problem(f"= {self.low_mm:g} is above {{height_mm}}", "low_mm")
        if self.low_mm == self.height_mm:
            raise ValueError("is flat")
        return self


class Dent(Model):
    kind: Literal["dent", "hole"]
    share: float = 0.5


class Part(Model):
    name: Name
    marks: Many[Annotated[Bump | Dent, Field(discriminator="kind")]] = ()
    bumps: dict[str, Bump] = {}
    count: Annotated[Whole, Range(1, 100, "pieces")] = 1
    sound: bool = True


def read(text: str) -> Part:
    return models.validate(Part, models.content_of(text, "part.yaml"), "part.yaml")


def test_valid_content_is_accepted():
    without_values = "{name: a, marks: , count: }"
    assert read(without_values) == Part(name="a")
    part = read("{name: a_1, marks: [{kind: bump, height_mm: 2}, {kind: hole}], count: 1e1}")
    assert part == Part(
        name="a_1",
        marks=(Bump(kind="bump", height_mm=2.0), Dent(kind="hole", share=0.5)),
        count=10,
    )
    with pytest.raises(ValidationError):
        part.count = 3  # it is immutable


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("[]", "part.yaml: is []: must be a mapping"),
        ("{}", "part.yaml: lacks name"),
        ("name:", "part.yaml: lacks name"),
        ("name: a b", "part.yaml: name is 'a b': must be a name"),
        ("name: 3", "name is 3: must be a valid string"),
        ("{name: a, sound: 1}", "sound is 1: must be a valid boolean"),
        ("{name: a, count: yes}", "count is True, not a number (1 to 100 pieces)"),
        ("{name: a, count: 2.5}", "count is 2.5: must be a valid integer"),
        ("{name: a, count: .nan}", "count = nan is outside 1 to 100 pieces"),
        (f"{{name: a, count: 1{'0' * 400}}}", "count = a huge number is outside 1 to 100 pieces"),
        ("{name: a, marks: 3}", "marks is 3: must be a list"),
        ("{name: a, marks: [3]}", "marks[0] is 3: must be a mapping"),
        ("{name: a, marks: [{}]}", "marks[0] lacks 'kind'"),
        ("{name: a, marks: [{kind: wave}]}", "expected tags: 'bump', 'dent', 'hole'"),
        ("{name: a, marks: [{kind: bump}]}", "marks[0] lacks height_mm"),
        (
            "{name: a, marks: [{kind: dent, share: .inf}]}",
            "marks[0].share is inf: must be a finite number",
        ),
        (
            "{name: a, marks: [{kind: dent, share: true}]}",
            "marks[0].share is True: must be a valid number",
        ),
        (
            "{name: a, marks: [{kind: dent, share: '1'}]}",
            "marks[0].share is '1': must be a valid number",
        ),
        (
            "{name: a, marks: [{kind: bump, height_mm: 5}]}",
            "marks[0].height_mm = 5 is outside 1.5 to 4 mm",
        ),
        (
            "{name: a, marks: [{kind: bump, height_mm: x}]}",
            "marks[0].height_mm is 'x', not a number (1.5 to 4 mm)",
        ),
        (
            "{name: a, marks: [{kind: bump, height_mm: 2, low_mm: 3}]}",
            "marks[0].low_mm = 3 is above {height_mm}",
        ),
        ("{name: a, marks: [{kind: bump, height_mm: 2, low_mm: 2}]}", "marks[0] is flat"),
        (
            "{name: a, bumps: {x: {kind: dent, height_mm: 2}}}",
            "bumps.x.kind is 'dent': must be 'bump'",
        ),
        (
            "{name: a, marks: [{kind: bump, height_mm: 2, hight_mm: 2}]}",
            "marks[0].hight_mm is an unknown key; "
            "did you mean height_mm? known: kind, height_mm, low_mm",
        ),
        (
            "{name: a, 1: 2}",
            "part.yaml: 1 is an unknown key; known: name, marks, bumps, count, sound",
        ),
        (
            "name: a\nname: b",
            "part.yaml, line 2, column 1: not valid YAML: key 'name' is given twice",
        ),
        (
            "name:\n\ta",
            "part.yaml, line 2, column 1: not valid YAML: found character that "
            "cannot start any token",
        ),
        ("[" * 900, "part.yaml, line 1, column 51: not valid YAML: nested deeper than 50 levels"),
        (
            "[" * 200_000,
            "part.yaml, line 1, column 51: not valid YAML: nested deeper than 50 levels",
        ),
        (
            "&a [*a]",
            "part.yaml, line 1, column 5: not valid YAML: alias *a is part of what it stands for",
        ),
        ("a: [", "part.yaml, line 2, column 1: not valid YAML"),
        (f"name: {'x y ' * 1000}", "x y: must be a name"),
    ],
)
def test_validation_error_is_one_line_with_its_path(text, problem):
    with pytest.raises(InputError) as caught:
        read(text)
    assert problem in str(caught.value) and str(caught.value).startswith("part.yaml")
    assert "\n" not in str(caught.value)


def test_all_problems_are_listed_but_not_hundreds():
    with pytest.raises(InputError) as caught:
        read("{count: 0, sound: maybe, marks: [{kind: bump}]}")
    assert all(
        part in str(caught.value)
        for part in ("lacks name; ", "marks[0] lacks height_mm; ", "count = 0", "sound")
    )
    with pytest.raises(InputError, match=r" 91 more$"):
        read(f"{{name: a, marks: [{'3, ' * 101}]}}")
    with pytest.raises(InputError, match=r": name, .*, sound; .* marks\?$"):
        read("{name: a, 1: 2, mark: 3}")


def test_problems_have_their_places_and_kinds():
    with pytest.raises(InputError) as caught:
        read("{count: 0, sound: maybe, nam: a, marks: [{kind: bump}, {kind: wave}]}")
    assert set(caught.value.problems) == {
        ("name", "missing"),
        ("nam", "extra_forbidden"),
        ("count", "outside"),
        ("sound", "bool_type"),
        ("marks[0].height_mm", "missing"),
        ("marks[1]", "union_tag_invalid"),
    }
    with pytest.raises(InputError) as caught:
        read("a: [")  # no content that a model could judge
    assert caught.value.problems == ()


def test_json_schema_has_range_unit_and_meaning():
    schema = models.json_schema(Part)
    assert schema["properties"]["count"] == {
        "type": "integer",
        "minimum": 1,
        "maximum": 100,
        "unit": "pieces",
        "default": 1,
    }
    bump = schema["$defs"]["Bump"]
    assert bump["properties"]["height_mm"] == {
        "description": models.descriptions(Bump)["height_mm"],
        "type": "number",
        "minimum": 1.5,
        "maximum": 4.0,
        "unit": "mm",
    }
    assert "anyOf" not in bump["properties"]["low_mm"] and bump["required"] == [
        "kind",
        "height_mm",
    ]
    assert json.loads(json.dumps(schema)) == schema


def test_the_range_of_a_field():
    assert models.range_of(Part, "count") == Range(1, 100, "pieces")
    assert models.range_of(Bump, "height_mm") == models.range_of(Bump, "low_mm") == DEPTH_MM


def test_text_of_a_file_or_a_shipped_one(tmp_path):
    (tmp_path / "one.yaml").write_text("a: 1", encoding="utf-8")
    (tmp_path / "bad.yaml").write_bytes(b"\xff")
    assert (
        models.read_text("one", "part", tmp_path)
        == models.read_text(tmp_path / "one.yaml", "part")
        == "a: 1"
    )
    with pytest.raises(InputError, match=r"two: .* bad, one$"):
        models.read_text("two", "part", tmp_path)
    with pytest.raises(InputError, match=r"part onne: .* one\?$"):
        models.read_text("onne", "part", tmp_path)
    for source in ("bad", "\0"):
        with pytest.raises(InputError, match="UTF-8"):
            models.read_text(source, "part", tmp_path)
