"""The error of this package."""


class ExportError(RuntimeError):
    """An export is not possible; the message says what, where and what to do."""
