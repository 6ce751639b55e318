"""Interfaces of unique_identifier_msgs, without generated code."""
