"""Interfaces of statistics_msgs, without generated code."""
