"""Lists, gets and sets parameters of a node by the standard parameter services."""

from __future__ import annotations

import argparse
from typing import Any

import yaml
from pydantic import ConfigDict, TypeAdapter
from rclpy.exceptions import NameValidationException
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient

from fsw.console import print_table
from fsw.errors import CommandError
from fsw.operator_node import Operator, domain_text, operator
from fsw_control.parameters import require_known
from fsw_control.schema.models import Whole
from fsw_control.schema.yaml_text import load_yaml

#: by type of a value on the wire: the one that it must have
_TYPES: dict[Parameter.Type, Any] = {
    Parameter.Type.BOOL: bool,
    Parameter.Type.INTEGER: Whole,
    Parameter.Type.DOUBLE: float,
    Parameter.Type.DOUBLE_ARRAY: list[float],
    Parameter.Type.STRING_ARRAY: list[str],
}


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    with operator(arguments) as node:
        client = client_of(node, arguments.node)

        def answer(future: Any) -> Any:
            return node.answer(future, arguments.node)

        def values(names: list[str]) -> list[str]:
            return [
                _text(parameter_value_to_python(value))
                for value in answer(client.get_parameters(names)).values
            ]

        names = sorted(answer(client.list_parameters([], 0)).result.names)
        if arguments.verb == "list":
            descriptors = answer(client.describe_parameters(names)).descriptors
            rows = zip(names, values(names), (row.description for row in descriptors), strict=True)
            print_table([*rows], ("parameter", "value", "meaning"))
            return 0
        require_known(names, [arguments.name])
        if arguments.verb == "set":
            [descriptor] = answer(client.describe_parameters([arguments.name])).descriptors
            change = _parameter(arguments.name, Parameter.Type(descriptor.type), arguments.value)
            [result] = answer(client.set_parameters([change])).results
            if not result.successful:
                reason = result.reason or "without a reason"
                raise CommandError(f"{arguments.node} refuses {arguments.name}: {reason}")
        print(f"{arguments.name}: {values([arguments.name])[0]}")
    return 0


def client_of(node: Operator, name: str) -> AsyncParameterClient:
    """Client of a node's parameters; CommandError if there is no such node."""
    try:
        client = AsyncParameterClient(node.node, name)
    except NameValidationException:
        raise CommandError(f"{name!r} is not the name of a node") from None
    if not node.wait_until(client.services_are_ready):
        others = sorted(node.node_names() - {node.node.get_name()})
        raise CommandError(
            f"no node {name} on {domain_text()}; there are: {', '.join(others) or 'none'}"
        )
    return client


def _text(value: Any) -> str:
    shown = value if value is None or isinstance(value, str | bool | int | float) else list(value)
    return (
        str(yaml.safe_dump(shown, default_flow_style=True, allow_unicode=True))
        .removesuffix("...\n")
        .strip()
    )


def _parameter(name: str, kind: Parameter.Type, text: str) -> Parameter:
    """Parameter from its value as YAML; the value of a string is taken literally."""
    if kind == Parameter.Type.STRING:
        return Parameter(name, kind, text)
    try:
        value = load_yaml(text)
        if kind in _TYPES:
            config = ConfigDict(strict=True, allow_inf_nan=False)
            value = TypeAdapter(_TYPES[kind], config=config).validate_python(value)
        return Parameter(name, kind, value)
    except (yaml.YAMLError, ValueError, TypeError):
        raise CommandError(f"{name}: {text!r} is not of type {kind.name.lower()}") from None
