"""Reads a machine's log as the signals of a weld: a CSV file, arrays, or a data frame of pandas.

The counterpart of :mod:`fsw_analysis.weld_signals`, for logs of any origin: columns are known by
their name and unit, whatever the sampling rate.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from fsw_analysis.weld_signals import DriveSignals, FloatArray, WeldSignals
from fsw_control.schema.models import InputError
from fsw_control.schema.ranges import Range
from fsw_control.units import NANOSECONDS
from fsw_control.weld import TICK_NS, TICK_S

_RPM = 30.0 / np.pi  # per rad/s
#: by quantity, factor to the unit inside, which is the first, by unit as written (lower case)
_UNITS: dict[str, dict[str, float]] = {
    "time": {"s": 1.0, "ms": 1e-3, "min": 60.0, "h": 3600.0},
    "depth": {"mm": 1.0, "um": 1e-3, "µm": 1e-3, "m": 1e3},
    "temperature": {"c": 1.0, "degc": 1.0, "°c": 1.0, "k": 1.0},
    "torque": {"nm": 1.0, "n·m": 1.0, "n*m": 1.0, "knm": 1e3},
    "force": {"kn": 1.0, "n": 1e-3},
    "speed": {"rpm": 1.0, "1/min": 1.0, "r/min": 1.0, "rad/s": _RPM, "rad_per_s": _RPM},
}
_KELVIN_C = -273.15
#: quantities of a weld's table, see `fsw_analysis.weld_signals`; the first are needed
_NEEDED = ("time", "depth", "temperature", "torque", "force", "speed")
_OPTIONAL = ("reference_depth", "reference_temperature", "drives_force", "drives_speed")
#: words that may stand before a needed quantity; with any other word it can be a set-point or that
#: of another axis or part, which nobody sees in the result
_SURE = {
    "time": {"weld", "log", "elapsed"},
    "depth": {"weld", "plunge", "tool", "measured", "actual"},
    "temperature": {"weld", "tool", "probe", "measured", "actual"},
    "torque": {"spindle", "motor", "tool", "measured", "actual"},
    "force": {"axial", "plunge", "measured", "actual"},
    "speed": {"spindle", "rotational", "measured", "actual"},
}
#: in which the median of a weld lies; outside, the column may have another unit than its name says
#: (chosen: temperatures up to copper's melting point; metres, newtons and rad/s are far outside)
_USUAL = {
    "depth": Range(0.1, 20.0, "mm"),
    "temperature": Range(100.0, 1085.0, "°C"),
    "torque": Range(5.0, 5000.0, "N·m"),
    "force": Range(0.5, 500.0, "kN"),
    "speed": Range(50.0, 5000.0, "rpm"),
}
_MISSING = {"", "nan", "na", "n/a", "null", "none", "-"}


def read_table(
    source: str | Path | Mapping[str, Any] | Any, columns: Mapping[str, str] | None = None
) -> WeldSignals:
    """Signals of a weld at ticks of 0.1 s: means of each tick's samples, NaN where it has none.

    Parameters
    ----------
    source : str, Path, mapping or pandas.DataFrame
        File, or arrays by column.
    columns : mapping of str to str, optional
        Name of the column by quantity and unit, e.g. ``{"force_n": "F_ax"}``; else columns are
        found by names such as ``force_kn``, ``Axial force [kN]``.

    Raises
    ------
    InputError
        With line and column, if something is missing, ambiguous or no number.
    """
    name, table = _cells(source)
    chosen = _chosen(name, table.headers, dict(columns or {}))
    numbers = {
        quantity: table.numbers(name, header, quantity, unit)
        for quantity, (header, unit) in chosen.items()
    }
    for quantity, (header, _) in chosen.items():
        if quantity in _USUAL and not np.isfinite(numbers[quantity]).any():
            raise InputError(f"{name}: column {header!r} has no number")
    signals = _signals(name, numbers, table)
    signals.problems.extend(_dubious(numbers, chosen))
    return signals


def _dubious(
    numbers: Mapping[str, FloatArray], chosen: Mapping[str, tuple[str, str]]
) -> Iterator[str]:
    """Columns whose values are unusual for their unit."""
    for quantity, usual in _USUAL.items():
        values = numbers[quantity]
        median = float(np.median(values[np.isfinite(values)]))
        if 0.0 < median < usual.low or median > usual.high:  # depth and force vanish in air
            header = chosen[quantity][0]
            yield f"column {header!r}: median {median:.4g}, usual are {usual}; check its unit"


class _Table:
    """Cells by column; ``lines`` are the numbers of a file's rows, for messages."""

    def __init__(self, columns: Mapping[str, Any], lines: Sequence[int] | None = None) -> None:
        self._columns, self._lines, self.headers = columns, lines, list(columns)
        self.decimal_comma = self.decimal_point = False

    def place(self, row: int) -> str:
        """Row in messages."""
        return f"row {row}" if self._lines is None else f"line {self._lines[row]}"

    def numbers(self, name: str, header: str, quantity: str, unit: str) -> FloatArray:
        """A column in the unit inside."""
        cells, factor = self._columns[header], _UNITS[_kind(quantity)][unit]
        values = np.empty(len(cells))
        for row, cell in enumerate(cells):
            try:
                seconds = _seconds(cell) if quantity == "time" else None
                values[row] = self._number(cell) * factor if seconds is None else seconds
            except (TypeError, ValueError):
                hint = (
                    "; the file has decimal points" if self.decimal_point and "," in cell else ""
                )
                where = f"{name}: {self.place(row)}, column {header!r}"
                raise InputError(f"{where}: {str(cell)[:40]!r} is not a number{hint}") from None
        return values + _KELVIN_C if unit == "k" else values

    def _number(self, cell: Any) -> float:
        if cell is None or type(cell).__name__ == "NAType":  # that of pandas
            return float("nan")
        if not isinstance(cell, str):
            if isinstance(cell, np.datetime64 | np.timedelta64):
                raise TypeError
            return float(cell)
        text = cell.strip()
        if text.lower() in _MISSING:
            return float("nan")
        return float(text.replace(",", ".") if self.decimal_comma else text)


