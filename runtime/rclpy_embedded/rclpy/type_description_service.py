"""The service that tells peers the definition of a type."""

from typing import Any

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.parameter import Parameter
from rclpy.type_hash import TypeHash
from type_description_interfaces import msg, srv

from rosidl_embedded import description

START_TYPE_DESCRIPTION_SERVICE_PARAM = "start_type_description_service"


def _individual(described: dict[str, Any]) -> msg.IndividualTypeDescription:
    fields = [msg.Field(name=field["name"], type=msg.FieldType(**field["type"])) for field in described["fields"]]
    return msg.IndividualTypeDescription(type_name=described["type_name"], fields=fields)


class TypeDescriptionService:
    """``~/get_type_description``, unless the parameter ``start_type_description_service`` is false."""

    def __init__(self, node: Any) -> None:
        if not node.has_parameter(START_TYPE_DESCRIPTION_SERVICE_PARAM):
            descriptor = ParameterDescriptor(
                name=START_TYPE_DESCRIPTION_SERVICE_PARAM,
                description="If enabled, start the ~/get_type_description service.",
                read_only=True,
            )
            node.declare_parameter(START_TYPE_DESCRIPTION_SERVICE_PARAM, True, descriptor)
        parameter = node.get_parameter(START_TYPE_DESCRIPTION_SERVICE_PARAM)
        self.enabled = parameter.value is True
        if parameter.type_ not in (Parameter.Type.BOOL, Parameter.Type.NOT_SET):
            node.get_logger().error(f"Invalid type for parameter '{parameter.name}' {parameter.type_!r} should be bool")
        if self.enabled:
            node.create_service(srv.GetTypeDescription, f"{node.get_name()}/get_type_description", self._callback)

    @staticmethod
    def _callback(request: Any, response: Any) -> Any:
        if TypeHash.from_string(request.type_hash).version < 0:
            response.failure_reason = "Failed to parse type hash"
            return response
        try:
            known = description.type_hash(request.type_name)
            if request.type_hash != known:
                raise ValueError(f"type hash {request.type_hash} is not that of this node, {known}")
            described = description.type_description(request.type_name)
            response.type_description.type_description = _individual(described["type_description"])
            referenced = described["referenced_type_descriptions"]
            response.type_description.referenced_type_descriptions = [_individual(entry) for entry in referenced]
            if request.include_type_sources:
                sources = description.type_sources(request.type_name)
                response.type_sources = [msg.TypeSource(**source) for source in sources]
            response.successful = True
        except (LookupError, ValueError) as error:
            response.failure_reason = f"no description of '{request.type_name}': {error}"
        return response
