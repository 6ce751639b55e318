"""Interfaces of std_msgs, without generated code."""
