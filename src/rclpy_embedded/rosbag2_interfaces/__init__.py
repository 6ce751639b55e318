"""Interfaces of rosbag2_interfaces, without generated code."""
