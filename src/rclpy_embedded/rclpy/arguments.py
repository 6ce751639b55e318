"""ROS arguments on a command line: remapping, parameters, logging, enclave."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

from rclpy import parameter_yaml
from rclpy._rclpy_pybind11 import RCLInvalidROSArgsError, UnknownROSArgsError
from rclpy.impl.logging_severity import LoggingSeverity
from rclpy.parameter import Parameter

_TOKEN = r"(?:[A-Za-z]|_(?!_))(?:[A-Za-z0-9]|_(?!_))*"
_NAME = rf"(?:~/|/)?{_TOKEN}(?:/{_TOKEN})*"
_REMAP = re.compile(
    rf"(?:(?P<node>{_TOKEN}):(?!=))?"
    rf"(?:(?:__node|__name):=(?P<node_name>{_TOKEN})"
    rf"|__ns:=(?P<namespace>/(?:{_TOKEN}(?:/{_TOKEN})*)?)"
    rf"|(?P<scheme>rostopic://|rosservice://)?(?P<match>{_NAME}):=(?P<replacement>{_NAME}))"
)
_PARAMETER_TOKEN = r"(?:[A-Za-z_/][A-Za-z0-9_]*)+"
_PARAMETER = re.compile(
    rf"(?:(?P<node>{_TOKEN}):(?!=))?(?P<name>{_PARAMETER_TOKEN}(?:\.{_PARAMETER_TOKEN})*):=(?P<value>.*)", re.DOTALL
)
_FLAG = re.compile(r"--(enable|disable)-(stdout|rosout|external-lib)-logs")


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


@dataclass
class Arguments:
    """What the ROS arguments of a command line say.

    Attributes
    ----------
    remap_rules : list of RemapRule
        In the order given; the first that matches counts.
    parameters : dict
        Pattern of a node's full name -> parameter -> value, patterns in the order first seen.
    default_log_level : LoggingSeverity
        UNSET if none is given.
    log_levels : dict
        Level by logger name.
    enclave : str or None
        As given.
    stdout_logs, rosout_logs, external_lib_logs : bool
        Which outputs of the log are wanted.
    remaining : list of str
        The arguments that are not for ROS.
    """

    remap_rules: list[RemapRule] = field(default_factory=list)
    parameters: dict[str, dict[str, Any]] = field(default_factory=dict)
    default_log_level: LoggingSeverity = LoggingSeverity.UNSET
    log_levels: dict[str, LoggingSeverity] = field(default_factory=dict)
    enclave: str | None = None
    stdout_logs: bool = True
    rosout_logs: bool = True
    external_lib_logs: bool = True
    remaining: list[str] = field(default_factory=list)


def _add_remap(arguments: Arguments, text: str) -> None:
    match = _REMAP.fullmatch(text)
    if match is None:
        raise ValueError("expected [node:]from:=to, [node:]__node:=name or [node:]__ns:=/namespace")
    node = match["node"]
    if match["node_name"]:
        rule = RemapRule("node", node, None, match["node_name"])
    elif match["namespace"]:
        rule = RemapRule("namespace", node, None, match["namespace"])
    else:
        kinds = {None: "topic_or_service", "rostopic://": "topic", "rosservice://": "service"}
        rule = RemapRule(kinds[match["scheme"]], node, match["match"], match["replacement"])
    arguments.remap_rules.append(rule)


def _add_parameter(arguments: Arguments, text: str) -> None:
    match = _PARAMETER.fullmatch(text)
    if match is None:
        raise ValueError("expected [node:]name:=value")
    value = parameter_yaml.parse_value(match["value"])
    arguments.parameters.setdefault(match["node"] or "/**", {})[match["name"]] = value


def _add_log_level(arguments: Arguments, text: str) -> None:
    name, assigned, level = text.rpartition(":=")
    if assigned and not name:
        raise ValueError("Argument has an invalid logger item that name is empty")
    try:
        severity = LoggingSeverity[level.upper()]
    except KeyError:
        raise ValueError("Argument does not use a valid severity level") from None
    if assigned:
        arguments.log_levels[name] = severity
    else:
        arguments.default_log_level = severity


def _ignore(arguments: Arguments, text: str) -> None:
    """Accept what is about log files, of which there are none."""


#: Flag with a value -> what the value is called, and what takes it.
_OPTIONS: dict[str, tuple[str, Callable[[Arguments, str], None]]] = {
    "--remap": ("remap rule", _add_remap),
    "--param": ("parameter override rule", _add_parameter),
    "--params-file": ("params file", lambda arguments, path: parameter_yaml.parse_file(path, arguments.parameters)),
    "--log-level": ("log level", _add_log_level),
    "--log-file-name": ("log file name prefix", _ignore),
    "--log-config-file": ("log configuration file", _ignore),
    "--enclave": ("enclave name", lambda arguments, text: setattr(arguments, "enclave", text)),
}
_OPTIONS |= {"-r": _OPTIONS["--remap"], "-p": _OPTIONS["--param"], "-e": _OPTIONS["--enclave"]}


def _warn_deprecated(rule: str) -> None:
    from rclpy.logging import get_logger

    get_logger("rcl").warning(
        f"Found remap rule '{rule}'. This syntax is deprecated. Use '--ros-args --remap {rule}' instead."
    )


def parse(argv: Sequence[str] | None = None) -> Arguments:
    """Read a command line; None means that of the process.

    ROS arguments stand between ``--ros-args`` and ``--`` or the end; there may be several such stretches.

    Raises
    ------
    RCLInvalidROSArgsError
        If a ROS argument is malformed, with what and why.
    UnknownROSArgsError
        If there are ROS arguments that nobody knows.
    UnicodeEncodeError
        If an argument is not UTF-8.
    """
    arguments, unknown, in_ros = Arguments(), [], False
    argv = sys.argv if argv is None else argv
    "".join(argv).encode()
    words = iter(argv)
    for word in words:
        if word == "--ros-args":
            in_ros = True
        elif not in_ros:
            try:
                _add_remap(arguments, word)
                _warn_deprecated(word)
            except ValueError:
                arguments.remaining.append(word)
        elif word == "--":
            in_ros = False
        elif word in _OPTIONS:
            label, take = _OPTIONS[word]
            text = next(words, None)
            if text is None:
                raise RCLInvalidROSArgsError(
                    f"Failed to parse ROS arguments: Couldn't parse trailing {word} flag. No {label} found."
                )
            try:
                take(arguments, text)
            except ValueError as error:
                raise RCLInvalidROSArgsError(
                    f"Failed to parse ROS arguments: Couldn't parse {label}: '{word} {text}'. Error: {error}"
                ) from error
        elif flag := _FLAG.fullmatch(word):
            setattr(arguments, flag[2].replace("-", "_") + "_logs", flag[1] == "enable")
        else:
            unknown.append(word)
    if unknown:
        raise UnknownROSArgsError(repr(unknown))
    return arguments


def rules_for(local: Arguments | None, global_: Arguments | None) -> list[RemapRule]:
    """Return the remap rules of a node: its own before those of the process.

    Pass ``global_=None`` for a node that does not use the global arguments.
    """
    return [rule for arguments in (local, global_) if arguments for rule in arguments.remap_rules]


def remap_node(name: str, namespace: str, rules: Iterable[RemapRule]) -> tuple[str, str]:
    """Return a node's name and namespace after remapping; rules for the namespace look at the new name."""
    rules = list(rules)

    def first(kind: str, node_name: str, otherwise: str) -> str:
        for rule in rules:
            if rule.kind == kind and rule.node_name in (None, node_name):
                return rule.replacement
        return otherwise

    name = first("node", name, name)
    return name, first("namespace", name, namespace)


def _matches(pattern: str, full_name: str) -> bool:
    """Tell whether a pattern of a parameter file (``*`` one token, ``**`` any number) fits a node's full name."""
    regex = re.escape("/" + pattern.lstrip("/")).replace(r"/\*\*", r"(/\w+)*").replace(r"/\*", r"(/\w+)")
    return re.fullmatch(regex, full_name, re.ASCII) is not None


def parameter_overrides(
    full_name: str, local: Arguments | None = None, global_: Arguments | None = None
) -> dict[str, Parameter]:
    """Return the parameters that command lines and files give to a node.

    Later patterns win over earlier ones, and the node's own arguments over the process's.
    """
    values: dict[str, Any] = {}
    for arguments in (global_, local):
        for pattern, parameters in arguments.parameters.items() if arguments else ():
            if _matches(pattern, full_name):
                values.update(parameters)
    return {name: Parameter(name, value=value) for name, value in values.items()}
