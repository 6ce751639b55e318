"""Internals that user code sometimes imports by name."""
