"""Collects the parameters of the graph's nodes without blocking."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import yaml
from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python

_TRIES = 30


class ParameterSnapshots:
    """Requests the parameters of each node that ``selects`` accepts (by full name) once.

    ``report`` is called with the full name and the parameters as the YAML of a ROS parameter file.
    """

    def __init__(
        self, node: Node, report: Callable[[str, str], None], selects: Callable[[str], bool]
    ) -> None:
        self._node = node
        self._report, self._selects = report, selects
        self._waiting: dict[str, tuple[Any, Any, int]] = {}
        self._known = {node.get_fully_qualified_name()}

    def look_for_nodes(self) -> None:
        """Query new nodes, and those without parameter services so far; call it regularly."""
        for name, namespace in self._node.get_node_names_and_namespaces():
            full_name = f"{namespace.rstrip('/')}/{name}"
            if full_name not in self._known and self._selects(full_name):
                self._known.add(full_name)
                lister = self._node.create_client(ListParameters, f"{full_name}/list_parameters")
                getter = self._node.create_client(GetParameters, f"{full_name}/get_parameters")
                self._waiting[full_name] = (lister, getter, _TRIES)
        for full_name, (lister, getter, tries) in list(self._waiting.items()):
            self._waiting[full_name] = (lister, getter, tries - 1)
            if lister.service_is_ready() and getter.service_is_ready():
                del self._waiting[full_name]
                self._ask(full_name, lister, getter)
            elif tries == 0:
                del self._waiting[full_name]
                self._forget(lister, getter)

    def _ask(self, full_name: str, lister: Any, getter: Any) -> None:
        def listed(future: Any) -> None:
            names = list(future.result().result.names) if future.exception() is None else []
            if names:
                answer = getter.call_async(GetParameters.Request(names=names))
                answer.add_done_callback(lambda future: on_values(names, future))
            else:
                self._forget(lister, getter)

        def on_values(names: list[str], future: Any) -> None:
            if future.exception() is None:
                values = [
                    _plain(parameter_value_to_python(value)) for value in future.result().values
                ]
                contents = {full_name: {"ros__parameters": dict(zip(names, values, strict=False))}}
                self._report(full_name, yaml.safe_dump(contents, allow_unicode=True))
            self._forget(lister, getter)

        lister.call_async(ListParameters.Request()).add_done_callback(listed)

    def _forget(self, *clients: Any) -> None:
        for client in clients:
            self._node.destroy_client(client)


def _plain(value: Any) -> Any:
    """Convert to plain Python for YAML: arrays become lists, bytes numbers."""
    if value is None or isinstance(value, str | bool | int | float):
        return value
    return [_plain(item) for item in value]
