"""Messages of fsw_msgs, made when they are first asked for."""

from rosidl_embedded.importer import lazy_interfaces

__getattr__, __dir__ = lazy_interfaces(__name__)
