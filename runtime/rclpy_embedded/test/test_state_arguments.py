"""The grammar of --ros-args and of parameter files."""

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rclpy._rclpy_pybind11 import RCLError, RCLInvalidROSArgsError, UnknownROSArgsError
from rclpy.arguments import Arguments, parameter_overrides, parse
from rclpy.impl.logging_severity import LoggingSeverity
from rclpy.names import RemapRule
from rclpy.parameter import Parameter
from rclpy.parameter_yaml import parse_value
from rclpy.utilities import remove_ros_args

TOKEN = st.from_regex(r"[A-Za-z][A-Za-z0-9]{0,6}", fullmatch=True)
WORD = st.text(st.characters(codec="utf-8"), max_size=12)


def ros(*words: str) -> Arguments:
    return parse(["program", "--ros-args", *words])


def overrides(full_name: str, arguments: Arguments) -> dict[str, object]:
    return {name: parameter.value for name, parameter in parameter_overrides(full_name, arguments).items()}


def test_ros_arguments_come_in_stretches() -> None:
    words = ["p", "-d", "--ros-args", "-r", "a:=b", "--", "--foo=1", "--", "--ros-args", "--ros-args", "-r", "c:=d"]
    arguments = parse(words)
    assert arguments.remaining == ["p", "-d", "--foo=1", "--"]
    assert [(rule.match, rule.replacement) for rule in arguments.remap_rules] == [("a", "b"), ("c", "d")]
    assert remove_ros_args(words) == arguments.remaining


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        ("a:=b", RemapRule("topic_or_service", None, "a", "b")),
        ("n:/a/b:=~/c", RemapRule("topic_or_service", "n", "/a/b", "~/c")),
        ("rostopic://~/a:=/b", RemapRule("topic", None, "~/a", "/b")),
        ("n:rosservice:///a:=b", RemapRule("service", "n", "/a", "b")),
        ("__node:=x", RemapRule("node", None, None, "x")),
        ("n:__name:=x", RemapRule("node", "n", None, "x")),
        ("__ns:=/", RemapRule("namespace", None, None, "/")),
        ("n:__ns:=/a/b", RemapRule("namespace", "n", None, "/a/b")),
    ],
)
def test_remap_rules(text: str, rule: RemapRule) -> None:
    assert ros("--remap", text).remap_rules == [rule]


@pytest.mark.parametrize(
    "text",
    [
        "",
        "a",
        "a:=",
        ":=b",
        "a:=b:=c",
        "__node:=a/b",
        "__ns:=a",
        "__ns:=/a/",
        "a*:=b",
        "1a:=b",
        "a__b:=c",
        "n:m:a:=b",
        "a/:=b",
    ],
)
def test_malformed_remap_rules_name_the_rule(text: str) -> None:
    with pytest.raises(RCLInvalidROSArgsError, match="Couldn't parse remap rule") as caught:
        ros("-r", text)
    assert f"'-r {text}'" in str(caught.value)
    assert isinstance(caught.value, RCLError)


@pytest.mark.parametrize("flag", ["-r", "-p", "--params-file", "--log-level", "-e", "--log-file-name"])
def test_a_flag_needs_its_value(flag: str) -> None:
    with pytest.raises(RCLInvalidROSArgsError, match=f"trailing {flag} flag"):
        ros(flag)


def test_unknown_ros_arguments_are_all_named() -> None:
    with pytest.raises(UnknownROSArgsError, match=r"^\['--one', 'two'\]$"):
        ros("--one", "-r", "a:=b", "two")


def test_words_that_are_not_utf8_are_refused() -> None:
    for words in (["a\udcc3"], ["--ros-args", "-e", "a\udcc3"]):
        with pytest.raises(UnicodeEncodeError):
            parse(words)


