"""The command line of a node: its help, and a check for unknown parameters."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import takewhile
from textwrap import fill, indent
from typing import Any

from fsw_control.parameters import NodeParameters, describe, require_known
from fsw_control.schema.models import content_of, read_text

#: parameters of every node
_OF_ROS = ("use_sim_time", "start_type_description_service")
_QOS = "qos_overrides."
_SECTION = "ros__parameters"
_WIDTH = 100


@dataclass(frozen=True, slots=True)
class NodeArguments:
    """Arguments that a node accepts on its command line."""

    node: str  #: name of the node, unless it is remapped
    about: str  #: description of the node, in a sentence
    parameters: type[NodeParameters]  #: model of its parameters
    positional: str = ""  #: arguments before ``--ros-args``, as the usage shows them

    def help(self, program: str) -> str:
        """Usage text, and all parameters with type, default, range and meaning."""
        usage = f"usage: {program} {self.positional}".rstrip()
        options = "[-p NAME:=VALUE ...] [--params-file FILE] [-r FROM:=TO] [--log-level LEVEL]"
        about, parameters = self.about.strip(), parameter_help(self.parameters)
        return f"{usage} [--ros-args {options}]\n\n{about}\n\n{parameters}"

    def check(self, argv: Sequence[str]) -> None:
        """Reject unknown parameters, on the command line or in the node's section of a file.

        Those under a file's ``/**`` may be for another node. A missing file is left to ROS.

        Raises
        ------
        InputError
            With the names and similar known ones; or if a file is invalid or not a regular file.
        """
        name = self.node
        for flag, text in _ros_options(argv):
            left, _, right = text.partition(":=")
            if flag in ("-r", "--remap") and left.rpartition(":")[2] in ("__node", "__name"):
                name = right
        names: list[str] = []
        for flag, text in _ros_options(argv):
            if flag in ("-p", "--param"):
                node, _, parameter = text.partition(":=")[0].rpartition(":")
                names += [parameter] if node.rpartition("/")[2] in ("", "*", "**", name) else []
            elif flag == "--params-file":
                names += _in_file(text, name)
        require_known(
            describe(self.parameters),
            [name for name in names if name not in _OF_ROS and not name.startswith(_QOS)],
        )


def parameter_help(parameters: type[NodeParameters]) -> str:
    """All parameters with type, default, range and meaning."""
    lines = ["parameters:"]
    for spec in describe(parameters).values():
        default = "empty" if spec.default == "" else spec.default
        if isinstance(default, list):
            default = f"[{', '.join(map(str, default))}]"
        parts = [spec.type, f"default {default} {spec.unit}".rstrip()]
        if spec.range is not None:
            parts.append(f"{spec.range[0]:g} to {spec.range[1]:g} {spec.unit}".rstrip())
        parts += [f"one of {', '.join(spec.options)}"] if spec.options else []
        parts += ["at start only"] if spec.read_only else []
        lines.append(f"  {spec.name}  ({'; '.join(parts)})")
        lines.append(indent(fill(spec.description, _WIDTH - 6), " " * 6))
    return "\n".join(lines)


def asks_for_help(argv: Sequence[str]) -> bool:
    """Whether ``--help`` is among the arguments before ``--ros-args``."""
    own = takewhile(lambda word: word != "--ros-args", argv[1:])
    return not {"-h", "--help"}.isdisjoint(own)


def _ros_options(argv: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Options of ROS, between ``--ros-args`` and ``--``, each with the argument after it."""
    inside = False
    for word, following in zip(argv, [*argv[1:], ""], strict=True):
        inside = word == "--ros-args" or (inside and word != "--")
        if inside:
            yield word, following


def _in_file(path: str, name: str) -> list[str]:
    """Names of the parameters in a node's sections of a parameter file."""
    if not os.path.exists(path):
        return []
    sections = _sections("", content_of(read_text(path, "parameter file"), path))
    return [key for node, values in sections if node == name for key in _names(values)]


def _sections(node: str, content: Any) -> Iterator[tuple[str, Any]]:
    for key, value in content.items() if isinstance(content, dict) else ():
        if key == _SECTION:
            yield node, value
        else:
            yield from _sections(str(key).rpartition("/")[2], value)


def _names(values: Any) -> Iterator[str]:
    """Dotted names of nested parameters."""
    for key, value in values.items() if isinstance(values, dict) else ():
        if isinstance(value, dict):
            yield from (f"{key}.{inner}" for inner in _names(value))
        else:
            yield str(key)
