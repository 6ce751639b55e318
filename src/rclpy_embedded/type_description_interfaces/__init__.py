"""Interfaces of type_description_interfaces, without generated code."""
