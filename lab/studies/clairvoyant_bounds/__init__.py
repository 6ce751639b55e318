"""The least errors that any controller could reach in the standard events."""
