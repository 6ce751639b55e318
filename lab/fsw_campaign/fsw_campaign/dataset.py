"""The dataset of a campaign.

A folder with a manifest and Parquet files that are added as welds end.
"""

from __future__ import annotations

import fcntl
import json
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, TextIO

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import yaml

from fsw_analysis.kpi_table import ROWS
from fsw_campaign import definition
from fsw_campaign.definition import Campaign
from fsw_campaign.welds import Row, versions
from fsw_control.schema.files import replacing, write_whole
from fsw_control.schema.models import InputError, Model, content_of, read_text, validate

_MANIFEST = "campaign.json"
SCENARIO = "scenario.yaml"
_WELDS = "welds"
#: files with fewer rows are joined
_SMALL = 5000
_COUNTS = ("duration_s", "ticks", "ticks_without_output", "ticks_without_command")
#: columns that differ from run to run
TIMES = ("solve_time_p50_ms", "solve_time_p99_ms", "solve_time_max_ms", "wall_time_s")
_EVENT_NUMBERS = (
    "time_s",
    "until_s",
    "size_mm",
    "size_c",
    "iae_depth_mm_s",
    "iae_temperature_c_s",
    "peak_depth_error_mm",
    "peak_temperature_error_c",
    "settling_s",
    "overshoot_mm",
    "overshoot_c",
    "overshoot_percent",
)
_TEXT = pa.dictionary(pa.int32(), pa.string())
EVENT = pa.struct(
    [("quantity", pa.string()), ("kind", pa.string()), ("alone", pa.bool_())]
    + [(name, pa.float64()) for name in _EVENT_NUMBERS]
)


def schema(campaign: Campaign) -> pa.Schema:
    """Columns of a campaign's rows."""
    columns: list[tuple[str, pa.DataType]] = [("index", pa.int32()), ("controller", _TEXT)]
    types = {bool: pa.bool_(), int: pa.int64(), float: pa.float64(), str: _TEXT}
    columns += [("plant.seed", pa.int64())]
    columns += [
        (path, types[type(distribution.extremes[0])])
        for path, distribution in campaign.distributions.items()
        if path != "plant.seed"
    ]
    columns += [("status", _TEXT), ("reason", pa.string()), ("inside", pa.bool_())]
    columns += [
        ("verdict", _TEXT),
        ("rule", _TEXT),
    ]  # by the campaign's procedure or the default rules
    for signal in campaign.limits:
        names = (f"lowest_{signal}", f"highest_{signal}", f"outside_{signal}_s")
        columns += [(name, pa.float64()) for name in names]
    columns += [(name, pa.float64()) for name in (*_COUNTS, *ROWS, *TIMES)]
    return pa.schema([*columns, ("versions", _TEXT), ("events", pa.list_(EVENT))])


class _Manifest(Model):
    digest: str
    versions: str
    campaign: dict[str, Any]


