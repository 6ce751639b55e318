"""Interfaces of lifecycle_msgs, without generated code."""
