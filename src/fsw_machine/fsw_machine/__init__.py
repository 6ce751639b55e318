"""Gateway to a machine: OPC UA client in place of the plant emulator."""