def test_log_options() -> None:
    arguments = ros("--log-level", "Warn", "--log-level", "rcl.x:=DEBUG", "--disable-stdout-logs", "-e", "/e")
    assert arguments.default_log_level is LoggingSeverity.WARN
    assert arguments.log_levels == {"rcl.x": LoggingSeverity.DEBUG}
    assert (arguments.stdout_logs, arguments.rosout_logs, arguments.external_lib_logs) == (False, True, True)
    assert arguments.enclave == "/e"
    again = ros("--disable-rosout-logs", "--enable-rosout-logs", "--disable-external-lib-logs")
    assert (again.rosout_logs, again.external_lib_logs) == (True, False)


@pytest.mark.parametrize("text", ["loud", ":=info", "a:=loud", "a:="])
def test_bad_log_levels(text: str) -> None:
    with pytest.raises(RCLInvalidROSArgsError, match="log level"):
        ros("--log-level", text)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1", 1),
        ("-7", -7),
        ("0x1F", 31),
        ("010", 8),
        ("9223372036854775808", 9223372036854775808.0),
        ("1.", 1.0),
        ("-.5", -0.5),
        ("1e3", 1000.0),
        ("-.inf", -math.inf),
        ("inf", math.inf),
        ("true", True),
        ("Off", False),
        ("y", True),
        ("yEs", "yEs"),
        ("hello", "hello"),
        ("1_000", "1_000"),
        ("null", "null"),
        ("'1'", "1"),
        ('"true"', "true"),
        ("!!str 5", "5"),
        ('""', ""),
        ("[1, 2]", [1, 2]),
        ("[1.0, 2e0]", [1.0, 2.0]),
        ("[a, 'b']", ["a", "b"]),
        ("[on, off]", [True, False]),
        ("[]", None),
    ],
)
def test_values(text: str, value: object) -> None:
    parsed = ros("-p", f"x:={text}").parameters["/**"]["x"]
    assert parsed == value
    assert type(parsed) is type(value)


@pytest.mark.parametrize("text", ["", "[1, 2.0]", "[1, true]", "[[1]]", "{a: 1}", "[1", "*a", "&a"])
def test_bad_values(text: str) -> None:
    with pytest.raises(RCLInvalidROSArgsError, match="parameter override rule"):
        ros("-p", f"x:={text}")


@pytest.mark.parametrize("text", ["x", "x=1", "a b:=1", "*:=1", ".x:=1", "x.:=1", "1x:=1"])
def test_bad_parameter_rules(text: str) -> None:
    with pytest.raises(RCLInvalidROSArgsError, match=r"expected \[node:\]name:=value"):
        ros("-p", text)


def test_parameters_by_node() -> None:
    arguments = ros("-p", "a.b:=1", "-p", "n:c:=2", "-p", "other:d:=3", "-p", "a/x:=4", "-p", "v:=a:=b")
    assert overrides("/n", arguments) == {"a.b": 1, "a/x": 4, "v": "a:=b", "c": 2}
    assert overrides("/ns/n", arguments) == {"a.b": 1, "a/x": 4, "v": "a:=b"}


def test_a_nodes_own_arguments_win() -> None:
    found = parameter_overrides("/n", local=ros("-p", "a:=2"), global_=ros("-p", "a:=1", "-p", "b:=1"))
    assert {name: parameter.value for name, parameter in found.items()} == {"a": 2, "b": 1}
    assert found["a"].type_ is Parameter.Type.INTEGER
    assert parameter_overrides("/n") == {}


FILE = """
/**:
  ros__parameters:
    everywhere: all
    overridden: first
    nested: {deep: {value: 1}, list: [1.5, 2.5]}
/ns/node:
  ros__parameters: {overridden: last, empty: []}
ns:
  node:
    ros__parameters: {nested_key: 1}
  "*":
    ros__parameters: {any_in_ns: 1}
/**/node:
  ros__parameters: {any_namespace: 1}
/*/node:
  ros__parameters: {one_level: 1}
node:
  ros__parameters: {root_only: 1}
/**:
  ros__parameters: {again: 1}
"""


