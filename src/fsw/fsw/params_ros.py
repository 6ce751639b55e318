"""Lists, gets and sets parameters of a node by the standard parameter services."""

from __future__ import annotations

import argparse
from typing import Any

import yaml
from rclpy.exceptions import NameValidationException
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient

from fsw.errors import CommandError
from fsw.operator_node import Operator, domain_text, operator
from fsw_control.parameters import ParameterError, ParameterSpec, require_known
from fsw_control.yaml_text import load_yaml

#: type of a value on the wire: what it is called in the parameter files
_TYPES = {
    Parameter.Type.BOOL: "bool",
    Parameter.Type.INTEGER: "int",
    Parameter.Type.DOUBLE: "double",
    Parameter.Type.STRING: "string",
    Parameter.Type.DOUBLE_ARRAY: "double_array",
    Parameter.Type.STRING_ARRAY: "string_array",
}


class _RemoteParameters:
    """Parameters of a node; every call waits for the answer, CommandError when none comes."""

    def __init__(self, visit: Operator, node: str) -> None:
        self._visit, self._node = visit, node
        try:
            self._client = AsyncParameterClient(visit.node, node)
        except NameValidationException:
            raise CommandError(f"{node!r} is not the name of a node") from None
        if not visit.wait_until(self._client.services_are_ready):
            there = sorted(name for name in visit.node.get_node_names() if name != visit.node.get_name())
            raise CommandError(f"no node {node} on {domain_text()}; there are: {', '.join(there) or 'none'}")

    def _answer(self, future: Any) -> Any:
        if not self._visit.wait_until(future.done):
            raise CommandError(f"{self._node} did not answer within {self._visit.timeout_s:g} s")
        return future.result()

    def names(self) -> list[str]:
        return sorted(self._answer(self._client.list_parameters([], 0)).result.names)

    def descriptors(self, names: list[str]) -> list[Any]:
        return list(self._answer(self._client.describe_parameters(names)).descriptors)

    def values(self, names: list[str]) -> list[Any]:
        return [parameter_value_to_python(one) for one in self._answer(self._client.get_parameters(names)).values]

    def set(self, parameter: Parameter) -> None:
        [result] = self._answer(self._client.set_parameters([parameter])).results
        if not result.successful:
            raise CommandError(f"{self._node} refuses {parameter.name}: {result.reason or 'without a reason'}")


def run(arguments: argparse.Namespace) -> int:
    """Carry the command out; returns the exit code."""
    with operator(arguments.timeout) as visit:
        node = _RemoteParameters(visit, arguments.node)
        names = node.names()
        if arguments.verb == "list":
            for one, value in zip(node.descriptors(names), node.values(names), strict=True):
                print(f"{one.name}: {_text(value)}" + f"  ({one.description})" * bool(one.description))
            return 0
        require_known(names, [arguments.name])
        if arguments.verb == "set":
            [descriptor] = node.descriptors([arguments.name])
            node.set(_parameter(arguments.name, Parameter.Type(descriptor.type), arguments.value))
        print(f"{arguments.name}: {_text(node.values([arguments.name])[0])}")
    return 0


def _text(value: Any) -> str:
    shown = value if value is None or isinstance(value, str | bool | int | float) else list(value)
    return str(yaml.safe_dump(shown, default_flow_style=True, allow_unicode=True)).removesuffix("...\n").strip()


def _parameter(name: str, kind: Parameter.Type, text: str) -> Parameter:
    """The parameter from its value as YAML; a string's is taken as it is written."""
    if kind == Parameter.Type.STRING:
        return Parameter(name, kind, text)
    try:
        value = load_yaml(text)
        if kind in _TYPES:
            value = ParameterSpec(name, _TYPES[kind], None, "").check(value)
        return Parameter(name, kind, value)
    except ParameterError:
        raise
    except (yaml.YAMLError, ValueError, TypeError):
        raise CommandError(f"{name}: {text!r} is not of type {kind.name.lower()}") from None
