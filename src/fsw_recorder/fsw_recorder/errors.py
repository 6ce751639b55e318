"""The one error that bag tools raise."""


class BagError(Exception):
    """A bag cannot be read or written; the text says what, where and what to do."""
