"""The service that tells peers the definition of a type."""

from __future__ import annotations

import weakref
from typing import TYPE_CHECKING, Any

from rclpy.parameter import Parameter

if TYPE_CHECKING:
    from rclpy.node import Node

START_TYPE_DESCRIPTION_SERVICE_PARAM = "start_type_description_service"


def _fill(message: Any, values: dict[str, Any]) -> Any:
    """Copy nested dictionaries and lists into a message."""
    from rosidl_embedded.typesupport import get_message

    for name, value in values.items():
        if isinstance(value, dict):
            value = _fill(getattr(message, name), value)
        elif isinstance(value, list):
            element = message.get_fields_and_field_types()[name].removeprefix("sequence<").removesuffix(">")
            value = [_fill(get_message(element.replace("/", "/msg/"))(), entry) for entry in value]
        setattr(message, name, value)
    return message


class TypeDescriptionService:
    """``~/get_type_description``, unless the parameter ``start_type_description_service`` is false."""

    def __init__(self, node: Node) -> None:
        from rcl_interfaces.msg import ParameterDescriptor, ParameterType
        from type_description_interfaces.srv import GetTypeDescription

        self._node_weak_ref = weakref.ref(node)
        self.enabled = False
        if not node.has_parameter(START_TYPE_DESCRIPTION_SERVICE_PARAM):
            descriptor = ParameterDescriptor(
                name=START_TYPE_DESCRIPTION_SERVICE_PARAM,
                type=ParameterType.PARAMETER_BOOL,
                description="If enabled, start the ~/get_type_description service.",
                read_only=True,
            )
            node.declare_parameter(START_TYPE_DESCRIPTION_SERVICE_PARAM, True, descriptor)
        parameter = node.get_parameter(START_TYPE_DESCRIPTION_SERVICE_PARAM)
        if parameter.type_ == Parameter.Type.BOOL:
            self.enabled = bool(parameter.value)
        elif parameter.type_ != Parameter.Type.NOT_SET:
            node.get_logger().error(
                f"Invalid type for parameter '{START_TYPE_DESCRIPTION_SERVICE_PARAM}' {parameter.type_!r} "
                "should be bool"
            )
        if self.enabled:
            node.create_service(GetTypeDescription, f"{node.get_name()}/get_type_description", self._callback)

    @staticmethod
    def _callback(request: Any, response: Any) -> Any:
        from type_description_interfaces.msg import TypeDescription, TypeSource

        from rosidl_embedded.description import interface_definition, type_description, type_hash

        try:
            known = type_hash(request.type_name)
            if request.type_hash and request.type_hash != known:
                raise ValueError(f"type hash {request.type_hash} is not that of this node, {known}")
            response.type_description = _fill(TypeDescription(), type_description(request.type_name))
            if request.include_type_sources:
                text = interface_definition(request.type_name)
                response.type_sources = [
                    TypeSource(type_name=request.type_name, encoding="msg", raw_file_contents=text)
                ]
            response.successful = True
        except (KeyError, LookupError, TypeError, ValueError) as error:
            response.successful = False
            response.failure_reason = f"no description of '{request.type_name}': {error}"
        return response