def test_parameter_files(tmp_path: Path) -> None:
    path = tmp_path / "params.yaml"
    path.write_text(FILE)
    arguments = ros("--params-file", str(path), "-p", "everywhere:=cli", "-p", "overridden:=cli")
    common = {"everywhere": "cli", "nested.deep.value": 1, "nested.list": [1.5, 2.5], "again": 1, "any_namespace": 1}
    # As in rcl, patterns count in the order first seen, so a section for the node wins over "-p" for all nodes.
    assert overrides("/ns/node", arguments) == common | {
        "overridden": "last",
        "empty": None,
        "nested_key": 1,
        "any_in_ns": 1,
        "one_level": 1,
    }
    assert overrides("/node", arguments) == common | {"overridden": "cli", "root_only": 1}
    assert overrides("/a/b/node", arguments) == common | {"overridden": "cli"}
    assert "any_in_ns" in overrides("/ns/other", arguments)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("a: 1", "Cannot have a value before ros__parameters"),
        ("ros__parameters: {a: 1}", "There are no node names before ros__parameters"),
        ("n: {ros__parameters: 1}", "must be a mapping of names to values"),
        ("n: {ros__parameters: {a: }}", "No value at line 1"),
        ("n:\n  ros__parameters:\n    a: [1, b]", "Sequence should be of same type. Error at line 3"),
        ("n: {ros__parameters: {a: [[1]]}}", "Sequences can only hold plain values"),
        ("n: {ros__parameters: {a: &x 1, b: *x}}", "Will not support aliasing"),
        ("n!: {ros__parameters: {a: 1}}", "is no name of a node"),
        ("- 1", "must be a mapping of node names"),
        ("a: [", "Error parsing YAML near line"),
        ("a: {}\n---\nb: {}", "found another document"),
    ],
)
def test_bad_parameter_files(tmp_path: Path, text: str, reason: str) -> None:
    path = tmp_path / "bad.yaml"
    path.write_text(text)
    with pytest.raises(RCLInvalidROSArgsError, match="Couldn't parse params file") as caught:
        ros("--params-file", str(path))
    assert reason in str(caught.value)


def test_a_missing_parameter_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(RCLInvalidROSArgsError, match=r"nowhere\.yaml"):
        ros("--params-file", str(tmp_path / "nowhere.yaml"))
    (tmp_path / "empty.yaml").write_text("# nothing\n")
    assert ros("--params-file", str(tmp_path / "empty.yaml")).parameters == {}


FLAGS = [
    "-r",
    "-p",
    "-e",
    "--params-file",
    "--log-level",
    "--disable-rosout-logs",
    "--",
    "--ros-args",
    "a:=b",
    "n:a:=[1",
]


@given(st.lists(st.one_of(WORD, st.sampled_from(FLAGS)), max_size=8))
def test_any_command_line_is_read_or_refused_clearly(words: list[str]) -> None:
    try:
        arguments = parse(["--ros-args", *words])
    except (RCLInvalidROSArgsError, UnknownROSArgsError):
        return
    assert set(arguments.remaining) <= set(words)


@given(WORD)
def test_any_value_is_read_or_refused_clearly(text: str) -> None:
    try:
        value = parse_value(text)
    except ValueError:
        return
    Parameter("x", value=value)


@given(st.lists(TOKEN, min_size=1, max_size=3), st.booleans(), st.booleans())
def test_a_full_name_matches_itself_and_its_wildcards(tokens: list[str], one: bool, relative: bool) -> None:
    name = "/" + "/".join(tokens)
    patterns = [name[1:] if relative else name, "/**", f"/**/{tokens[-1]}", "/*" * len(tokens)]
    for pattern in patterns:
        assert overrides(name, Arguments(parameters={pattern: {"a": 1}})) == {"a": 1}
    for pattern in ("/*" * (len(tokens) + 1), name + "x", "/x" + name):
        assert overrides(name, Arguments(parameters={pattern: {"a": 1}})) == {}


def test_a_bare_remap_rule_is_taken_and_warned_about(capfd: pytest.CaptureFixture[str]) -> None:
    arguments = parse(["program", "a:=b"])
    assert [rule.match for rule in arguments.remap_rules] == ["a"]
    assert arguments.remaining == ["program"]
    assert "Use '--ros-args --remap a:=b' instead" in capfd.readouterr().err
