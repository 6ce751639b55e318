"""Names in the graph: their rules, their expansion to full names, and remapping."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Literal

from rclpy import exceptions

TOPIC_SEPARATOR_STRING = "/"

#: DDS allows 255 characters; 8 are kept for the prefixes and suffixes of ROS.
MAX_TOPIC_LENGTH = 255 - 8
MAX_NAMESPACE_LENGTH = MAX_TOPIC_LENGTH - 2
MAX_NODE_NAME_LENGTH = 255

TOKEN = r"(?:[A-Za-z]|_(?!_))(?:[A-Za-z0-9]|_(?!_))*"
_NAME = rf"(?:~/|/)?{TOKEN}(?:/{TOKEN})*"
_RULE = re.compile(
    rf"(?:(?P<node>{TOKEN}):(?!=))?"
    rf"(?:(?:__node|__name):=(?P<node_name>{TOKEN})"
    rf"|__ns:=(?P<namespace>/(?:{TOKEN}(?:/{TOKEN})*)?)"
    rf"|(?P<scheme>rostopic://|rosservice://)?(?P<match>{_NAME}):=(?P<replacement>{_NAME}))"
)
_KINDS = {None: "topic_or_service", "rostopic://": "topic", "rosservice://": "service"}

#: Pattern of what is wrong, of which the last character is the bad one, and the message; the first fault counts.
_Faults = tuple[tuple[str, str], ...]


def _absolute(what: str, too_long: str, longest: int, end: str = r"/\Z", only: str = "") -> _Faults:
    return (
        (r"^\Z", f"{what} must not be empty"),
        (r"^[^/]", f"{what} must be absolute, it must lead with a '/'"),
        (end, f"{what} must not end with a '/'{only}"),
        (r"[^A-Za-z0-9_/]", f"{what} must not contain characters other than alphanumerics, '_', or '/'"),
        (r"//", f"{what} must not contain repeated '/'"),
        (r"/[0-9]", f"{what} must not have a token that starts with a number"),
        (rf"^.{{{longest}}}(?=.)", f"{too_long} should not exceed '{longest}'"),
    )


_FULL_TOPIC_FAULTS = _absolute("topic name", "topic length", MAX_TOPIC_LENGTH)
_NAMESPACE_FAULTS = _absolute("namespace", "namespace", MAX_NAMESPACE_LENGTH, r"./\Z", ", unless only a '/'")
_NODE_FAULTS: _Faults = (
    (r"^\Z", "node name must not be empty"),
    (r"[^A-Za-z0-9_]", "node name must not contain characters other than alphanumerics or '_'"),
    (r"^[0-9]", "node name must not start with a number"),
    (rf"^.{{{MAX_NODE_NAME_LENGTH}}}(?=.)", f"node name length should not exceed '{MAX_NODE_NAME_LENGTH}'"),
)
#: The longest part of a topic name that has only valid characters and substitutions; matched once and for all by a
#: look-ahead, since possessive quantifiers of groups are wrong before Python 3.11.4.
_VALID = r"^(?=(?P<valid>~?(?:[A-Za-z0-9_/]|\{(?![0-9])[A-Za-z0-9_]*\})*))(?P=valid)"
_TOPIC_FAULTS: _Faults = (
    (r"^\Z", "topic name must not be empty string"),
    (r"^[0-9]", "topic name token must not start with a number"),
    (r"/\Z", "topic name must not end with a forward slash"),
    (_VALID + r"\{[0-9]", "substitution name must not start with a number"),
    (_VALID + r"(\}|\{(?=[A-Za-z0-9_]*\Z))", "topic name must not have unmatched (unbalanced) curly braces '{}'"),
    (_VALID + r"(\{[A-Za-z0-9_]*)?~", "topic name must not have tilde '~' unless it is the first character"),
    (
        _VALID + r"\{[A-Za-z0-9_]*[^A-Za-z0-9_]",
        "substitution name must not contain characters other than alphanumerics or '_'",
    ),
    (_VALID + ".", "topic name must not contain characters other than alphanumerics, '_', '~', '{', or '}'"),
    (r"^~[^/](?=.)", "topic name must not have a tilde '~' that is not followed by a forward slash '/'"),
    (r"/[0-9]", "topic name token must not start with a number"),
)


def _validate(name: str, faults: _Faults, kind: Callable[[str, str, int], Exception]) -> Literal[True]:
    for pattern, text in faults:
        if match := re.search(pattern, name, re.DOTALL):
            raise kind(name, text, max(0, match.end() - 1))
    return True


def _topic_exception(is_service: bool) -> Callable[[str, str, int], Exception]:
    return exceptions.InvalidServiceNameException if is_service else exceptions.InvalidTopicNameException


def validate_topic_name(name: str, *, is_service: bool = False) -> Literal[True]:
    """Return True for a valid name, which need not be expanded; else raise Invalid{Topic,Service}NameException."""
    return _validate(name, _TOPIC_FAULTS, _topic_exception(is_service))


def validate_full_topic_name(name: str, *, is_service: bool = False) -> Literal[True]:
    """Return True for a valid fully qualified name; else raise Invalid{Topic,Service}NameException."""
    return _validate(name, _FULL_TOPIC_FAULTS, _topic_exception(is_service))


def validate_namespace(namespace: str) -> Literal[True]:
    """Return True for a valid absolute namespace; else raise InvalidNamespaceException."""
    return _validate(namespace, _NAMESPACE_FAULTS, exceptions.InvalidNamespaceException)


def validate_node_name(node_name: str) -> Literal[True]:
    """Return True for a valid node name (without namespace); else raise InvalidNodeNameException."""
    return _validate(node_name, _NODE_FAULTS, exceptions.InvalidNodeNameException)


def validate_parameter_name(name: str) -> Literal[True]:
    """Return True for a valid parameter name; else raise InvalidParameterException."""
    if not name:
        raise exceptions.InvalidParameterException(name)
    return True


def expand_topic_name(topic_name: str, node_name: str, node_namespace: str) -> str:
    """Expand a topic or service name to a full one.

    The result may still be invalid, e.g. for ``{ns}//x``: check it with ``validate_full_topic_name``.
    """
    try:
        validate_topic_name(topic_name)
        validate_node_name(node_name)
        validate_namespace(node_namespace)
    except exceptions.NameValidationException as error:
        raise ValueError(f"a name is invalid: {error}") from None
    root = "/" if node_namespace == "/" else node_namespace + "/"
    name = root + node_name + topic_name[1:] if topic_name[0] == "~" else topic_name
    known = {"node": node_name, "ns": node_namespace, "namespace": node_namespace}

    def replacement(match: re.Match[str]) -> str:
        if match[1] not in known:
            raise ValueError(f"topic name '{topic_name}' is invalid: unknown substitution: {match[0]}")
        return known[match[1]]

    name = re.sub(r"\{(\w*)\}", replacement, name)
    return name if name[0] == "/" else root + name


@dataclass(frozen=True)
class RemapRule:
    """One remap rule.

    `kind` is 'node', 'namespace', 'topic', 'service' or 'topic_or_service'; `node_name` limits the rule to nodes of
    that name; `match` is None for nodes and namespaces.
    """

    kind: str
    node_name: str | None
    match: str | None
    replacement: str

    @classmethod
    def parse(cls, text: str) -> RemapRule:
        """Read ``from:=to`` and the like; ValueError if it is no rule."""
        match = _RULE.fullmatch(text)
        if match is None:
            raise ValueError("expected [node:]from:=to, [node:]__node:=name or [node:]__ns:=/namespace")
        if match["node_name"]:
            return cls("node", match["node"], None, match["node_name"])
        if match["namespace"]:
            return cls("namespace", match["node"], None, match["namespace"])
        return cls(_KINDS[match["scheme"]], match["node"], match["match"], match["replacement"])


def remap_node(name: str, namespace: str, rules: Iterable[RemapRule]) -> tuple[str, str]:
    """Return a node's name and namespace after remapping; rules for the namespace look at the new name."""
    rules = list(rules)

    def first(kind: str, node_name: str, otherwise: str) -> str:
        found = (rule.replacement for rule in rules if rule.kind == kind and rule.node_name in (None, node_name))
        return next(found, otherwise)

    name = first("node", name, name)
    return name, first("namespace", name, namespace)


def remap(
    name: str, node_name: str, node_namespace: str, rules: Iterable[RemapRule], *, is_service: bool = False
) -> str:
    """Apply the first remap rule that matches a full topic or service name; without one, return the name itself."""
    kinds = ("topic_or_service", "service" if is_service else "topic")
    for rule in rules:
        if rule.match is None or rule.kind not in kinds or rule.node_name not in (None, node_name):
            continue
        try:
            match = expand_topic_name(rule.match, node_name, node_namespace)
        except ValueError:
            continue
        if match == name:
            return expand_topic_name(rule.replacement, node_name, node_namespace)
    return name
