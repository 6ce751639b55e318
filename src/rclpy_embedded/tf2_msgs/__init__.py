"""Interfaces of tf2_msgs, without generated code."""
