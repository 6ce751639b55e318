"""Values at a moment against interlocks, the limits of the rule book and their set-points.

The page draws the result and judges nothing itself; ``fsw_analysis.judgement`` judges the weld as
a whole.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from math import nan
from typing import Any, Literal, NamedTuple

import numpy as np

from fsw_analysis.rule_book import Check, RuleBook
from fsw_analysis.weld_signals import FloatArray, TextArray

#: a violation, as the page gets it
Flag = dict[str, Any]
Kind = Literal["trip", "essential", "warn", "quality", "error", "deviation"]
#: by kind: level and words
_WORDS: dict[Kind, tuple[str, str]] = {
    "trip": ("high", "beyond trip"),
    "essential": ("high", "beyond its essential limit"),
    "warn": ("medium", "warning"),
    "quality": ("medium", "off quality"),
    "error": ("medium", "off its set-point"),
    "deviation": ("medium", "off its command"),
}
#: quantities of the page, and the variable of the rule book that is their distance from the
#: programme's set-point
QUANTITIES = {
    "depth_mm": "depth_error_mm",
    "temperature_c": "temperature_error_c",
    "force_kn": "",
    "speed_rpm": "",
    "torque_nm": "",
    "power_kw": "",
}


class _Test(NamedTuple):
    """Permitted range of values."""

    kind: Kind
    variable: str
    min: float | None
    max: float | None
    phases: tuple[str, ...] = ()


def variables(
    values: Mapping[str, float], progress: Mapping[str, Any] | None = None
) -> dict[str, float]:
    """Values of a row, and errors from the programme's set-points or else those in force."""
    own = programme_aims(progress)
    every = dict(values)
    for quantity, error in QUANTITIES.items():
        if error:
            every[error] = values.get(quantity, nan) - own.get(
                quantity, values.get(f"reference_{quantity}", nan)
            )
    return every


def programme_aims(progress: Mapping[str, Any] | None) -> dict[str, float]:
    """Set-points of depth and temperature that the programme reports; none at depth 0."""
    if not progress or not progress.get("depth_mm"):
        return {}
    aims = {name: progress.get(name) for name, error in QUANTITIES.items() if error}
    return {name: float(aim) for name, aim in aims.items() if aim is not None}


def worst(violations: Mapping[str, Sequence[Flag]]) -> dict[str, Flag]:
    """Of each quantity, the worst of its violations as of :func:`outside_now`."""
    return {quantity: flags_of[0] for quantity, flags_of in violations.items()}


def flags(
    columns: Mapping[str, FloatArray],
    phases: TextArray,
    book: RuleBook,
    limits: Mapping[str, Mapping[str, Any]],
) -> list[dict[str, Flag]]:
    """As :func:`outside`, of each quantity the worst."""
    return [worst(row) for row in outside(columns, phases, book, limits)]


def outside(
    columns: Mapping[str, FloatArray],
    phases: TextArray,
    book: RuleBook,
    limits: Mapping[str, Mapping[str, Any]],
) -> list[dict[str, list[Flag]]]:
    """Violations of each quantity at each moment, the worst first: level, words, and the limit; empty if none.

    Parameters
    ----------
    columns : mapping of str to array
        As of :func:`variables`, and the commands.
    phases : array of str
        Of the programme; empty where it is not known.
    book : RuleBook
        By which the weld is judged.
    limits : mapping
        Interlocks in force and deviations of the drives, as of ``fsw_hmi.limits.limits``.
    """
    flags_of_row: list[dict[str, list[Flag]]] = [{} for _ in range(phases.size)]
    for quantity in QUANTITIES:
        for test in _tests(quantity, book, limits.get(quantity, {})):
            values = columns.get(test.variable)
            if test.kind == "deviation":
                values = columns[quantity] - columns[f"command_{quantity}"]
            if values is None:
                continue
            held = True if not test.phases else np.isin(phases.astype(str), [*test.phases, ""])
            level, words = _WORDS[test.kind]
            limit = {
                "kind": test.kind,
                "variable": test.variable,
                "min": test.min,
                "max": test.max,
            }
            for side, end, is_outside in (
                ("low", test.min, np.less),
                ("high", test.max, np.greater),
            ):
                flag = {"level": level, "text": f"{words}, {side}", **limit}
                violated = False if end is None else is_outside(values, end)
                for row in np.flatnonzero(violated & held):
                    flags_of_row[row].setdefault(quantity, []).append(flag)
    return flags_of_row


def outside_now(
    values: Mapping[str, float],
    progress: Mapping[str, Any] | None,
    book: RuleBook,
    limits: Mapping[str, Mapping[str, Any]],
) -> dict[str, list[Flag]]:
    """As :func:`outside`, of one row."""
    columns = {name: np.array([value]) for name, value in variables(values, progress).items()}
    phase = str((progress or {}).get("phase", ""))
    return outside(columns, np.array([phase], object), book, limits)[0]


def _tests(quantity: str, book: RuleBook, own: Mapping[str, Any]) -> Iterator[_Test]:
    """Ranges of a quantity, in order of severity."""
    variables = quantity, QUANTITIES[quantity]
    checks = [check for check in book.checks() if check.variable in variables]
    if "trip" in own:
        yield _Test("trip", quantity, *own["trip"])
    yield from (_of_check("essential", check) for check in checks if check.kind == "essential")
    if "warn" in own:
        yield _Test("warn", quantity, *own["warn"])
    for check in checks:
        if check.kind == "quality":
            yield _of_check("quality" if check.variable == quantity else "error", check)
    if "deviation" in own:
        yield _Test("deviation", quantity, -own["deviation"], own["deviation"])


def _of_check(kind: Kind, check: Check) -> _Test:
    return _Test(kind, check.variable, check.min, check.max, check.phases)
