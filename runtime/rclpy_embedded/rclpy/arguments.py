"""ROS arguments on a command line: remapping, parameters, logging, enclave."""

import re
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from rclpy import parameter_yaml
from rclpy._rclpy_pybind11 import RCLInvalidROSArgsError, UnknownROSArgsError
from rclpy.impl.logging_severity import LoggingSeverity
from rclpy.impl.rcutils_logger import RcutilsLogger
from rclpy.names import TOKEN, RemapRule
from rclpy.parameter import Parameter

_PARAMETER_TOKEN = r"(?:[A-Za-z_/][A-Za-z0-9_]*)+"
_PARAMETER = re.compile(
    rf"(?:(?P<node>{TOKEN}):(?!=))?(?P<name>{_PARAMETER_TOKEN}(?:\.{_PARAMETER_TOKEN})*):=(?P<value>.*)", re.DOTALL
)
_FLAG = re.compile(r"--(enable|disable)-(stdout|rosout|external-lib)-logs")


@dataclass
class Arguments:
    """The ROS arguments of a command line; `remaining` are all others.

    `parameters` has the values by parameter name for each pattern of node names, patterns in order of appearance. The
    first of `remap_rules` that matches applies.
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


#: Flag with a value -> name of the value in error messages, and the function that reads it.
_OPTIONS: dict[str, tuple[str, Callable[[Arguments, str], None]]] = {
    "--remap": ("remap rule", lambda arguments, text: arguments.remap_rules.append(RemapRule.parse(text))),
    "--param": ("parameter override rule", _add_parameter),
    "--params-file": ("params file", lambda arguments, path: parameter_yaml.parse_file(path, arguments.parameters)),
    "--log-level": ("log level", _add_log_level),
    # There are no log files.
    "--log-file-name": ("log file name prefix", lambda arguments, text: None),
    "--log-config-file": ("log configuration file", lambda arguments, text: None),
    "--enclave": ("enclave name", lambda arguments, text: setattr(arguments, "enclave", text)),
}
_OPTIONS |= {"-r": _OPTIONS["--remap"], "-p": _OPTIONS["--param"], "-e": _OPTIONS["--enclave"]}


def parse(argv: Sequence[str] | None = None) -> Arguments:
    """Read a command line; None means that of the process.

    ROS arguments stand between ``--ros-args`` and ``--`` or the end; there may be several such sections. Raises
    RCLInvalidROSArgsError for a malformed one, UnknownROSArgsError for unknown ones.
    """
    arguments, unknown, in_ros = Arguments(), [], False
    argv = sys.argv if argv is None else argv
    "".join(argv).encode()  # UnicodeEncodeError if it is not UTF-8
    words = iter(argv)
    for word in words:
        if word == "--ros-args":
            in_ros = True
        elif not in_ros:
            try:
                arguments.remap_rules.append(RemapRule.parse(word))
                RcutilsLogger("rcl").warning(
                    f"Found remap rule '{word}'. This syntax is deprecated. Use '--ros-args --remap {word}' instead."
                )
            except ValueError:
                arguments.remaining.append(word)
        elif word == "--":
            in_ros = False
        elif word in _OPTIONS:
            label, take = _OPTIONS[word]
            text = next(words, None)
            problem = "Failed to parse ROS arguments: Couldn't parse"
            if text is None:
                raise RCLInvalidROSArgsError(f"{problem} trailing {word} flag. No {label} found.")
            try:
                take(arguments, text)
            except ValueError as error:
                raise RCLInvalidROSArgsError(f"{problem} {label}: '{word} {text}'. Error: {error}") from error
        elif flag := _FLAG.fullmatch(word):
            setattr(arguments, flag[2].replace("-", "_") + "_logs", flag[1] == "enable")
        else:
            unknown.append(word)
    if unknown:
        raise UnknownROSArgsError(repr(unknown))
    return arguments


def _matches(pattern: str, full_name: str) -> bool:
    """Return whether a pattern of a parameter file (``*`` one token, ``**`` any number) fits a node's full name."""
    regex = re.escape("/" + pattern.lstrip("/")).replace(r"/\*\*", r"(/\w+)*").replace(r"/\*", r"(/\w+)")
    return re.fullmatch(regex, full_name, re.ASCII) is not None


def parameter_overrides(
    full_name: str, local: Arguments | None = None, global_: Arguments | None = None
) -> dict[str, Parameter]:
    """Return the parameters that command lines and files give to a node.

    Later patterns win over earlier ones, and the node's own arguments over those of the process.
    """
    values: dict[str, Any] = {}
    for arguments in (global_, local):
        for pattern, parameters in arguments.parameters.items() if arguments else ():
            if _matches(pattern, full_name):
                values.update(parameters)
    return {name: Parameter(name, value=value) for name, value in values.items()}
