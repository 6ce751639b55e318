"""The one error that a command shows in one line."""


class CommandError(Exception):
    """A command cannot be carried out; the text says what, where and what to do."""
