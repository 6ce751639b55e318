"""Gateway to a machine: an OPC UA client in place of the plant emulator."""