def _seconds(cell: Any) -> float | None:
    """Seconds of a date or duration, which has no unit; None if the cell is neither."""
    if isinstance(cell, np.datetime64 | np.timedelta64):
        if np.isnat(cell):
            return float("nan")
        kind = "datetime64[ns]" if isinstance(cell, np.datetime64) else "timedelta64[ns]"
        return float(cell.astype(kind).astype(np.int64)) * 1e-9
    if isinstance(cell, timedelta):
        return cell.total_seconds()
    if isinstance(cell, str) and re.match(r"\s*\d{4}-\d", cell):
        cell = datetime.fromisoformat(cell.strip())
    if isinstance(cell, datetime):  # without a time zone that of UTC, which has no summer time
        return (cell if cell.tzinfo else cell.replace(tzinfo=UTC)).timestamp()
    return None


def _cells(source: Any) -> tuple[str, _Table]:
    """Name in messages, and cells."""
    if isinstance(source, str | Path):
        return str(source), _file(Path(source))
    if hasattr(source, "columns") and hasattr(
        source, "reset_index"
    ):  # pandas, without importing it
        frame = source if source.index.name is None else source.reset_index()
        source = {str(column): frame[column].to_numpy() for column in frame.columns}
    if not isinstance(source, Mapping):
        raise InputError(
            f"table: a file, arrays by column or a data frame, not of type {type(source).__name__}"
        )
    arrays = {str(header): _array(values) for header, values in source.items()}
    sizes = {header: values.size for header, values in arrays.items()}
    if not all(sizes.values()):
        raise InputError(f"table: its columns have no rows: {sizes}")
    if len(set(sizes.values())) > 1:
        raise InputError(f"table: its columns differ in length: {sizes}")
    return "table", _Table(arrays)


