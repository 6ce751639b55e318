"""Bounds of YAML and JSON.

Whatever is written, the answer is content within the bounds, or one line.
"""

import json

import pytest
import yaml
from hypothesis import example, given
from hypothesis import strategies as st

from fsw_control.schema import yaml_text
from fsw_control.schema.errors import InputError
from fsw_control.schema.models import Model, validate
from fsw_control.schema.yaml_text import (
    DEEPEST,
    LONGEST_TEXT,
    MOST_VALUES,
    content_of,
    json_content_of,
)

SCALARS = (
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=20)
)
TREES = st.recursive(
    SCALARS,
    lambda inner: (
        st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=4)
    ),
)
#: pieces that stand for everything that YAML can do: anchors, aliases, tags, merges, nesting in
#: both styles, documents
PIECES = st.sampled_from(
    [
        "&a ",
        "*a",
        "a: ",
        "? ",
        "- ",
        "\n",
        "  ",
        "[",
        "]",
        "{",
        "}",
        ", ",
        "<<: ",
        "---",
        "...",
        "%YAML 9.9\n",
        "!!int ",
        "!!bool ",
        "!!float ",
        "!!set ",
        "!!timestamp ",
        "!!binary ",
        "!!omap ",
        "!x ",
        "'",
        '"',
        "|\n",
        "x",
        "1",
        "-",
        ":",
        "1e5",
        "1:" * 400,
        "9" * 1500,
        "[" * 60,
        "2001-99-99",
        "\0",
        "\ud800",
        "\t",
        "# ",
    ]
)


def bomb(levels: int) -> str:
    """Lists of nine aliases in each other: 9^levels values."""
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x]"]
    for n in range(1, levels):
        lines.append(f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]")
    return "\n".join(lines)


def merge_bomb(levels: int) -> str:
    """As :func:`bomb`, as merge keys."""
    lines = ["a0: &a0 {k: 1}"]
    for n in range(1, levels):
        lines.append(f"a{n}: &a{n} {{k{n}: 1, <<: [{', '.join([f'*a{n - 1}'] * 9)}]}}")
    return "\n".join(lines)


def depth(content: object) -> int:
    inner = (
        content.values()
        if isinstance(content, dict)
        else content
        if isinstance(content, list)
        else None
    )
    return 0 if inner is None else 1 + max(map(depth, inner), default=0)


def size(content: object) -> int:
    inner = (
        content.values()
        if isinstance(content, dict)
        else content
        if isinstance(content, list)
        else ()
    )
    return 1 + sum(map(size, inner))


def one_line(read, text: str) -> str:
    with pytest.raises(InputError) as caught:
        read(text, "weld.yaml")
    line = str(caught.value)
    assert line.startswith("weld.yaml") and len(line) < 400 and "\n" not in line
    return line


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (merge_bomb(9), "values with those of aliases; write less"),
        (
            bomb(9),
            "line 6, column 10: not valid YAML: more than 100000 values with those of aliases; "
            "write less",
        ),
        ("a: &a {b: *a}", "alias *a is part of what it stands for; write the value out"),
        ("a: *b", "found undefined alias"),
        (
            "\n".join(["- &a0 [x]", *(f"- &a{n} [*a{n - 1}]" for n in range(1, 3000))]),
            "nested deeper than 50 levels",
        ),
        (
            "[" * 3000 + "]" * 3000,
            f"column {DEEPEST + 1}: not valid YAML: nested deeper than {DEEPEST} levels",
        ),
        ("{a: " * 3000 + "}" * 3000, f"nested deeper than {DEEPEST} levels"),
        ("\n".join(" " * n + "a:" for n in range(1500)), f"nested deeper than {DEEPEST} levels"),
        ("- " * 3000, f"nested deeper than {DEEPEST} levels"),
        (f"[{'x,' * MOST_VALUES}]", f"more than {MOST_VALUES} values; write less into one file"),
        (
            "x" * (LONGEST_TEXT + 1),
            f"longer than {LONGEST_TEXT} characters; write less into one file",
        ),
        ("a: " + "9" * 5000, "a number of more than 1000 characters"),
        ("a: " + "1:" * 100_000 + "1", "a number of more than 1000 characters"),
        ("a: " + "1:" * 300 + "1.5", "not valid YAML"),
        ("!!bool x", "not valid YAML"),
        ("!!int ''", "not valid YAML"),
        ("!!timestamp x", "not valid YAML"),
        ("a: 2001-99-99", "not valid YAML"),
        (f"? [{'x, ' * 1000}]\n: 1", "is not a name"),
        (f"{{{'k' * 900}: 1, {'k' * 900}: 2}}", "is given twice"),
        (f"!{'t' * 5000} x", "could not determine a constructor"),
    ],
)
def test_yaml_beyond_a_bound_is_one_line(text, problem):
    assert problem in one_line(content_of, text)


