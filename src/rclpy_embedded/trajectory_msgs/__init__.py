"""Interfaces of trajectory_msgs, without generated code."""
