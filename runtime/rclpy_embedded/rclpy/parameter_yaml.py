"""Parameter values and parameter files in YAML, by the rules of rcl_yaml_param_parser.

Those differ from plain YAML: ``on``, ``yes`` and ``y`` are booleans, ``0x1f`` and ``017`` integers, ``1e3`` is a float,
a sequence has one type, and a key that comes twice adds to the first.
"""

import re
from collections.abc import Iterator
from typing import Any

from rclpy.constants import INT64_MAX, INT64_MIN
from rclpy.exceptions import NameValidationException
from rclpy.names import validate_namespace, validate_node_name

PARAMETERS_KEY = "ros__parameters"
_STRING = "tag:yaml.org,2002:str"

_BOOLEANS = {
    spelling: value
    for words, value in ((("y", "yes", "true", "on"), True), (("n", "no", "false", "off"), False))
    for word in words
    for spelling in (word, word.capitalize(), word.upper())
}
_INTEGER = re.compile(r"[+-]?(?:(?P<hexadecimal>0[xX][0-9a-fA-F]+)|(?P<octal>0[0-7]*)|[1-9][0-9]*)")
_FLOAT = re.compile(r"[+-]?(?:(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?|\.?inf|infinity|\.?nan)", re.IGNORECASE)


def _integer(text: str) -> int | None:
    if not (match := _INTEGER.fullmatch(text)):
        return None
    value = int(text, 16 if match["hexadecimal"] else 8 if match["octal"] else 10)
    return value if INT64_MIN <= value <= INT64_MAX else None


def _scalar(node: Any) -> bool | int | float | str:
    text: str = node.value
    if not text and (node.tag != _STRING or node.style in ("|", ">")):
        raise ValueError(f"No value at line {node.start_mark.line + 1}")
    if node.tag == _STRING:
        return text
    if text in _BOOLEANS:
        return _BOOLEANS[text]
    if (integer := _integer(text)) is not None:
        return integer
    if _FLOAT.fullmatch(text):
        return float(re.sub(r"\.(inf|nan)", r"\1", text, flags=re.IGNORECASE))
    return text


def _value(node: Any) -> Any:
    """Return the typed value of a scalar or sequence; an empty one has no type and becomes None."""
    if node.id == "scalar":
        return _scalar(node)
    for item in node.value:
        if item.id != "scalar":
            raise ValueError(f"Sequences can only hold plain values. Error at line {item.start_mark.line + 1}")
    items = [_scalar(item) for item in node.value]
    if len({type(item) for item in items}) > 1:
        raise ValueError(f"Sequence should be of same type. Error at line {node.start_mark.line + 1}")
    return items or None


def _items(mapping: Any) -> Iterator[tuple[str, Any]]:
    for key, value in mapping.value:
        if key.id != "scalar" or not key.value:
            raise ValueError(f"No key at line {key.start_mark.line + 1}")
        yield key.value, value


def _compose(text: str) -> Any:
    """Return the root node of the only document of `text`; None if there is none. ValueError if it cannot be used."""
    import yaml

    class Loader(yaml.SafeLoader):
        """Leaves plain scalars without the types of YAML; quotes and the tag ``!!str`` still make strings."""

        def resolve(self, kind: Any, value: Any, implicit: Any) -> Any:
            plain = implicit == (True, False)
            return "" if plain else super().resolve(kind, value, implicit)  # type: ignore[no-untyped-call]

        def compose_node(self, parent: Any, index: Any) -> Any:
            event: Any = self.peek_event()  # type: ignore[no-untyped-call]
            if self.check_event(yaml.AliasEvent):
                raise ValueError(f"Will not support aliasing at line {event.start_mark.line + 1}")
            return super().compose_node(parent, index)

    try:
        return yaml.compose(text, Loader)
    except yaml.YAMLError as error:
        mark: Any = getattr(error, "problem_mark", None)
        where = f" near line {mark.line + 1}" if mark else ""
        raise ValueError(f"Error parsing YAML{where}: {getattr(error, 'problem', None) or error}") from error


def parse_value(text: str) -> Any:
    """Return the value written in `text`, as in ``-p name:=text``; an empty list has no type and becomes None."""
    node = _compose(text)
    if node is None:
        raise ValueError("the value is empty")
    if node.id == "mapping":
        raise ValueError("a mapping is not a parameter value")
    return _value(node)


def _check_node_pattern(name: str) -> None:
    *namespace, node = name.split("/")
    absolute = "/" + "/".join(part for part in namespace if part not in ("", "*", "**"))
    try:
        validate_namespace(absolute)
        validate_node_name("any" if node in ("*", "**") else node)
    except NameValidationException as error:
        raise ValueError(f"'{name}' is no name of a node: {error}") from None


def _flatten(prefix: str, mapping: Any, into: dict[str, Any]) -> None:
    for key, value in _items(mapping):
        if value.id == "mapping":
            _flatten(f"{prefix}{key}.", value, into)
        else:
            into[prefix + key] = _value(value)


def _collect(name: str, mapping: Any, into: dict[str, dict[str, Any]]) -> None:
    for key, value in _items(mapping):
        if key == PARAMETERS_KEY:
            if not name:
                raise ValueError(f"There are no node names before {PARAMETERS_KEY}")
            if value.id != "mapping":
                raise ValueError(f"{PARAMETERS_KEY} of '{name}' must be a mapping of names to values")
            _check_node_pattern(name)
            _flatten("", value, into.setdefault(name, {}))
        elif value.id == "mapping":
            _collect(f"{name.rstrip('/')}/{key.lstrip('/')}" if name else key, value, into)
        else:
            raise ValueError(f"Cannot have a value before {PARAMETERS_KEY}: '{key}' below '{name or '/'}'")


def parse_file(path: str, into: dict[str, dict[str, Any]]) -> None:
    """Add the parameters of a file to `into`: pattern of the node's full name -> parameter -> value."""
    try:
        with open(path, encoding="utf-8") as stream:
            root = _compose(stream.read())
    except (OSError, UnicodeDecodeError) as error:
        raise ValueError(f"Error opening YAML file '{path}': {error}") from error
    if root is None:
        return
    if root.id != "mapping":
        raise ValueError(f"'{path}' must be a mapping of node names")
    _collect("", root, into)
