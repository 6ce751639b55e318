"""Interfaces of rcl_interfaces, without generated code."""
