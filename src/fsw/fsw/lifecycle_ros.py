"""Lists managed nodes, gets their states and requests transitions by the standard services."""

from __future__ import annotations

import argparse
from typing import Any

from lifecycle_msgs.srv import ChangeState, GetAvailableTransitions, GetState

from fsw.console import print_table
from fsw.errors import CommandError
from fsw.operator_node import ErrorLines, Operator, graph_text, operator

_GET_STATE = "/get_state"
_TYPE = "lifecycle_msgs/srv/GetState"


def run(arguments: argparse.Namespace) -> int:
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
