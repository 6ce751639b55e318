# ruff: noqa: N818 - the names are the genuine ones
"""Exceptions of the client library, with the names and texts of the genuine ones."""

from typing import Any

from rclpy._rclpy_pybind11 import InvalidHandle as InvalidHandle


class NotInitializedException(Exception):
    """A context is not initialized or is shut down."""

    def __init__(self, message: str | None = None) -> None:
        super().__init__("rclpy.init() has not been called." + (f" msg:{message}" if message else ""))


class ROSInterruptException(Exception):
    """The context was shut down during an operation."""

    def __init__(self) -> None:
        super().__init__("rclpy.shutdown() has been called")


class NoTypeSupportImportedException(Exception):
    """An interface has no type support here."""

    def __init__(self) -> None:
        super().__init__("no type_support imported")


class NameValidationException(Exception):
    """A name is invalid; the text points at the first bad character."""

    def __init__(self, name_type: str, name: str, error_msg: str, invalid_index: int) -> None:
        super().__init__(f"Invalid {name_type}: {error_msg}:\n  '{name}'\n   {' ' * invalid_index}^")


class _InvalidNameException(NameValidationException):
    name_type = "name"

    def __init__(self, name: str, error_msg: str, invalid_index: int) -> None:
        super().__init__(self.name_type, name, error_msg, invalid_index)


class InvalidNamespaceException(_InvalidNameException):
    name_type = "namespace"


class InvalidNodeNameException(_InvalidNameException):
    name_type = "node name"


class InvalidTopicNameException(_InvalidNameException):
    name_type = "topic name"


class InvalidServiceNameException(_InvalidNameException):
    name_type = "service name"


class ParameterException(Exception):
    """Base of the errors about parameters."""

    def __init__(self, error_msg: str, parameters: str | list[str]) -> None:
        super().__init__(f"{error_msg}: {parameters}")


class _NamedParameterException(ParameterException):
    text = ""

    def __init__(self, parameters: str | list[str]) -> None:
        super().__init__(self.text.format(parameters), parameters)


class ParameterNotDeclaredException(_NamedParameterException):
    text = "Invalid access to undeclared parameter(s)"


class ParameterAlreadyDeclaredException(_NamedParameterException):
    text = "Parameter(s) already declared"


class InvalidParameterException(_NamedParameterException):
    text = "Invalid parameter name"


class ParameterImmutableException(_NamedParameterException):
    text = "Attempted to modify read-only parameter"


class ParameterUninitializedException(_NamedParameterException):
    text = "The parameter '{}' is not initialized"


class InvalidParameterTypeException(ParameterException):
    """A parameter is declared with a value of another type than it has."""

    def __init__(self, desired_parameter: Any, expected_type: Any) -> None:
        name, value, type_ = desired_parameter.name, desired_parameter.value, desired_parameter.type_.name
        text = f"Trying to set parameter '{name}' to '{value}' of type '{type_}', expecting type '{expected_type}'"
        super().__init__(text, name)


class InvalidParameterValueException(ParameterException):
    """A value is refused by a callback or by the parameter's descriptor."""

    def __init__(self, parameter: str, value: Any, reason: str) -> None:
        super().__init__(f"Invalid parameter value ({value}) for parameter. Reason: {reason}", parameter)
