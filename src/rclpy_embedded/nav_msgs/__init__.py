"""Interfaces of nav_msgs, without generated code."""
