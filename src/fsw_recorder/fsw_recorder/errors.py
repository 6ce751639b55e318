"""The error of bag tools."""


class BagError(Exception):
    """A bag cannot be read or written; the text says what, where and what to do."""
