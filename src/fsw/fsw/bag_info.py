"""``fsw.py bag info`` and ``bag recover``: contents of a bag, an intact copy of a damaged one."""

from __future__ import annotations

import argparse
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from fsw.bags import DAMAGED_TOO, bag_argument, print_notes
from fsw.command import FORCE, command, file, option, switch
from fsw.console import ProgressBar, check_new, print_table, write_json
from fsw_control.units import NANOSECONDS
from fsw_recorder import recover as recovering
from fsw_recorder.bag_reader import BagReader
from fsw_recorder.bag_writer import WriterOptions
from fsw_recorder.manifest import MANIFEST_NAME
from fsw_recorder.topic import TopicSelection
from fsw_recorder.weld_clock import TickCounter

_KIB = 1024


@command(
    "bag info",
    "contents of a bag, counted message by message",
    bag_argument(DAMAGED_TOO),
    file("--json", "also write it as JSON"),
    FORCE,
)
def info(arguments: argparse.Namespace) -> int:
    check_new([arguments.json], arguments.force)
    ticks = TickCounter()
    with BagReader(arguments.bag) as reader:
        with ProgressBar(f"reading {arguments.bag}") as bar:
            reader.info(bar, ticks.note)
        values = _info_values(reader, ticks)
        _print(values, ticks)
    write_json(arguments.json, values)
    return 0


def _info_values(reader: BagReader, ticks: TickCounter) -> dict[str, Any]:
    """Summary as plain values; times in ns or s, sizes in bytes."""
    info, gaps, (first_ns, last_ns) = reader.info(), ticks.gaps(), ticks.span_ns()
    files = reader.storage_files()
    return {
        "path": str(reader.path),
        "storage": reader.storage,
        "ros_distro": reader.metadata.ros_distro,
        "files": [file.name for file in files],
        "size_bytes": sum(file.stat().st_size for file in files),
        "start_ns": info.start_ns,
        "end_ns": info.end_ns,
        "duration_s": info.duration_s,
        "custom_data": dict(reader.metadata.custom_data),
        "problems": list(reader.problems),
        "messages": info.message_count,
        "first_stamp_ns": first_ns,
        "last_stamp_ns": last_ns,
        "topics": [
            {
                "name": name,
                "type": topic.type_name,
                "count": info.counts.get(name, 0),
                "type_hash": topic.type_hash,
                "ticks_missing": gaps[name].missing if name in gaps else None,
                "ticks_before": gaps[name].before if name in gaps else None,
                "ticks_after": gaps[name].after if name in gaps else None,
            }
            for name, topic in sorted(reader.topics().items())
        ],
        "attachments": {file.name: len(file.data) for file in reader.attachments()},
    }


def _print(values: dict[str, Any], ticks: TickCounter) -> None:
    gaps = ticks.gaps()
    size = f"{values['size_bytes'] / _KIB:.1f} KiB"
    rows = [
        ("Bag", values["path"]),
        ("Files", f"{', '.join(values['files'])} ({size}, {values['storage']})"),
    ]
    if values["messages"]:
        rows += [("Start", _when(values["start_ns"])), ("End", _when(values["end_ns"]))]
    duration_s = values["duration_s"]
    rows += [("Duration", f"{duration_s:.3f} s"), ("Messages", str(values["messages"]))]
    if gaps:  # the recorder's clock may have been set meanwhile, or time was simulated
        weld_s = (values["last_stamp_ns"] - values["first_stamp_ns"]) * 1e-9
        rows.append(("Weld time", f"{weld_s:.3f} s, according to the stamps"))
    rows += [("Attachment", f"{name} ({n} bytes)") for name, n in values["attachments"].items()]
    rows += [("Custom data", f"{key}: {value}") for key, value in values["custom_data"].items()]
    rows += [("Problem", problem) for problem in values["problems"]]
    for name, gap in sorted(gaps.items()):
        if gap.missing:
            first = f"first of stamp {gap.first_ns * 1e-9:.3f} s"
            rows.append(("Ticks", f"{name}: {gap.missing} missing (not sent or lost), {first}"))
        if gap.before or gap.after:
            text = f"begins {gap.before} ticks after the bag, ends {gap.after} before it"
            rows.append(("Ticks", f"{name}: {text}"))
    if gaps and not any(gap.missing or gap.before or gap.after for gap in gaps.values()):
        rows.append(("Ticks", f"none missing on {len(gaps)} topics, according to their stamps"))
    print_table(rows)
    print()
    topics = []
    for topic in values["topics"]:
        count = topic["count"]
        rate = f"{(count - 1) / duration_s:.2f}" if count > 1 and duration_s else ""
        topics.append((topic["name"], topic["type"], str(count), rate))
    print_table(topics, ("topic", "type", "messages", "rate [Hz]"), words=2)


def _when(time_ns: int) -> str:
    seconds, nanoseconds = divmod(time_ns, NANOSECONDS)
    try:
        text = datetime.fromtimestamp(seconds, tz=UTC).strftime("%Y-%m-%d %H:%M:%S")
    except (ValueError, OverflowError, OSError):
        return f"{time_ns} ns"
    return f"{text}.{nanoseconds // 1_000_000:03d} UTC"


@command(
    "bag recover",
    "copy everything readable from a damaged bag into a new, intact MCAP bag",
    bag_argument(DAMAGED_TOO),
    option(
        "output", type=Path, nargs="?", help="folder of the new bag (default: <bag>_recovered)"
    ),
    switch("--zstd", "compress the new bag"),
    option(
        "--regex", default="", help="copy only topics whose whole name matches this expression"
    ),
)
def recover(arguments: argparse.Namespace) -> int:
    source: Path = arguments.bag
    stem = source.name.removesuffix(".zstd").removesuffix(".mcap").removesuffix(".db3") or "bag"
    target = arguments.output or source.absolute().parent / f"{stem}_recovered"
    options = WriterOptions(compression="zstd" if arguments.zstd else "")
    selection = TopicSelection(regex=arguments.regex, include_hidden=True)
    with ProgressBar(f"copying {source}") as bar:
        result = recovering.recover(source, target, options, bar, selection)
    print_notes(result.problems)
    print(f"{result.messages} messages of {result.topics} topics recovered to {target}")
    if source.is_dir() and (source / MANIFEST_NAME).exists():
        print_notes(["the copy has no manifest; keep the damaged bag as evidence"])
    return 0
