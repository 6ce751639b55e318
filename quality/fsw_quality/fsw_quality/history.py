"""The history of welds: a row for each in a Parquet file, and what changed between two of them."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from math import isfinite, nan
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from fsw_analysis.course import course_of
from fsw_analysis.judgement import recorded_tunings
from fsw_analysis.procedure import Identity, attached
from fsw_analysis.weld_signals import FloatArray, WeldSignals
from fsw_control.schema.files import locked, replacing
from fsw_control.schema.models import InputError
from fsw_model import nominal
from fsw_quality.monitor_run import Watched
from fsw_quality.record import judged_with
from fsw_quality.record_content import software_versions
from fsw_recorder.bag_metadata import IDENTITY

#: torque (19) at the operating point (15), to which the torque at equal conditions refers [N m]
TORQUE_NM = 1021.5
#: in the folder of a history
_FILE = "history.parquet"
#: what is set for a weld: name and hash of the procedure, and two maps as JSON, ``{group: {name:
#: value}}``: parameters by controller, and versions and hashes of code by what they did
#: (``welded``, ``judged``)
SETTINGS = ("procedure", "procedure_sha256", "tuning", "software")
_MAPS = SETTINGS[2:]
TEXTS = (
    "weld",
    *IDENTITY,
    *SETTINGS,
    "controllers",
    "operators",
    "verdict",
    "alarm_kinds",
)
#: the alarms as facts, of which the report makes words: begin, and the fields of
#: :class:`fsw_quality.diagnosis.Finding`
FINDINGS = "alarm_findings"
_FINDING = pa.struct(
    {
        "begin_s": pa.float64(),
        "cause": pa.uint8(),
        "size": pa.float64(),
        "error": pa.float64(),
        "others": pa.list_(pa.uint8()),
    }
)
#: of these texts it counts whether they differ between two welds
_COMPARED = (*IDENTITY, *SETTINGS[:2], "controllers", "operators", "verdict", "alarm_kinds")
COUNTS = ("start_ns", "alarms", "swaps", "operator_actions")
#: meaning of each number, with its unit
NUMBERS = {
    "duration_s": "duration [s]",
    "temperature_error_mean_c": "mean temperature error [°C]",
    "temperature_error_sigma_c": "σ of the temperature error [°C]",
    "temperature_error_max_c": "largest temperature error [°C]",
    "depth_error_mean_mm": "mean depth error [mm]",
    "depth_error_sigma_mm": "σ of the depth error [mm]",
    "depth_error_max_mm": "largest depth error [mm]",
    "torque_nm": "torque at equal conditions [N·m]",
    "power_kw": "mean power [kW]",
    "gain_heat": "gain of heat",
    "gain_depth": "gain of depth",
    "drift_torque_nm": "largest drift of torque within the weld [N·m]",
    "drift_depth_um_per_min": "largest drift of depth within the weld [µm/min]",
    "drift_heat_c": "largest drift of heat within the weld [°C]",
}
#: hashes of the files with the messages, joined with a comma: by them a weld is known, whatever it
#: is called
FILES = "files_sha256"
SCHEMA = pa.schema(
    [(name, pa.string()) for name in (*TEXTS, FILES)]
    + [(name, pa.int64()) for name in COUNTS]
    + [(name, pa.float64()) for name in NUMBERS]
    + [(FINDINGS, pa.list_(_FINDING))]
)
Row = dict[str, Any]
#: what changed between two welds, before and after
Change = tuple[str, str, str]


def row(
    name: str,
    signals: WeldSignals,
    watched: Watched,
    identity: Mapping[str, str],
    verdict: str = "",
    files_sha256: Sequence[str] = (),
    judged_by: Identity | None = None,
) -> Row:
    """The row of a weld; ``files_sha256`` are the hashes of the files with its messages.

    The procedure is the one that is attached to the bag, else the one that the weld was
    ``judged_by``.

    The torque at equal conditions is the model's at the operating point times the median ratio of
    measured and model torque, so that welds at other forces and depths compare.
    """
    course = course_of(signals)
    values: Row = {
        "weld": name,
        **{key: identity.get(key, "") for key in IDENTITY},
        "verdict": verdict,
    }
    values[FILES] = ",".join(files_sha256)
    values["controllers"] = ", ".join(course.controllers)
    values["operators"] = ", ".join(signals.operators)
    procedure = next((entry.identity for entry in attached(signals.attachments)), judged_by)
    values["procedure"] = f"{procedure.id} {procedure.revision}" if procedure else ""
    values["procedure_sha256"] = procedure.sha256 if procedure else ""
    values["tuning"] = json.dumps(recorded_tunings(signals, course.controllers))
    values["software"] = json.dumps(
        {"welded": software_versions(signals.attachments), "judged": judged_with()}
    )
    sources = course.source[course.source != ""]
    values |= {
        "start_ns": int(signals.stamp_ns[0]),
        "swaps": int(np.sum(sources[1:] != sources[:-1])),
        "operator_actions": sum(event.kind == "operator" for event in signals.events),
        "duration_s": float(course.time_s[-1] - course.time_s[0]),
        "power_kw": _mean(course.values["power_kw"]),
    }
    for variable, unit in (("temperature", "c"), ("depth", "mm")):
        error = course.values[f"{variable}_error_{unit}"]
        known = error[np.isfinite(error)]
        of = (known.mean(), known.std(), np.abs(known).max()) if known.size else (nan, nan, nan)
        for what, value in zip(("mean", "sigma", "max"), of, strict=True):
            values[f"{variable}_error_{what}_{unit}"] = float(value)
    return values | _told_by_monitor(watched)


def _told_by_monitor(watched: Watched) -> Row:
    """The columns that are of the monitor within the weld."""
    gains = {name: gain for name, (gain, _) in watched.gains.items()}
    torque_nm, force_kn, heat_c = watched.drifts()
    return {
        "alarms": len(watched.alarms),
        "alarm_kinds": ", ".join(
            dict.fromkeys(alarm.finding.cause.word for alarm in watched.alarms)
        ),
        FINDINGS: [
            {
                "begin_s": alarm.begin_s,
                "cause": alarm.finding.cause,
                "size": alarm.finding.size,
                "error": alarm.finding.error,
                "others": list(alarm.finding.others),
            }
            for alarm in watched.alarms
        ],
        "torque_nm": gains.get("torque", nan) * TORQUE_NM,
        "gain_heat": gains.get("heat", nan),
        "gain_depth": gains.get("depth", nan),
        "drift_torque_nm": torque_nm,
        "drift_depth_um_per_min": 60e3 * nominal().depth_gain_mm_per_kn_s * force_kn,
        "drift_heat_c": heat_c,
    }


def _mean(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else nan


def add(folder: Path, rows: Sequence[Row]) -> int:
    """Add rows to the history in a folder, which is made if need be.

    Returns how many welds it has then.

    Raises
    ------
    fsw_control.schema.models.InputError
        If a weld is in the history already, under its name or another, or the folder cannot be
        written.
    """
    try:
        with locked(folder):
            table = pa.concat_tables([*_there(folder), pa.Table.from_pylist(list(rows), SCHEMA)])
            _check_once(folder, table)
            with replacing(folder / _FILE) as scratch:
                pq.write_table(table, scratch, compression="zstd")
            return int(table.num_rows)
    except OSError as error:
        raise InputError(f"cannot write to {folder}: {error.strerror}") from None


def check_new(folder: Path, welds: Sequence[tuple[str, Sequence[str]]]) -> None:
    """Refuse welds, by name and with the hashes of their files, before they are watched.

    Raises as :func:`add`.
    """
    fresh = [{"weld": name, FILES: ",".join(files)} for name, files in welds]
    _check_once(folder, pa.concat_tables([*_there(folder), pa.Table.from_pylist(fresh, SCHEMA)]))


def _there(folder: Path) -> list[pa.Table]:
    if any(folder.glob("[0-9]*.parquet")):
        raise InputError(f"{folder}: a history of an earlier version; begin one in another folder")
    return [load(folder)] if (folder / _FILE).exists() else []


def _check_once(folder: Path, table: pa.Table) -> None:
    """An `InputError` when a name, or a file with messages, is there twice."""
    names, seen = table["weld"].to_pylist(), dict[str, str]()
    for name, hashes in zip(names, table[FILES].to_pylist(), strict=True):
        for digest in filter(None, (hashes or "").split(",")):
            if (other := seen.setdefault(digest, name)) != name:
                raise InputError(
                    f"{folder}: two records of one weld: {name} has the files of {other}, "
                    "which is in the history; nothing is added"
                )
    if len(set(names)) < len(names):
        doubled = next(name for name, count in Counter(names).items() if count > 1)
        raise InputError(
            f"{folder}: weld {doubled} would be in the history twice; nothing is added. "
            "A weld has the name of its canister, else of its bag"
        )


def load(folder: Path) -> pa.Table:
    """The history in a folder, in the order in which the welds were added.

    Raises
    ------
    fsw_control.schema.models.InputError
        If there is none, or it cannot be read.
    """
    file = folder / _FILE
    if not file.exists():
        raise InputError(
            f"{folder}: there is no history of welds; 'fsw.py history add {folder} BAG' begins one"
        )
    try:
        return pq.read_table(file, schema=SCHEMA).combine_chunks()
    except (pa.ArrowException, OSError) as error:
        raise InputError(f"{file}: cannot be read: {' '.join(str(error).split())[:200]}") from None


def column(table: pa.Table, name: str) -> FloatArray:
    """A number of all welds, shape (n,); NaN where it is not known."""
    return np.asarray(table[name].to_numpy(zero_copy_only=False), dtype=np.float64)


def difference(table: pa.Table, first: str, second: str) -> list[tuple[str, str, str, float]]:
    """What changed from one weld to another.

    What, before, after, and by how many standard deviations (NaN: of text).

    The standard deviation is that from weld to weld in the whole history; numbers that changed by
    less than three are left out. The largest change comes first, behind the texts.

    Raises
    ------
    fsw_control.schema.models.InputError
        If a weld is not in the history.
    """
    names = table["weld"].to_pylist()
    rows = []
    for name in (first, second):
        if name not in names:
            others = " and others before" if len(names) > 5 else ""
            raise InputError(
                f"weld {name} is not in the history; it has {', '.join(names[-5:])}{others}"
            )
        rows.append(names.index(name))
    before, after = (table.slice(i, 1).to_pylist()[0] for i in rows)
    texts = [(*change, nan) for change in changes(before, after)]
    moved = []
    for name, words in NUMBERS.items():
        moves = np.abs(np.diff(column(table, name)))
        moves = moves[np.isfinite(moves)]
        sigma = float(np.median(moves)) / 0.954 if moves.size else 0.0
        change = after[name] - before[name]
        if isfinite(change) and sigma > 0.0 and abs(change) > 3.0 * sigma:
            moved.append((words, f"{before[name]:.4g}", f"{after[name]:.4g}", change / sigma))
    return [*texts, *sorted(moved, key=lambda entry: -abs(entry[3]))]


def changes(
    before: Row, after: Row, names: Sequence[str] = (*_COMPARED, "swaps", "operator_actions")
) -> list[Change]:
    """Texts and counts that differ between two rows, then tuning and software."""
    texts = [
        (name, _short(before[name]), _short(after[name]))
        for name in names
        if before[name] is not None and after[name] is not None and before[name] != after[name]
    ]
    return [
        *texts,
        *(change for name in _MAPS for change in _map_changes(name, before[name], after[name])),
    ]


def _map_changes(name: str, before: str | None, after: str | None) -> Iterator[Change]:
    """What differs between two maps in the groups that both have.

    Controllers in both welds are compared alone.
    """
    if before == after:
        return
    groups, others = (json.loads(text or "{}") for text in (before, after))
    for group in [group for group in groups if group in others]:
        old, new = groups[group], others[group]
        for key in dict.fromkeys([*old, *new]):
            if old.get(key) != new.get(key):
                yield f"{name}, {group}: {key}", _short(old.get(key)), _short(new.get(key))


def _short(value: object) -> str:
    """A value in a line: of a hash its begin."""
    text = "-" if value in (None, "") else str(value)
    return text[:12] if len(text) == 64 and not set(text) - set("0123456789abcdef") else text
