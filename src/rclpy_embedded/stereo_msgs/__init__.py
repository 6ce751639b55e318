"""Interfaces of stereo_msgs, without generated code."""
