"""Interfaces of diagnostic_msgs, without generated code."""
