"""Interfaces of action_msgs, without generated code."""
