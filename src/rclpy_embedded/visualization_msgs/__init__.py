"""Interfaces of visualization_msgs, without generated code."""
