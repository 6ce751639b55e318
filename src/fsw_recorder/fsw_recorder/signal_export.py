"""Writes aligned signals as a table: CSV, or Parquet where pyarrow is installed."""

from __future__ import annotations

import csv
import math
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from fsw_recorder.errors import BagError
from fsw_recorder.weld_signals import WeldSignals

Column = npt.NDArray[Any]
FORMATS = (".csv", ".parquet")


def weld_table(signals: WeldSignals) -> dict[str, Column]:
    """All signals as columns of one table; every array has shape (n_ticks,).

    Names are those of `WeldSignals`; what belongs to the plant's truth begins with ``truth_``, what belongs to a
    controller with ``<controller>_proposal_`` or ``<controller>_status_``.
    """
    table: dict[str, Column] = {}
    _add(table, "", signals)
    if signals.truth is not None:
        _add(table, "truth_", signals.truth)
    for name, proposal in signals.proposals.items():
        _add(table, f"{name}_proposal_", proposal)
    for name, status in signals.statuses.items():
        _add(table, f"{name}_status_", status)
        for disturbance, values in status.disturbances.items():
            table[f"{name}_status_disturbance {disturbance}"] = values
    return table


def _add(table: dict[str, Column], prefix: str, source: Any) -> None:
    for field in fields(source):
        value = getattr(source, field.name)
        if isinstance(value, np.ndarray):
            table[prefix + field.name] = value


def export_weld(signals: WeldSignals, target: Path) -> int:
    """Write the table to ``target``; its suffix chooses the format. Returns the number of rows.

    In CSV a missing number is an empty cell; numbers are written with all their digits.

    Raises
    ------
    BagError
        The format is not known, pyarrow is missing, or the file cannot be written.
    """
    table = weld_table(signals)
    suffix = target.suffix.lower()
    if suffix not in FORMATS:
        raise BagError(f"{target}: format '{suffix}' is not known; end the name in {' or '.join(FORMATS)}")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        if suffix == ".csv":
            _write_csv(table, target)
        else:
            _write_parquet(table, target)
    except OSError as error:
        raise BagError(f"{target}: cannot be written: {error.strerror or error}") from None
    return signals.n_ticks


def _write_csv(table: dict[str, Column], target: Path) -> None:
    columns = [_cells(values) for values in table.values()]
    with target.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow(table)
        writer.writerows(zip(*columns, strict=True))


def _cells(values: Column) -> list[Any]:
    if values.dtype.kind == "f":
        return ["" if math.isnan(value) else repr(value) for value in values.tolist()]
    return list(values.tolist())


def _write_parquet(table: dict[str, Column], target: Path) -> None:
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError:
        raise BagError(
            f"{target}: Parquet needs the Python package pyarrow, which is not installed; export to .csv instead"
        ) from None
    arrays = {
        name: pyarrow.array(values.tolist(), type=pyarrow.string() if values.dtype.kind == "O" else None)
        for name, values in table.items()
    }
    pyarrow.parquet.write_table(pyarrow.table(arrays), target)
