"""An emulated weld as hard as the published ones."""
