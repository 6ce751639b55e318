"""Parameter values and parameter files in YAML, by the rules of rcl_yaml_param_parser.

Those differ from plain YAML: ``on``, ``yes`` and ``y`` are booleans, ``0x1f`` and ``017`` integers, ``1e3`` is a float,
a sequence has one type, and a key that comes twice adds to the first.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

from rclpy.constants import INT64_MAX, INT64_MIN
from rclpy.names import namespace_error, node_name_error

PARAMETERS_KEY = "ros__parameters"

_BOOLEANS = {
    spelling: value
    for words, value in ((("y", "yes", "true", "on"), True), (("n", "no", "false", "off"), False))
    for word in words
    for spelling in (word, word.capitalize(), word.upper())
}
_INTEGER = re.compile(r"([+-]?)(?:0[xX]([0-9a-fA-F]+)|0([0-7]*)|([1-9][0-9]*))")
_FLOAT = re.compile(r"[+-]?(?:(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?|\.?inf|infinity|\.?nan)", re.IGNORECASE)


def _integer(text: str) -> int | None:
    if not (match := _INTEGER.fullmatch(text)):
        return None
    sign, hexadecimal, octal, decimal = match.groups()
    value = int(hexadecimal, 16) if hexadecimal else int(decimal) if decimal else int(octal or "0", 8)
    value = -value if sign == "-" else value
    return value if INT64_MIN <= value <= INT64_MAX else None


def _scalar(event: Any) -> bool | int | float | str:
    """Return the typed value of a scalar event; quotes and the tag ``!!str`` make a string."""
    text: str = event.value
    if event.style in ("'", '"') or event.tag == "tag:yaml.org,2002:str":
        return text
    if not text:
        raise ValueError(f"No value at line {event.start_mark.line + 1}")
    if text in _BOOLEANS:
        return _BOOLEANS[text]
    if (integer := _integer(text)) is not None:
        return integer
    if _FLOAT.fullmatch(text):
        return float(re.sub(r"\.(inf|nan)", r"\1", text, flags=re.IGNORECASE))
    return text


class _Mapping(list[tuple[str, Any]]):
    """A YAML mapping with its repeated keys."""


def _sequence(events: Iterator[Any], line: int) -> list[Any]:
    import yaml

    items: list[Any] = []
    while not isinstance(event := next(events), yaml.SequenceEndEvent):
        if not isinstance(event, yaml.ScalarEvent):
            raise ValueError(f"Sequences can only hold plain values. Error at line {event.start_mark.line + 1}")
        items.append(_scalar(event))
    if len({type(item) for item in items}) > 1:
        raise ValueError(f"Sequence should be of same type. Error at line {line}")
    return items


def _node(events: Iterator[Any], event: Any) -> Any:
    import yaml

    line = event.start_mark.line + 1
    if isinstance(event, yaml.ScalarEvent):
        return _scalar(event)
    if isinstance(event, yaml.SequenceStartEvent):
        return _sequence(events, line)
    if not isinstance(event, yaml.MappingStartEvent):
        raise ValueError(f"Will not support aliasing at line {line}")
    mapping = _Mapping()
    while not isinstance(key := next(events), yaml.MappingEndEvent):
        if not isinstance(key, yaml.ScalarEvent) or not key.value:
            raise ValueError(f"No key at line {key.start_mark.line + 1}")
        mapping.append((key.value, _node(events, next(events))))
    return mapping


def _parse(text: str) -> Any:
    """Return the only document of `text`; None if there is none. ValueError if it cannot be used."""
    import yaml

    try:
        events: Any = yaml.parse(text, Loader=yaml.SafeLoader)
        for event in events:
            if isinstance(event, yaml.NodeEvent):
                value = _node(events, event)
                for rest in events:
                    if isinstance(rest, yaml.NodeEvent):
                        raise ValueError("There is more than one document")
                return value
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f" near line {mark.line + 1}" if mark else ""
        raise ValueError(f"Error parsing YAML{where}: {getattr(error, 'problem', None) or error}") from error
    return None


def parse_value(text: str) -> Any:
    """Return the value written in `text`, as in ``-p name:=text``; an empty list has no type and becomes None.

    Raises
    ------
    ValueError
        If `text` is empty, not YAML, or not a plain value or a list of values of one type.
    """
    value = _parse(text)
    if value is None:
        raise ValueError("the value is empty")
    if isinstance(value, _Mapping):
        raise ValueError("a mapping is not a parameter value")
    return None if value == [] else value


def _check_node_pattern(name: str) -> None:
    *namespace, node = name.split("/")
    absolute = "/" + "/".join(part for part in namespace if part not in ("", "*", "**"))
    error = namespace_error(absolute) or (None if node in ("*", "**") else node_name_error(node))
    if error:
        raise ValueError(f"'{name}' is no name of a node: {error[0]}")


def _flatten(prefix: str, mapping: _Mapping, into: dict[str, Any]) -> None:
    for key, value in mapping:
        if isinstance(value, _Mapping):
            _flatten(f"{prefix}{key}.", value, into)
        else:
            into[prefix + key] = None if value == [] else value


def _collect(name: str, mapping: _Mapping, into: dict[str, dict[str, Any]]) -> None:
    for key, value in mapping:
        if key == PARAMETERS_KEY:
            if not name:
                raise ValueError(f"There are no node names before {PARAMETERS_KEY}")
            if not isinstance(value, _Mapping):
                raise ValueError(f"{PARAMETERS_KEY} of '{name}' must be a mapping of names to values")
            _check_node_pattern(name)
            _flatten("", value, into.setdefault(name, {}))
        elif isinstance(value, _Mapping):
            _collect(f"{name.rstrip('/')}/{key.lstrip('/')}" if name else key, value, into)
        else:
            raise ValueError(f"Cannot have a value before {PARAMETERS_KEY}: '{key}' below '{name or '/'}'")


def parse_file(path: str, into: dict[str, dict[str, Any]]) -> None:
    """Add the parameters of a file to `into`: pattern of the node's full name -> parameter -> value.

    Raises
    ------
    ValueError
        If the file cannot be read or is no parameter file.
    """
    try:
        with open(path, encoding="utf-8") as stream:
            text = stream.read()
    except (OSError, UnicodeDecodeError) as error:
        raise ValueError(f"Error opening YAML file '{path}': {error}") from error
    root = _parse(text)
    if root is None:
        return
    if not isinstance(root, _Mapping):
        raise ValueError(f"'{path}' must be a mapping of node names")
    _collect("", root, into)