def _array(values: Any) -> npt.NDArray[Any]:
    """Cells; None where an array hides one by its mask."""
    cells = np.ravel(np.asarray(values))
    hidden = np.ravel(np.ma.getmaskarray(values)) if np.ma.isMaskedArray(values) else False
    if np.any(hidden):
        cells = cells.astype(cells.dtype if cells.dtype.kind in "mM" else object)  # a copy
        cells[hidden] = None  # of dates NaT
    return cells


def _file(path: Path) -> _Table:
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    if b"\0" in raw:
        raise InputError(f"{path}: is no text file")
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = raw.decode("cp1252", errors="replace")  # as spreadsheets on Windows write it
    lines = text.splitlines()
    begin = next(
        (i for i, line in enumerate(lines) if line.strip() and not line.startswith("#")),
        len(lines),
    )
    if begin == len(lines):
        raise InputError(f"{path}: is empty")
    # By the header, which has no numbers: a comma below may be a decimal one. Of equal counts the
    # first wins, the semicolon of spreadsheets whose language has decimal commas.
    delimiter = max(";\t,", key=lines[begin].count)
    reader = csv.reader(io.StringIO("\n".join(lines[begin:])), delimiter=delimiter)
    headers = [header.strip() for header in next(reader)]
    if twice := sorted({header for header in headers if header and headers.count(header) > 1}):
        raise InputError(f"{path}: line {begin + 1}: column {twice[0]!r} is there twice")
    rows, numbers = [], []
    for row in reader:
        if not any(cell.strip() for cell in row):
            continue
        if len(row) != len(headers):
            where = f"{path}: line {begin + reader.line_num}"
            raise InputError(f"{where}: {len(row)} cells, but {len(headers)} columns")
        rows.append(row)
        numbers.append(begin + reader.line_num)
    if not rows:
        raise InputError(f"{path}: has no rows below its header in line {begin + 1}")
    # 1,054 is a decimal number only in a file without decimal points: else it may be a thousand
    point = any(re.fullmatch(r"[+-]?[\d,]*\.\d+", cell.strip()) for row in rows for cell in row)
    table = _Table(dict(zip(headers, zip(*rows, strict=True), strict=True)), numbers)
    table.decimal_comma, table.decimal_point = delimiter != "," and not point, point
    return table


def _kind(quantity: str) -> str:
    return quantity.rpartition("_")[2]


def _name_and_unit(header: str) -> tuple[str, str]:
    """Split ``Axial force [kN]`` or ``axial_force_kn``: ("axial_force", "kn"); unknown: ""."""
    text = header.strip().lower()
    if bracketed := re.fullmatch(r"(.*?)[\s_/,]*[\[(](.*)[\])]", text):
        return re.sub(r"\W+", "_", bracketed[1]).strip("_"), re.sub(r"\s", "", bracketed[2])
    # the longest first, as a unit may end like another one: _rad_per_s before _s
    units = {unit for known in _UNITS.values() for unit in known}
    for unit in sorted(units, key=len, reverse=True):
        if text.endswith(f"_{unit}"):
            return text.removesuffix(f"_{unit}"), unit
    return re.sub(r"\W+", "_", text).strip("_"), ""


def _chosen(
    name: str, headers: Sequence[str], columns: dict[str, str]
) -> dict[str, tuple[str, str]]:
    """Column and unit by quantity."""
    chosen: dict[str, tuple[str, str]] = {}
    for key, header in columns.items():
        quantity, unit = _name_and_unit(key)
        if quantity not in (*_NEEDED, *_OPTIONAL) or unit not in _UNITS[_kind(quantity)]:
            example = ", ".join(f"{stem}_{next(iter(_UNITS[stem]))}" for stem in _NEEDED)
            raise InputError(f"columns: {key!r} is no quantity with its unit, as {example}")
        if header not in headers:
            raise InputError(
                f"{name}: there is no column {header!r}; there are {', '.join(headers)}"
            )
        chosen[quantity] = (header, unit)
    parsed = {header: _name_and_unit(header) for header in headers}
    for quantity in (*_NEEDED, *_OPTIONAL):
        if quantity in chosen:
            continue
        # The plain name first, then one with words that leave no doubt. Of several none is
        # guessed: nobody would see a set-point that is taken for what was measured.
        exact = [header for header in headers if parsed[header][0] == quantity]
        sure = [header for header in headers if _is_surely(parsed[header][0], quantity)]
        known = [
            header for header in exact or sure if parsed[header][1] in _UNITS[_kind(quantity)]
        ]
        if len(known) == 1:
            chosen[quantity] = (known[0], parsed[known[0]][1])
        elif known or quantity in _NEEDED:
            raise InputError(f"{name}: {_complaint(quantity, known, parsed)}")
    return chosen


