"""Parameters and their values."""

from __future__ import annotations

import array
from enum import Enum
from typing import Any

from rcl_interfaces import msg

PARAMETER_SEPARATOR_STRING = "."

AllowableParameterValue = (
    bool | int | float | str | list[bytes] | list[bool] | list[int] | list[float] | list[str] | tuple[Any, ...] | None
)

_ARRAYS = (list, tuple, array.array)


class Parameter:
    """A named, typed value: None, bool, int, float, str or a list, tuple or array of one of bytes and these."""

    class Type(Enum):
        """Type of a parameter; the values are those of ``rcl_interfaces/msg/ParameterType``."""

        NOT_SET = 0
        BOOL = 1
        INTEGER = 2
        DOUBLE = 3
        STRING = 4
        BYTE_ARRAY = 5
        BOOL_ARRAY = 6
        INTEGER_ARRAY = 7
        DOUBLE_ARRAY = 8
        STRING_ARRAY = 9

        @classmethod
        def from_parameter_value(cls, parameter_value: Any) -> Parameter.Type:
            """Return the type of a Python value; an empty list counts as bytes, as in ROS 2."""
            for type_ in cls:
                if type_.check(parameter_value):
                    return type_
            a_list_of = "a list of " if isinstance(parameter_value, _ARRAYS) else ""
            raise TypeError(f"The given value is not {a_list_of}one of the allowed types '{parameter_value}'.")

        def check(self, parameter_value: Any) -> bool:
            if self is Parameter.Type.NOT_SET:
                return parameter_value is None
            if self in _SCALAR_KINDS:
                return isinstance(parameter_value, _SCALAR_KINDS[self])
            kind = _ARRAY_KINDS[self]
            return isinstance(parameter_value, _ARRAYS if kind in (int, float) else (list, tuple)) and all(
                isinstance(item, kind) and (not isinstance(item, bytes) or len(item) == 1) for item in parameter_value
            )

    def __init__(self, name: str, type_: Parameter.Type | None = None, value: Any = None) -> None:
        if type_ is None:
            type_ = Parameter.Type.from_parameter_value(value)
        if not isinstance(type_, Parameter.Type):
            raise TypeError(f"type must be an instance of '{Parameter.Type!r}'")
        if not type_.check(value):
            raise ValueError(f"Type '{type_}' and value '{value}' do not agree")
        self.type_ = type_
        self.name = name
        self.value = value

    @classmethod
    def from_parameter_msg(cls, param_msg: msg.Parameter) -> Parameter:
        """Create a parameter from ``rcl_interfaces/msg/Parameter``; ValueError if its type is unknown."""
        type_ = Parameter.Type(value=param_msg.value.type)
        return cls(param_msg.name, type_, getattr(param_msg.value, _field(type_), None))

    def get_parameter_value(self) -> msg.ParameterValue:
        value = msg.ParameterValue(type=self.type_.value)
        if self.type_ is not Parameter.Type.NOT_SET:
            setattr(value, _field(self.type_), self.value)
        return value

    def to_parameter_msg(self) -> msg.Parameter:
        return msg.Parameter(name=self.name, value=self.get_parameter_value())


_SCALAR_KINDS: dict[Parameter.Type, type] = {
    Parameter.Type.BOOL: bool,
    Parameter.Type.INTEGER: int,
    Parameter.Type.DOUBLE: float,
    Parameter.Type.STRING: str,
}
_ARRAY_KINDS: dict[Parameter.Type, type] = {
    Parameter.Type.BYTE_ARRAY: bytes,
    **{Parameter.Type[f"{type_.name}_ARRAY"]: kind for type_, kind in _SCALAR_KINDS.items()},
}


def _field(type_: Parameter.Type) -> str:
    return f"{type_.name.lower()}_value"


def get_parameter_value(string_value: str) -> msg.ParameterValue:
    """Return a ParameterValue with the type that `string_value` looks like, read as YAML."""
    import yaml

    try:
        value = yaml.safe_load(string_value)
    except yaml.YAMLError:
        value = string_value
    kinds = [kind for kind in Parameter.Type if kind not in (Parameter.Type.NOT_SET, Parameter.Type.BYTE_ARRAY)]
    type_ = next((kind for kind in kinds if kind.check(value)), None)
    return Parameter("", type_, string_value if type_ is None else value).get_parameter_value()


def parameter_value_to_python(parameter_value: msg.ParameterValue) -> Any:
    """Return the value that a ParameterValue holds, arrays as lists."""
    try:
        type_ = Parameter.Type(parameter_value.type)
    except ValueError:
        raise RuntimeError(f"unexpected parameter type {parameter_value.type}") from None
    value: Any = getattr(parameter_value, _field(type_), None)
    return list(value) if type_ in _ARRAY_KINDS else value


def parameter_dict_from_yaml_file(
    parameter_file: str, use_wildcard: bool = False, target_nodes: list[str] | None = None, namespace: str = ""
) -> dict[str, msg.Parameter]:
    """Read the sections of `target_nodes` (default: all) of a parameter file into Parameter messages by name.

    With `use_wildcard` the section ``/**`` counts too, and yields to the others. `namespace` goes before every name.
    """
    import yaml

    with open(parameter_file, encoding="utf-8") as stream:
        content = yaml.safe_load(stream)
    if not isinstance(content, dict):
        raise RuntimeError(f"'{parameter_file}' is not a valid ROS parameter file: it must be a mapping of node names")
    keys = ["/**"] if use_wildcard and "/**" in content else []
    for node in target_nodes or ():
        if node not in content:
            raise RuntimeError(f"Param file does not contain parameters for {node},only for nodes: {list(content)} ")
        keys.append(node)
    if not target_nodes:
        keys.extend(key for key in content if key != "/**")
    if not keys:
        raise RuntimeError("Param file does not contain selected parameters")
    selected: dict[str, Any] = {}
    for key in keys:
        if not isinstance(content[key], dict) or "ros__parameters" not in content[key]:
            raise RuntimeError(f"YAML file is not a valid ROS parameter file for node {key}")
        selected.update(content[key]["ros__parameters"])
    return _flatten(namespace, selected)


def _flatten(prefix: str, values: dict[str, Any]) -> dict[str, msg.Parameter]:
    parameters: dict[str, msg.Parameter] = {}
    for key, value in values.items():
        name = prefix + key
        if isinstance(value, dict):
            parameters.update(_flatten(name + PARAMETER_SEPARATOR_STRING, value))
        else:
            # As in genuine rclpy, which reads the text of the value again.
            parameters[name] = msg.Parameter(name=name, value=get_parameter_value(str(value)))
    return parameters
