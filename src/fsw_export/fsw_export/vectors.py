"""Test vectors: what a controller was given and what it answered, tick by tick, during a weld."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any, Protocol

from fsw_export.signals import Signal


class CLibrary(Protocol):
    """A loaded controller library."""

    input: Any
    output: Any

    def step(self) -> None:
        """One tick: ``input`` to ``output``."""
        ...


class VectorRecorder:
    """Notes input and output of every step of a library.

    Parameters
    ----------
    library : CLibrary
        Its ``step`` is replaced.
    inputs, outputs : sequence of Signal

    Attributes
    ----------
    ticks, answers : list of tuple of float
        A row of values per step, in the order of the signals.
    """

    def __init__(self, library: CLibrary, inputs: Sequence[Signal], outputs: Sequence[Signal]) -> None:
        self.ticks: list[tuple[float, ...]] = []
        self.answers: list[tuple[float, ...]] = []
        step = library.step

        def noted() -> None:
            if hasattr(library.input, "n_changes"):
                library.input.n_changes = min(library.input.n_changes, 1)  # the files have room for one
            self.ticks.append(_row(library.input, inputs))
            step()
            self.answers.append(_row(library.output, outputs))

        library.step = noted  # type: ignore[method-assign]


def _row(struct: Any, signals: Sequence[Signal]) -> tuple[float, ...]:
    return tuple(_member(struct, signal.in_c) for signal in signals)


def _member(struct: Any, designator: str) -> Any:
    """Value of a member such as ``change[0].at_s``."""
    value = struct
    for name, index in re.findall(r"(\w+)(?:\[(\d+)\])?", designator):
        value = getattr(value, name)
        if index:
            value = value[int(index)]
    return value


def csv_text(signals: Sequence[Signal], rows: Sequence[Sequence[float]]) -> str:
    """The rows as CSV, numbers exactly, the first line naming the signals."""
    lines = [",".join(signal.name for signal in signals)]
    lines += [",".join(repr(value) for value in row) for row in rows]
    return "\n".join(lines) + "\n"
