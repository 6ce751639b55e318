"""Validation, expansion and remapping of names."""

import re
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rclpy.arguments import parse
from rclpy.exceptions import (
    InvalidNamespaceException,
    InvalidNodeNameException,
    InvalidParameterException,
    InvalidServiceNameException,
    InvalidTopicNameException,
    NameValidationException,
)
from rclpy.expand_topic_name import expand_topic_name
from rclpy.names import (
    RemapRule,
    remap,
    remap_node,
)
from rclpy.validate_full_topic_name import validate_full_topic_name
from rclpy.validate_namespace import validate_namespace
from rclpy.validate_node_name import validate_node_name
from rclpy.validate_parameter_name import validate_parameter_name
from rclpy.validate_topic_name import validate_topic_name

TOKEN = st.from_regex(r"[A-Za-z_][A-Za-z0-9_]{0,8}", fullmatch=True)
TEXT = st.text(st.sampled_from("aZ0_/~{}-. é"), max_size=12)


@pytest.mark.parametrize("name", ["chatter", "/chatter", "~/chatter", "~", "{node}/chatter", "a/b_c/D9", "_hidden"])
def test_valid_topic_names(name: str) -> None:
    assert validate_topic_name(name) is True


@pytest.mark.parametrize(
    ("name", "text", "index"),
    [
        ("", "must not be empty", 0),
        ("1chatter", "token must not start with a number", 0),
        ("foo/", "must not end with a forward slash", 3),
        ("invalid topic", "characters other than alphanumerics", 7),
        ("foo/1bar", "token must not start with a number", 4),
        ("foo{bar", "unmatched", 3),
        ("foo}bar", "unmatched", 3),
        ("foo/{4bar}", "substitution name must not start with a number", 5),
        ("foo/{a-b}", "substitution name must not contain", 6),
        ("foo/{a{b}}", "substitution name must not contain", 6),
        ("foo~", "must not have tilde '~' unless", 3),
        ("~foo", "that is not followed by a forward slash", 1),
        ("héllo", "characters other than alphanumerics", 1),
    ],
)
def test_invalid_topic_names_point_at_the_fault(name: str, text: str, index: int) -> None:
    with pytest.raises(InvalidTopicNameException, match=re.escape(text)) as caught:
        validate_topic_name(name)
    assert str(caught.value).endswith(f":\n  '{name}'\n   {' ' * index}^")
    with pytest.raises(InvalidServiceNameException):
        validate_topic_name(name, is_service=True)


@pytest.mark.parametrize(
    ("name", "text", "index"),
    [
        ("", "must not be empty", 0),
        ("a", "must be absolute", 0),
        ("/", "must not end with a '/'", 0),
        ("/a/", "must not end with a '/'", 2),
        ("/a~", "must not contain characters", 2),
        ("/a//b", "must not contain repeated '/'", 3),
        ("/a/1b", "must not have a token that starts with a number", 3),
        ("/" + "a" * 247, "should not exceed '247'", 246),
    ],
)
def test_invalid_full_names(name: str, text: str, index: int) -> None:
    with pytest.raises(InvalidTopicNameException, match=re.escape(text)) as caught:
        validate_full_topic_name(name)
    assert str(caught.value).endswith(f":\n  '{name}'\n   {' ' * index}^")
    with pytest.raises(InvalidServiceNameException):
        validate_full_topic_name(name, is_service=True)


def test_namespaces_node_and_parameter_names() -> None:
    assert validate_namespace("/") and validate_namespace("/a/b") and validate_node_name("node_1")
    for bad in ("", "a", "/a/", "/a b", "//", "/1", "/" + "a" * 246):
        with pytest.raises(InvalidNamespaceException):
            validate_namespace(bad)
    with pytest.raises(
        InvalidNamespaceException, match="must not end with a '/', unless only a '/':\n  '/a/'\n     \\^"
    ):
        validate_namespace("/a/")
    for bad in ("", "1a", "a/b", "a-b", "a" * 256):
        with pytest.raises(InvalidNodeNameException):
            validate_node_name(bad)
    with pytest.raises(InvalidNodeNameException, match="other than alphanumerics or '_':\n  'ab c'\n     \\^"):
        validate_node_name("ab c")
    assert validate_parameter_name("a.b")
    with pytest.raises(InvalidParameterException):
        validate_parameter_name("")


