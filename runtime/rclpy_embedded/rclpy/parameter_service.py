"""The services through which other nodes reach a node's parameters."""

import weakref
from contextlib import suppress
from typing import Any

from rcl_interfaces import msg, srv
from rclpy.exceptions import ParameterNotDeclaredException, ParameterUninitializedException
from rclpy.parameter import Parameter
from rclpy.qos import qos_profile_parameters

#: Each has the type of its name: that of ``set_parameters`` is ``SetParameters``.
SERVICES = (
    "describe_parameters",
    "get_parameters",
    "get_parameter_types",
    "list_parameters",
    "set_parameters",
    "set_parameters_atomically",
)


def service_type(name: str) -> Any:
    return getattr(srv, name.title().replace("_", ""))


class ParameterService:
    """The six parameter services of a node."""

    def __init__(self, node: Any) -> None:
        self._node_weak_ref = weakref.ref(node)
        for name in SERVICES:
            callback, full_name = getattr(self, f"_{name}_callback"), f"{node.get_name()}/{name}"
            node.create_service(service_type(name), full_name, callback, qos_profile=qos_profile_parameters)

    def _node(self) -> Any:
        node = self._node_weak_ref()
        if node is None:
            raise ReferenceError("Expected valid node weak reference")
        return node

    # One unknown name leaves the whole answer empty: that is how a client sees that something was wrong.

    def _describe_parameters_callback(self, request: Any, response: Any) -> Any:
        with suppress(ParameterNotDeclaredException):
            response.descriptors = self._node().describe_parameters(list(request.names))
        return response

    def _get_parameters_callback(self, request: Any, response: Any) -> Any:
        with suppress(ParameterNotDeclaredException, ParameterUninitializedException):
            parameters = self._node().get_parameters(list(request.names))
            response.values = [parameter.get_parameter_value() for parameter in parameters]
        return response

    def _get_parameter_types_callback(self, request: Any, response: Any) -> Any:
        with suppress(ParameterNotDeclaredException):
            types = self._node().get_parameter_types(list(request.names))
            response.types = [type_.value if isinstance(type_, Parameter.Type) else type_ for type_ in types]
        return response

    def _list_parameters_callback(self, request: Any, response: Any) -> Any:
        response.result = self._node().list_parameters(list(request.prefixes), int(request.depth))
        return response

    def _set(self, messages: list[msg.Parameter]) -> Any:
        try:
            parameters = [Parameter.from_parameter_msg(message) for message in messages]
            return self._node().set_parameters_atomically(parameters)
        except (ParameterNotDeclaredException, ValueError) as error:
            # ValueError: a type of parameter that does not exist.
            return msg.SetParametersResult(successful=False, reason=str(error))

    def _set_parameters_callback(self, request: Any, response: Any) -> Any:
        response.results = [self._set([message]) for message in request.parameters]
        return response

    def _set_parameters_atomically_callback(self, request: Any, response: Any) -> Any:
        response.result = self._set(list(request.parameters))
        return response