class Dataset:
    """Writes the rows of one campaign into a folder; a context.

    Files appear under their name only when they are complete, so that the folder can be read at
    any time. With ``resume`` the rows that are already there are kept and the missing ones added.

    Raises
    ------
    InputError
        If the folder cannot be used: it is another campaign's, in use, or without ``resume`` not
        empty.
    """

    def __init__(self, folder: Path, campaign: Campaign, resume: bool = False) -> None:
        self.folder, self.campaign = folder, campaign
        self._schema = schema(campaign)
        self._lock: TextIO | None = None
        manifest = folder / _MANIFEST
        try:
            if manifest.exists():
                self._check(resume)
            elif folder.exists() and any(folder.iterdir()):
                raise InputError(
                    f"folder {folder} exists and is not the folder of a campaign; "
                    "choose another --out"
                )
            (folder / _WELDS).mkdir(parents=True, exist_ok=True)
            self._lock = (folder / ".lock").open("w")
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            for left in (folder / _WELDS).glob(".*.tmp.parquet"):
                left.unlink()
            if not manifest.exists():
                write_whole(
                    folder / SCENARIO,
                    yaml.safe_dump(campaign.scenario, sort_keys=False, allow_unicode=True),
                )
                content = _Manifest(
                    digest=campaign.digest, versions=versions(), campaign=json.loads(campaign.text)
                )
                write_whole(manifest, content.model_dump_json(indent=1))
        except BlockingIOError:
            raise InputError(
                f"folder {folder} is being written to by another run; wait until it has finished"
            ) from None
        except OSError as error:
            raise InputError(f"cannot write to folder {folder}: {error.strerror}") from None
        self.done: set[tuple[int, str]] = (
            set()
        )  #: number and controller of each weld in the folder
        if parts := _parts(folder):
            keys = _read(parts, ["index", "controller"])
            self.done = set(
                zip(keys["index"].to_pylist(), keys["controller"].to_pylist(), strict=True)
            )
        self._next = int(parts[-1].stem) + 1 if parts else 0

    def _check(self, resume: bool) -> None:
        """Refuse another campaign's folder, and the same campaign's without ``resume``."""
        manifest, campaign = _read_manifest(self.folder), self.campaign
        if manifest.digest != campaign.digest:
            raise InputError(
                f"folder {self.folder} has another campaign ({manifest.campaign['name']}, "
                f"{manifest.digest}; this one is {campaign.name}, {campaign.digest}); "
                "choose another --out"
            )
        if not resume and _parts(self.folder):
            raise InputError(
                f"folder {self.folder} has welds of this campaign; continue with --resume"
            )
        if manifest.versions != versions():
            raise InputError(
                f"folder {self.folder} was begun with other software ({manifest.versions}; "
                f"this is {versions()}); choose another --out"
            )

    def missing(self) -> list[tuple[int, list[str]]]:
        """Welds that are still to be run: number, and labels of the controllers."""
        labels = [entrant.label for entrant in self.campaign.entrants]
        by_weld = (
            (i, [label for label in labels if (i, label) not in self.done])
            for i in range(self.campaign.welds)
        )
        return [(index, left) for index, left in by_weld if left]

    def write(self, rows: Sequence[Row]) -> None:
        """Add rows, as a file that appears complete."""
        if not rows:
            return
        target = self.folder / _WELDS / f"{self._next:08d}.parquet"
        try:
            with replacing(target) as scratch:
                pq.write_table(
                    pa.Table.from_pylist(list(rows), self._schema), scratch, compression="zstd"
                )
        except OSError as error:
            raise InputError(f"cannot write {target}: {error.strerror or error}") from None
        self._next += 1
        self.done.update((row["index"], row["controller"]) for row in rows)

    def compact(self) -> None:
        """Join small files into one: each has an overhead of some 25 kB.

        The joined file takes the place of the first. If the process ends before the others are
        deleted, their rows exist twice and are read once.
        """
        small = [path for path in _parts(self.folder) if pq.read_metadata(path).num_rows < _SMALL]
        if len(small) > 1:
            with replacing(small[0]) as scratch:
                pq.write_table(_read(small), scratch, compression="zstd")
            for path in small[1:]:
                path.unlink()

    def __enter__(self) -> Dataset:
        return self

    def __exit__(self, *_: object) -> None:
        with suppress(OSError):  # the rows are there all the same
            self.compact()
        if self._lock is not None:
            self._lock.close()


def _read_manifest(folder: Path) -> _Manifest:
    file = folder / _MANIFEST
    return validate(_Manifest, content_of(read_text(file, "campaign"), str(file)), str(file))


def load(folder: Path) -> tuple[Campaign, pa.Table]:
    """The campaign in a folder and its rows, by number and controller, without duplicates.

    Raises
    ------
    ValueError
        If the folder is not a campaign's, has no rows yet, or is damaged.
    """
    campaign = definition.read(_read_manifest(folder).campaign, str(folder / _MANIFEST))
    parts = _parts(folder)
    if not parts:
        raise InputError(f"{folder} has no welds yet")
    table = _read(parts)
    keys = zip(table["index"].to_pylist(), table["controller"].to_pylist(), strict=True)
    _, first = np.unique([f"{index:010d} {label}" for index, label in keys], return_index=True)
    return campaign, table.take(first)


def _parts(folder: Path) -> list[Path]:
    return sorted((folder / _WELDS).glob("[0-9]*.parquet"))


def _read(parts: Sequence[Path], columns: list[str] | None = None) -> pa.Table:
    tables = []
    for path in parts:
        try:
            tables.append(pq.read_table(path, columns=columns))
        except (OSError, pa.ArrowException) as error:
            raise InputError(
                f"{path} is damaged: {' '.join(str(error).split())}; "
                "delete it and run again with --resume"
            ) from None
    return pa.concat_tables(tables).unify_dictionaries().combine_chunks()