def _is_surely(name: str, quantity: str) -> bool:
    *before, last = name.split("_")
    return last == quantity and bool(before) and set(before) <= _SURE.get(quantity, set())


def _complaint(quantity: str, known: Sequence[str], parsed: Mapping[str, tuple[str, str]]) -> str:
    unit = next(iter(_UNITS[_kind(quantity)]))
    advice = f"give columns={{'{quantity}_{unit}': NAME}}, or --column {quantity}_{unit}=NAME"
    if known:
        return f"several columns may be the {quantity}: {', '.join(known)}; {advice}"
    units = ", ".join(_UNITS[_kind(quantity)])
    like = [header for header in parsed if quantity in re.split(r"[\W_]+", header.lower())]
    if without := [name for name in like if parsed[name][1] not in _UNITS[_kind(quantity)]]:
        return f"column {without[0]!r} has no unit that a {quantity} can have ({units}); {advice}"
    if like:
        return f"the {quantity} of the weld may be another one than {', '.join(like)}; {advice}"
    return f"no column is the {quantity}; {advice}; there are {', '.join(parsed)}"


def _signals(name: str, numbers: Mapping[str, FloatArray], table: _Table) -> WeldSignals:
    """Means by tick; without columns of their own the drives' feedback is force and speed."""
    time_s = numbers["time"]
    for row in np.flatnonzero(~np.isfinite(time_s)):
        raise InputError(f"{name}: {table.place(int(row))}: has no time")
    for row in np.flatnonzero(np.diff(time_s) <= 0.0):
        raise InputError(
            f"{name}: {table.place(int(row) + 1)}: its time is not after that of the row before"
        )
    tick = np.round((time_s - time_s[0]) / TICK_S).astype(np.int64)
    present, group = np.unique(tick, return_inverse=True)

    # Means, not every tenth sample: a log at 100 Hz would alias its noise into the tick's band.
    def mean(quantity: str) -> FloatArray:
        values = numbers.get(quantity)
        if values is None:
            return np.full(present.size, np.nan)
        finite = np.isfinite(values)
        count = np.bincount(group[finite], minlength=present.size)
        total = np.bincount(group[finite], values[finite], present.size)
        return np.divide(total, count, out=np.full(present.size, np.nan), where=count > 0)

    feedback = ["drives_" if f"drives_{drive}" in numbers else "" for drive in ("force", "speed")]
    no_text = np.full(present.size, "", dtype=object)
    return WeldSignals(
        path=Path(name),
        stamp_ns=(present + 1) * TICK_NS,
        time_s=(present + 1) * TICK_NS / NANOSECONDS,
        depth_mm=mean("depth"),
        torque_nm=mean("torque"),
        temperature_c=mean("temperature"),
        reference_depth_mm=mean("reference_depth"),
        reference_temperature_c=mean("reference_temperature"),
        force_kn=mean("force"),
        speed_rpm=mean("speed"),
        command_source=no_text,
        command_reason=no_text,
        command_latency_s=np.full(present.size, np.nan),
        actual_controller=no_text,
        actual_mode=no_text,
        drives=DriveSignals(mean(f"{feedback[0]}force"), mean(f"{feedback[1]}speed")),
    )
