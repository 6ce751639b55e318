"""Interfaces of geometry_msgs, without generated code."""