@pytest.mark.parametrize(
    "text", ["[" * 3000 + "]" * 3000, '{"a":' * 201 + "1" + "}" * 201, "[" * 100_000]
)
def test_json_nested_too_deep_is_one_line(text):
    assert "recursion limit" in one_line(json_content_of, text)


@pytest.mark.parametrize("text", ["", "[1", "9" * 5000, '"\n"'])
def test_json_that_is_not_valid_is_one_line(text):
    assert "not valid JSON" in one_line(json_content_of, text)


def test_reading_stops_where_a_bound_is_reached(monkeypatch):
    """A parser that composes first and judges afterwards would count more values than the bound."""
    counts = []
    compose = yaml_text._Bounded.compose_node

    def counting(self, parent, index):
        counts.append(self.values)
        return compose(self, parent, index)

    monkeypatch.setattr(yaml_text._Bounded, "compose_node", counting)
    for text in (bomb(12), "[" * 15_000, "- " * 9_000):
        one_line(content_of, text)
        assert len(counts) < DEEPEST + 10
        counts.clear()


def test_value_that_is_written_once_and_meant_twice_is_read():
    """PyYAML writes an alias where a program puts one object into two places."""
    event = {"channel": "depth", "amplitude_mm": 0.1}
    content = {"events": [event, event], "more": [[event, event]] * 2}
    text = yaml.safe_dump(content)
    assert "*id001" in text and content_of(text, "") == content
    merged = "a: &a {x: 1}\nb: {<<: *a, y: 2}"
    assert content_of(merged, "")["b"] == {"x": 1, "y": 2}


def test_as_deep_and_as_many_as_permitted():
    deepest = "[" * (DEEPEST - 1) + "1" + "]" * (DEEPEST - 1)
    assert depth(content_of(deepest, "")) == depth(json_content_of(deepest, "")) == DEEPEST - 1
    assert size(content_of(f"[{'x,' * (MOST_VALUES - 1)}]", "")) == MOST_VALUES


@example({"0E0": None})
@given(TREES)
def test_written_content_is_read_back(tree):
    quoted = yaml.safe_dump(
        tree, default_style='"'
    )  # plain, PyYAML writes the text 0E0, which is a number here
    assert content_of(quoted, "") == tree
    assert json_content_of(json.dumps(tree), "") == tree


@given(st.lists(PIECES, max_size=60).map("".join))
def test_whatever_is_written_is_content_within_the_bounds_or_one_line(text):
    for read in (content_of, json_content_of):
        try:
            content = read(text, "weld.yaml")
        except InputError as error:
            assert "\n" not in str(error) and len(str(error)) < 400
        else:
            deepest = DEEPEST if read is content_of else 200
            assert depth(content) <= deepest and size(content) <= MOST_VALUES


def test_thousands_of_problems_are_counted():
    class Part(Model):
        name: str = ""

    with pytest.raises(InputError, match=r"; and 4990 more$") as caught:
        validate(Part, {f"nam{n}": n for n in range(5000)}, "weld.yaml")
    assert len(str(caught.value)) < 1000
