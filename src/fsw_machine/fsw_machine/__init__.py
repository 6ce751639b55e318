"""Gateway to a machine: an OPC UA client that replaces the plant emulator."""
