"""ROS 2 interfaces without generated code: message classes, CDR and type hashes, from definitions read at runtime."""

from .definition import InvalidInterfaceError, UnknownInterfaceError
from .importer import install
from .typesupport import DeserializationError, SerializationError

__all__ = ["DeserializationError", "InvalidInterfaceError", "SerializationError", "UnknownInterfaceError"]

install()
