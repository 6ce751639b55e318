"""Identification of the process model's parameters from recorded welds."""
