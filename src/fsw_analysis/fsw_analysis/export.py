"""Writes aligned signals as a table (CSV)."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from fsw_analysis.weld_signals import WeldSignals
from fsw_control.schema.files import replacing
from fsw_recorder.errors import BagError

Column = npt.NDArray[Any]


def weld_table(signals: WeldSignals) -> dict[str, Column]:
    """All signals as columns of one table; every array has shape (n_ticks,).

    Names are those of `WeldSignals`; what belongs to the drives' feedback begins with ``drives_``,
    to the plant's truth with ``truth_``, to a controller with ``<controller>_proposal_`` or
    ``<controller>_status_``.
    """
    groups: dict[str, Any] = {"": signals, "drives_": signals.drives, "truth_": signals.truth}
    groups |= {f"{name}_proposal_": group for name, group in signals.proposals.items()}
    groups |= {f"{name}_status_": group for name, group in signals.statuses.items()}
    return dict(
        column
        for prefix, group in groups.items()
        if group is not None
        for column in _columns(prefix, group)
    )


def _columns(prefix: str, group: Any) -> Iterator[tuple[str, Column]]:
    values = {item.name: getattr(group, item.name) for item in fields(group)}
    for name, value in values.items():
        if isinstance(value, np.ndarray):
            yield prefix + name, value
    yield from values.get("optional", {}).items()
    for name, value in values.get("disturbances", {}).items():
        yield f"{prefix}disturbance {name}", value


def export_weld(signals: WeldSignals, target: Path) -> int:
    """Write all signals of a weld to a CSV file; returns the number of rows.

    Raises
    ------
    BagError
        The name does not end in ``.csv``, or the file cannot be written.
    """
    if target.suffix.lower() != ".csv":
        raise BagError(f"{target}: only CSV tables can be written; the name must end in .csv")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with replacing(target) as part:
            write_table(weld_table(signals), part)
    except OSError as error:
        raise BagError(f"{target}: cannot be written: {error.strerror or error}") from None
    return signals.n_ticks


def write_table(table: Mapping[str, Column], target: Path) -> None:
    """Write columns as CSV.

    A missing number is an empty cell, and numbers have all their digits.
    """
    columns = [
        ["" if value != value else value for value in values.tolist()] for values in table.values()
    ]
    with target.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow(table)
        writer.writerows(zip(*columns, strict=True))
