"""Remap rules of a command line and what they do to names."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass

from rclpy.names import expand_topic_name

TOKEN = r"(?:[A-Za-z]|_(?!_))(?:[A-Za-z0-9]|_(?!_))*"
_NAME = rf"(?:~/|/)?{TOKEN}(?:/{TOKEN})*"
_RULE = re.compile(
    rf"(?:(?P<node>{TOKEN}):(?!=))?"
    rf"(?:(?:__node|__name):=(?P<node_name>{TOKEN})"
    rf"|__ns:=(?P<namespace>/(?:{TOKEN}(?:/{TOKEN})*)?)"
    rf"|(?P<scheme>rostopic://|rosservice://)?(?P<match>{_NAME}):=(?P<replacement>{_NAME}))"
)
_KINDS = {None: "topic_or_service", "rostopic://": "topic", "rosservice://": "service"}


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
