"""Test vectors: a controller's inputs and outputs, tick by tick, during a weld."""

from __future__ import annotations

import random
import re
from collections.abc import Callable, Sequence
from math import inf, nan
from typing import Any

from fsw_control.c_library import CController
from fsw_control.schema.models import InputError
from fsw_export.choice import Choice, render
from fsw_export.signals import Signal
from fsw_export.sources import ControllerSources, sources_of
from fsw_model import OperatingPointError
from fsw_scenario.closed_loop import ClosedLoop
from fsw_scenario.controllers import make
from fsw_scenario.scenario_file import parse

#: ticks of the vectors with faults; share of the inputs that are wrong there, and their values
#: then
_FAULTY_TICKS, _SHARE = 600, 0.03
_WRONG_REALS = (nan, inf, -inf, -1e300, 1e6, 0.0, -1.0)
_WRONG_INTS = (0, 1, -7)
_WRONG_TIMES = (0.0, -1.0, nan, 0.05, 0.3, 2.0, 5.0)
#: least share of healthy proposals in the weld, which has sensor faults
_HEALTHY_SHARE = 0.95
_PART = re.compile(r"(\w+)(?:\[(\d+)\])?")


class VectorRecorder:
    """Records input and output of every step of a library; a ``with`` replaces its ``step``."""

    def __init__(
        self, library: CController, inputs: Sequence[Signal], outputs: Sequence[Signal]
    ) -> None:
        self.library, self.inputs, self.outputs = library, inputs, outputs
        #: a row of values per step, in the order of the signals
        self.ticks: list[tuple[float, ...]] = []
        self.answers: list[tuple[float, ...]] = []
        self._step = library.step

    def __enter__(self) -> VectorRecorder:
        self.library.step = self._noted  # type: ignore[method-assign]
        return self

    def __exit__(self, *error: object) -> None:
        self.library.step = self._step  # type: ignore[method-assign]

    def _noted(self) -> None:
        if hasattr(self.library.input, "n_changes"):
            self.library.input.n_changes = min(
                self.library.input.n_changes, 1
            )  # the CSV files have columns for one
        self.ticks.append(_row(self.library.input, self.inputs))
        self._step()
        self.answers.append(_row(self.library.output, self.outputs))

    def healthy(self) -> int:
        """Number of answers that might be applied."""
        column = next(i for i, signal in enumerate(self.outputs) if signal.name == "healthy")
        return sum(bool(row[column]) for row in self.answers)


def recorded(
    choice: Choice, progress: Callable[[float], None] | None
) -> tuple[ControllerSources, dict[str, VectorRecorder]]:
    """Sources of a controller, and its test vectors from a simulated weld.

    Raises
    ------
    InputError
        If the controller cannot be exported, or cannot control its model.
    """
    controller: Any = make(choice.unit, choice.parameters)
    sources, model = sources_of(controller), choice.model
    text = render(
        "vector_weld.yaml",
        controller=choice.unit,
        model_file=choice.model_file or "",
        depth=model.operating_depth_mm,
        temperature=model.operating_temperature_c,
    )
    with VectorRecorder(controller.library, sources.inputs, sources.outputs) as weld:
        try:
            ClosedLoop(
                parse(text, "the weld of the test vectors"), {controller.name: controller}
            ).run(progress)
        except (OperatingPointError, InputError) as error:
            raise InputError(f"cannot weld with this model: {error}") from None
    if weld.healthy() < _HEALTHY_SHARE * len(weld.answers):
        raise InputError(
            f"in the weld of the test vectors only {weld.healthy()} of {len(weld.answers)} "
            "proposals were healthy: this controller cannot control this model; "
            "check model and tuning"
        )
    return sources, {"weld": weld, "faults": with_faults(weld)}


def with_faults(weld: VectorRecorder) -> VectorRecorder:
    """Vectors from the ticks of a weld in which every input may be wrong.

    NaN, infinite, absurd, stale, late.
    """
    rng = random.Random(7)
    names = [signal.name for signal in weld.inputs]
    first = dict(zip(names, weld.ticks[0], strict=True))
    weld.library.reset(
        first["applied_force_kn"], first["applied_speed_rpm"]
    )  # as the example does
    with VectorRecorder(weld.library, weld.inputs, weld.outputs) as recorder:
        for k, tick in enumerate(weld.ticks[:_FAULTY_TICKS]):
            for signal, value in zip(weld.inputs, tick, strict=True):
                _put(weld.library.input, signal.in_c, value)
                if k > 0 and rng.random() < _SHARE:
                    wrong = (
                        _WRONG_TIMES
                        if signal.name == "dt_s"
                        else _WRONG_INTS
                        if signal.is_int
                        else _WRONG_REALS
                    )
                    _put(weld.library.input, signal.in_c, rng.choice(wrong))
            recorder.library.step()
    return recorder


def _row(struct: Any, signals: Sequence[Signal]) -> tuple[float, ...]:
    return tuple(_member(struct, signal.in_c) for signal in signals)


def _member(struct: Any, designator: str) -> Any:
    """Value of a member such as ``change[0].at_s``."""
    value = struct
    for name, index in _PART.findall(designator):
        value = getattr(value, name)
        if index:
            value = value[int(index)]
    return value


def _put(struct: Any, designator: str, value: float) -> None:
    """Set a member."""
    holder, _, name = designator.rpartition(".")
    setattr(_member(struct, holder) if holder else struct, name, value)


def csv_text(signals: Sequence[Signal], rows: Sequence[Sequence[float]]) -> str:
    """The rows as CSV, numbers exactly, the first line naming the signals."""
    lines = [",".join(signal.name for signal in signals)]
    lines += [",".join(repr(value) for value in row) for row in rows]
    return "\n".join(lines) + "\n"
