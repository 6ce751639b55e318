"""The one error of wrong input, without what models need: a node that reads only parameters starts sooner."""


class InputError(ValueError):
    """Invalid input from a person or a file; the message is one line: where, what, and what is allowed."""
