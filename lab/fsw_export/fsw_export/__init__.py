"""Controllers and plant for use outside ROS 2: C99 for a PLC, FMUs."""
