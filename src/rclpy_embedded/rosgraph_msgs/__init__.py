"""Interfaces of rosgraph_msgs, without generated code."""
