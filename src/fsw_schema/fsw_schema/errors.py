"""The error for invalid input, in a module that imports nothing, so that nodes start quickly."""


class InputError(ValueError):
    """Invalid input from a person or a file; one line: where, what, and what is allowed."""
