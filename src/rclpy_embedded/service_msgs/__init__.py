"""Interfaces of service_msgs, without generated code."""
