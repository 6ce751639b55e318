"""Interfaces of sensor_msgs, without generated code."""
