"""The error for invalid input, in a module that imports nothing, so that nodes start quickly."""

from __future__ import annotations

from typing import NamedTuple


class Problem(NamedTuple):
    """A problem in a file or request that a model describes."""

    path: str  #: of the value or missing key, as ``events[0].fault``; empty: all of it
    #: of pydantic's errors: ``missing``, ``extra_forbidden``, ``literal_error``, ...; or
    #: ``outside`` its range, ``value_error`` where values contradict each other
    kind: str


class InputError(ValueError):
    """Invalid input from a person or a file; the message in one line: where, what, what is valid.

    ``problems`` has those that a model has found.

    Examples
    --------
    >>> import fsw
    >>> fsw.simulate("quik")
    Traceback (most recent call last):
    fsw_control.schema.errors.InputError: cannot read scenario quik: ...; did you mean quick?
    """

    def __init__(self, *words: object, problems: tuple[Problem, ...] = ()) -> None:
        super().__init__(*words)
        self.problems = problems
