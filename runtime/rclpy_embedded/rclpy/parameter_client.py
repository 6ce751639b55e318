"""Access to the parameters of another node."""

from collections.abc import Callable, Sequence
from typing import Any

from rcl_interfaces import msg
from rclpy.callback_groups import CallbackGroup
from rclpy.parameter import Parameter, parameter_dict_from_yaml_file
from rclpy.parameter_service import SERVICES, service_type
from rclpy.qos import QoSProfile, qos_profile_parameter_events, qos_profile_services_default
from rclpy.subscription import Subscription
from rclpy.task import Future
from rclpy.utilities import wait_until

Callback = Callable[[Future], None]
Parameters = Sequence[Parameter | msg.Parameter]


class AsyncParameterClient:
    """Calls the parameter services of another node; every call returns a Future of the service's response."""

    def __init__(
        self,
        node: Any,
        remote_node_name: str,
        qos_profile: QoSProfile = qos_profile_services_default,
        callback_group: CallbackGroup | None = None,
    ) -> None:
        self.remote_node_name = remote_node_name
        self.node = node
        options = {"qos_profile": qos_profile, "callback_group": callback_group}
        self._clients = {
            name: node.create_client(service_type(name), f"{remote_node_name}/{name}", **options) for name in SERVICES
        }

    def services_are_ready(self) -> bool:
        return all(client.service_is_ready() for client in self._clients.values())

    def wait_for_services(self, timeout_sec: float | None = None) -> bool:
        """Wait until all six services are there (None: without a limit) and return whether they are."""
        return wait_until(self.services_are_ready, timeout_sec)

    def _call(self, service: str, callback: Callback | None, **fields: Any) -> Future:
        future: Future = self._clients[service].call_async(service_type(service).Request(**fields))
        if callback:
            future.add_done_callback(callback)
        return future

    def list_parameters(
        self, prefixes: list[str] | None = None, depth: int | None = None, callback: Callback | None = None
    ) -> Future:
        """List the parameters below prefixes (None: all) down to a depth (None: any)."""
        return self._call("list_parameters", callback, prefixes=prefixes or [], depth=depth or 0)

    def get_parameters(self, names: list[str], callback: Callback | None = None) -> Future:
        return self._call("get_parameters", callback, names=names)

    def describe_parameters(self, names: list[str], callback: Callback | None = None) -> Future:
        return self._call("describe_parameters", callback, names=names)

    def get_parameter_types(self, names: list[str], callback: Callback | None = None) -> Future:
        return self._call("get_parameter_types", callback, names=names)

    def set_parameters(self, parameters: Parameters, callback: Callback | None = None) -> Future:
        """Set parameters one after the other."""
        return self._set("set_parameters", parameters, callback)

    def set_parameters_atomically(self, parameters: Parameters, callback: Callback | None = None) -> Future:
        """Set all the parameters or none."""
        return self._set("set_parameters_atomically", parameters, callback)

    def _set(self, service: str, parameters: Parameters, callback: Callback | None) -> Future:
        messages = [item.to_parameter_msg() if isinstance(item, Parameter) else item for item in parameters]
        return self._call(service, callback, parameters=messages)

    def delete_parameters(self, names: list[str], callback: Callback | None = None) -> Future:
        """Unset parameters; only dynamically typed ones can be unset."""
        return self.set_parameters([Parameter(name) for name in names], callback)

    def load_parameter_file(
        self, parameter_file: str, use_wildcard: bool = False, callback: Callback | None = None
    ) -> Future:
        """Set the parameters of a YAML file one after the other."""
        parameters = parameter_dict_from_yaml_file(parameter_file, use_wildcard)
        return self.set_parameters(list(parameters.values()), callback)

    def load_parameter_file_atomically(
        self, parameter_file: str, use_wildcard: bool = False, callback: Callback | None = None
    ) -> Future:
        """Set all the parameters of a YAML file or none."""
        parameters = parameter_dict_from_yaml_file(parameter_file, use_wildcard)
        return self.set_parameters_atomically(list(parameters.values()), callback)

    def on_parameter_event(
        self,
        callback: Callable[[msg.ParameterEvent], None],
        qos_profile: QoSProfile = qos_profile_parameter_events,
        **kwargs: Any,
    ) -> Subscription:
        """Subscribe to the changes of all parameters; further arguments are those of ``create_subscription``."""
        topic, create = "/parameter_events", self.node.create_subscription
        subscription: Subscription = create(msg.ParameterEvent, topic, callback, qos_profile, **kwargs)
        return subscription
