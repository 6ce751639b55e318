"""Names in the graph: their rules, their expansion to full names, and remapping.

Each ``*_error`` function returns None for a valid name, else ``(message, index of the first bad character)``,
checked in the order of rcl and rmw, so that the same fault of several is reported.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
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

NameError_ = tuple[str, int] | None


def full_topic_name_error(name: str, kind: str = "topic name") -> NameError_:
    """Check a fully qualified topic or service name."""
    if not name:
        return f"{kind} must not be empty", 0
    if name[0] != "/":
        return f"{kind} must be absolute, it must lead with a '/'", 0
    if name[-1] == "/":
        return f"{kind} must not end with a '/'", len(name) - 1
    if bad := re.search(r"[^A-Za-z0-9_/]", name):
        return f"{kind} must not contain characters other than alphanumerics, '_', or '/'", bad.start()
    if bad := re.search(r"/[/0-9]", name):
        if name[bad.start() + 1] == "/":
            return f"{kind} must not contain repeated '/'", bad.start() + 1
        return f"{kind} must not have a token that starts with a number", bad.start() + 1
    if kind == "topic name" and len(name) > MAX_TOPIC_LENGTH:
        return f"topic length should not exceed '{MAX_TOPIC_LENGTH}'", MAX_TOPIC_LENGTH - 1
    return None


def namespace_error(namespace: str) -> NameError_:
    """Check an absolute namespace."""
    if namespace == "/":
        return None
    if error := full_topic_name_error(namespace, "namespace"):
        text, index = error
        return (text + ", unless only a '/'" if text.endswith("end with a '/'") else text), index
    if len(namespace) > MAX_NAMESPACE_LENGTH:
        return f"namespace should not exceed '{MAX_NAMESPACE_LENGTH}'", MAX_NAMESPACE_LENGTH - 1
    return None


def node_name_error(name: str) -> NameError_:
    """Check a node's name (without namespace)."""
    if not name:
        return "node name must not be empty", 0
    if bad := re.search(r"[^A-Za-z0-9_]", name):
        return "node name must not contain characters other than alphanumerics or '_'", bad.start()
    if name[0] in "0123456789":
        return "node name must not start with a number", 0
    if len(name) > MAX_NODE_NAME_LENGTH:
        return f"node name length should not exceed '{MAX_NODE_NAME_LENGTH}'", MAX_NODE_NAME_LENGTH - 1
    return None


def topic_name_error(name: str) -> NameError_:
    """Check a topic or service name as a user may write it: relative, private (~) or with substitutions ({node})."""
    if not name:
        return "topic name must not be empty string", 0
    if name[0] in "0123456789":
        return "topic name token must not start with a number", 0
    if name[-1] == "/":
        return "topic name must not end with a forward slash", len(name) - 1
    valid = re.match(r"~?(?:[A-Za-z0-9_/]|\{(?![0-9])[A-Za-z0-9_]*\})*", name)
    if valid and valid.end() < len(name):
        return _bad_character(name, valid.end())
    if name[0] == "~" and len(name) > 2 and name[1] != "/":
        return "topic name must not have a tilde '~' that is not followed by a forward slash '/'", 1
    if bad := re.search(r"/[0-9]", name):
        return "topic name token must not start with a number", bad.start() + 1
    return None


def _bad_character(name: str, index: int) -> NameError_:
    """Say what is wrong with the character, or with the braces that begin there."""
    unmatched = "topic name must not have unmatched (unbalanced) curly braces '{}'"
    opened = re.compile(r"\{([A-Za-z0-9_]*)").match(name, index)
    if opened:
        if opened[1][:1].isdigit():
            return "substitution name must not start with a number", index + 1
        if opened.end() == len(name):
            return unmatched, index
        index = opened.end()
    if name[index] == "~":
        return "topic name must not have tilde '~' unless it is the first character", index
    if opened:
        return "substitution name must not contain characters other than alphanumerics or '_'", index
    if name[index] == "}":
        return unmatched, index
    return "topic name must not contain characters other than alphanumerics, '_', '~', '{', or '}'", index


def validate_topic_name(name: str, *, is_service: bool = False) -> Literal[True]:
    """Return True for a valid name, which need not be expanded; else raise Invalid{Topic,Service}NameException."""
    if error := topic_name_error(name):
        raise (exceptions.InvalidServiceNameException if is_service else exceptions.InvalidTopicNameException)(
            name, *error
        )
    return True


def validate_full_topic_name(name: str, *, is_service: bool = False) -> Literal[True]:
    """Return True for a valid fully qualified name; else raise Invalid{Topic,Service}NameException."""
    if error := full_topic_name_error(name):
        raise (exceptions.InvalidServiceNameException if is_service else exceptions.InvalidTopicNameException)(
            name, *error
        )
    return True


def validate_namespace(namespace: str) -> Literal[True]:
    """Return True for a valid absolute namespace; else raise InvalidNamespaceException."""
    if error := namespace_error(namespace):
        raise exceptions.InvalidNamespaceException(namespace, *error)
    return True


def validate_node_name(node_name: str) -> Literal[True]:
    """Return True for a valid node name; else raise InvalidNodeNameException."""
    if error := node_name_error(node_name):
        raise exceptions.InvalidNodeNameException(node_name, *error)
    return True


def validate_parameter_name(name: str) -> Literal[True]:
    """Return True for a valid parameter name; else raise InvalidParameterException."""
    if not name:
        raise exceptions.InvalidParameterException(name)
    return True


def expand_topic_name(topic_name: str, node_name: str, node_namespace: str) -> str:
    """Expand a topic or service name to a full one.

    The result may still be invalid, e.g. for ``{ns}//x``: check it with ``validate_full_topic_name``.
    """
    for what, value, error in (
        ("topic name", topic_name, topic_name_error(topic_name)),
        ("node name", node_name, node_name_error(node_name)),
        ("node namespace", node_namespace, namespace_error(node_namespace)),
    ):
        if error:
            raise ValueError(f"{what} '{value}' is invalid: {error[0]}")
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
