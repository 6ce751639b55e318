"""Interfaces of actionlib_msgs, without generated code."""
