"""Interfaces of shape_msgs, without generated code."""
