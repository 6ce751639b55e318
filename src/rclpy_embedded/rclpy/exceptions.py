# ruff: noqa: N818 - the names are the genuine ones
"""Exceptions of the client library, with the names and texts of the genuine ones."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rclpy._rclpy_pybind11 import InvalidHandle as InvalidHandle

if TYPE_CHECKING:
    from rclpy.parameter import Parameter


class NotInitializedException(Exception):
    """Raised when something needs a context that is not initialized or is already shut down."""

    def __init__(self, message: str | None = None) -> None:
        super().__init__("rclpy.init() has not been called." + (f" msg:{message}" if message else ""))


class ROSInterruptException(Exception):
    """Raised when an operation is cancelled by the shutdown of its context."""

    def __init__(self) -> None:
        super().__init__("rclpy.shutdown() has been called")


class NoTypeSupportImportedException(Exception):
    """Raised when there is no type support for an interface."""

    def __init__(self) -> None:
        super().__init__("no type_support imported")


class NameValidationException(Exception):
    """Raised when a name is invalid; points at the first bad character."""

    def __init__(self, name_type: str, name: str, error_msg: str, invalid_index: int) -> None:
        super().__init__(f"Invalid {name_type}: {error_msg}:\n  '{name}'\n   {' ' * invalid_index}^")


class _InvalidNameException(NameValidationException):
    """Base of the errors about one kind of name."""

    name_type = "name"

    def __init__(self, name: str, error_msg: str, invalid_index: int) -> None:
        super().__init__(self.name_type, name, error_msg, invalid_index)


class InvalidNamespaceException(_InvalidNameException):
    """Raised when a namespace is invalid."""

    name_type = "namespace"


class InvalidNodeNameException(_InvalidNameException):
    """Raised when a node name is invalid."""

    name_type = "node name"


class InvalidTopicNameException(_InvalidNameException):
    """Raised when a topic name is invalid."""

    name_type = "topic name"


class InvalidServiceNameException(_InvalidNameException):
    """Raised when a service name is invalid."""

    name_type = "service name"


class ParameterException(Exception):
    """Base of the errors about parameters."""

    def __init__(self, error_msg: str, parameters: str | list[str]) -> None:
        super().__init__(f"{error_msg}: {parameters}")


class ParameterNotDeclaredException(ParameterException):
    """Raised when an undeclared parameter is used where that is not allowed."""

    def __init__(self, parameters: str | list[str]) -> None:
        super().__init__("Invalid access to undeclared parameter(s)", parameters)


class ParameterAlreadyDeclaredException(ParameterException):
    """Raised when a parameter is declared twice."""

    def __init__(self, parameters: str | list[str]) -> None:
        super().__init__("Parameter(s) already declared", parameters)


class InvalidParameterException(ParameterException):
    """Raised when a parameter is declared with an invalid name."""

    def __init__(self, parameter_name: str) -> None:
        super().__init__("Invalid parameter name", parameter_name)


class InvalidParameterTypeException(ParameterException):
    """Raised when a parameter is declared with a value of another type than it has."""

    def __init__(self, desired_parameter: Parameter, expected_type: Any) -> None:
        super().__init__(
            f"Trying to set parameter '{desired_parameter.name}' to '{desired_parameter.value}'"
            f" of type '{desired_parameter.type_.name}', expecting type '{expected_type}'",
            desired_parameter.name,
        )


class InvalidParameterValueException(ParameterException):
    """Raised when a value is refused by a callback or by the parameter's descriptor."""

    def __init__(self, parameter: str, value: Any, reason: str) -> None:
        super().__init__(f"Invalid parameter value ({value}) for parameter. Reason: {reason}", parameter)


class ParameterImmutableException(ParameterException):
    """Raised when a read-only parameter is modified."""

    def __init__(self, parameter_name: str) -> None:
        super().__init__("Attempted to modify read-only parameter", parameter_name)


class ParameterUninitializedException(ParameterException):
    """Raised when a statically typed parameter is read before it has a value."""

    def __init__(self, parameter_name: str) -> None:
        super().__init__(f"The parameter '{parameter_name}' is not initialized", parameter_name)
