"""Interfaces of builtin_interfaces, without generated code."""
