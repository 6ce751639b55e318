"""Parameters and life cycle of a running node, by the standard services."""

from __future__ import annotations

import argparse
from typing import Any

import yaml
from lifecycle_msgs.srv import ChangeState, GetAvailableTransitions, GetState
from pydantic import ConfigDict, TypeAdapter
from rclpy.exceptions import NameValidationException
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient

from fsw.console import print_table
from fsw.errors import CommandError
from fsw.operator_node import ErrorLines, Operator, domain_text, graph_text, operator
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


def parameters(arguments: argparse.Namespace) -> int:
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


_GET_STATE = "/get_state"
_TYPE = "lifecycle_msgs/srv/GetState"


def lifecycle(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    with operator(arguments) as node:
        managed = _managed(node, arguments.node)
        if not arguments.node:
            print_table([(name, _state(node, name)) for name in managed], ("node", "state"))
            return 0
        if arguments.node not in managed:
            there = f"there are: {', '.join(managed) or 'none'}"
            raise CommandError(f"no managed node {arguments.node} on {graph_text(node)}; {there}")
        if arguments.verb == "set":
            _change(node, arguments.node, arguments.transition)
        if arguments.verb == "list":
            print_table(
                [(label, goal) for label, (_, goal) in _transitions(node, arguments.node).items()]
            )
        else:
            print(f"{arguments.node}: {_state(node, arguments.node)}")
    return 0


def _managed(node: Operator, required: str) -> list[str]:
    """Names of the namespace's managed nodes, once the requested one, or any, is found."""
    home = node.node.get_namespace().rstrip("/") + "/"

    def found() -> list[str]:
        services = node.node.get_service_names_and_types()
        names = [name for name, kinds in services if _TYPE in kinds and name.startswith(home)]
        short = [name.removeprefix(home).removesuffix(_GET_STATE) for name in names]
        return sorted(name for name in short if "/" not in name)

    node.wait_until(lambda: required in found() if required else found())
    return found()


def _state(node: Operator, name: str) -> str:
    return str(node.call(GetState, f"{name}{_GET_STATE}", GetState.Request()).current_state.label)


def _transitions(node: Operator, name: str) -> dict[str, tuple[int, str]]:
    """Transitions that are possible now by label: identifier and resulting state."""
    request = GetAvailableTransitions.Request()
    answer = node.call(GetAvailableTransitions, f"{name}/get_available_transitions", request)
    return {
        way.transition.label: (way.transition.id, way.goal_state.label)
        for way in answer.available_transitions
    }


def _change(node: Operator, name: str, label: str) -> None:
    # checked first: a request that does not fit the state is an error in the node
    known = _transitions(node, name)
    if label not in known:
        has = ", ".join(known) or "none"
        raise CommandError(
            f"{name} is {_state(node, name)} and has no transition {label} now; has {has}"
        )
    logs = ErrorLines(node, name)
    request: Any = ChangeState.Request()
    request.transition.id, request.transition.label = known[label][0], label
    if not node.call(ChangeState, f"{name}/change_state", request).success:
        raise CommandError(logs.last() or f"{name} cannot {label}; its log says why")