def is_valid(validate: Any, name: str) -> bool:
    try:
        return bool(validate(name))
    except NameValidationException as error:
        indent = str(error).rpartition("\n   ")[2]
        assert 1 <= len(indent) <= len(name) + 1
        return False


@given(TEXT)
def test_validators_agree_with_each_other(name: str) -> None:
    is_topic = is_valid(validate_topic_name, name)
    if is_valid(validate_full_topic_name, name):
        assert is_topic and is_valid(validate_namespace, name)
    if is_valid(validate_node_name, name):
        assert is_topic
        assert expand_topic_name(name, "n", "/ns") == f"/ns/{name}"


@pytest.mark.parametrize(
    ("topic", "namespace", "expected"),
    [
        ("chatter", "/", "/chatter"),
        ("chatter", "/ns", "/ns/chatter"),
        ("/chatter", "/ns", "/chatter"),
        ("~", "/", "/node"),
        ("~/x", "/ns", "/ns/node/x"),
        ("{node}/x", "/ns", "/ns/node/x"),
        ("{ns}/x", "/ns", "/ns/x"),
        ("{namespace}/{node}/{node}", "/ns", "/ns/node/node"),
        ("/a/{node}", "/ns", "/a/node"),
    ],
)
def test_expansion(topic: str, namespace: str, expected: str) -> None:
    assert expand_topic_name(topic, "node", namespace) == expected


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("a b", "n", "/"), "Invalid topic name"),
        (("a", "n!", "/"), "Invalid node name"),
        (("a", "n", "ns"), "Invalid namespace"),
        (("{other}", "n", "/"), "unknown substitution: {other}"),
    ],
)
def test_expansion_refuses(arguments: tuple[str, str, str], text: str) -> None:
    with pytest.raises(ValueError, match=re.escape(text)):
        expand_topic_name(*arguments)


@given(TEXT, TOKEN, TOKEN)
def test_expanding_what_is_valid_gives_an_absolute_name(topic: str, node: str, namespace: str) -> None:
    try:
        expanded = expand_topic_name(topic, node, f"/{namespace}")
    except ValueError:
        return
    assert expanded[0] == "/"
    assert expand_topic_name(expanded, node, f"/{namespace}") == expanded


def _rules(*rules: str) -> list[RemapRule]:
    return parse(["--ros-args", *(word for text in rules for word in ("-r", text))]).remap_rules


def test_remapping_topics_and_services() -> None:
    rules = _rules("a:=b", "/x:=~/y", "other:a:=c", "rosservice://s:=t", "rostopic://s:=u")
    assert remap("/ns/a", "node", "/ns", rules) == "/ns/b"
    assert remap("/a", "node", "/ns", rules) == "/a"
    assert remap("/x", "node", "/ns", rules) == "/ns/node/y"
    assert remap("/s", "node", "/", rules) == "/u"
    assert remap("/s", "node", "/", rules, is_service=True) == "/t"


def test_the_first_matching_rule_counts() -> None:
    assert remap("/a", "n", "/", _rules("a:=b", "a:=c")) == "/b"
    assert remap("/a", "n", "/", _rules("m:a:=b", "a:=c")) == "/c"
    assert remap("/b", "n", "/", _rules("a:=b", "b:=a")) == "/a"


def test_remapping_nodes() -> None:
    assert remap_node("n", "/ns", []) == ("n", "/ns")
    assert remap_node("n", "/", _rules("__node:=m", "__ns:=/a/b")) == ("m", "/a/b")
    assert remap_node("n", "/", _rules("__name:=m", "n:__ns:=/old", "m:__ns:=/new")) == ("m", "/new")
    assert remap_node("n", "/", _rules("other:__node:=m")) == ("n", "/")


def test_name_errors_have_one_base() -> None:
    assert issubclass(InvalidServiceNameException, NameValidationException)
