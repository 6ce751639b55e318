"""``fsw.py bag info`` and ``bag recover``: contents of a bag, an intact copy of a damaged one."""

from __future__ import annotations

import argparse
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from fsw.bags import DAMAGED_TOO, bag_argument, print_notes
from fsw.command import FORCE, command, file, option, switch
from fsw.console import ProgressBar, print_table
from fsw.outputs import check_new, write_json
from fsw_control.units import NANOSECONDS
from fsw_recorder import recover as recovering
from fsw_recorder.bag_reader import BagInfo, BagReader
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
    with BagReader(arguments.bag) as reader, ProgressBar(f"reading {arguments.bag}") as bar:
        info = reader.info(bar, ticks.note)
    _print(info, ticks)
    write_json(arguments.json, _info_values(info, ticks))
    return 0


def _info_values(info: BagInfo, ticks: TickCounter) -> dict[str, Any]:
    """Summary as plain values; times in ns or s, sizes in bytes."""
    gaps, (first_ns, last_ns) = ticks.gaps(), ticks.span_ns()
    kept = ("storage", "ros_distro", "files", "size_bytes", "start_ns", "end_ns", "duration_s")
    return {
        **{name: getattr(info, name) for name in (*kept, "custom_data", "problems")},
        "path": str(info.path),
        "messages": info.message_count,
        "first_stamp_ns": first_ns,
        "last_stamp_ns": last_ns,
        "topics": [
            {
                "name": topic.name,
                "type": topic.type_name,
                "count": info.counts.get(topic.name, 0),
                "type_hash": topic.type_hash,
                "ticks_missing": gaps[topic.name].missing if topic.name in gaps else None,
                "ticks_before": gaps[topic.name].before if topic.name in gaps else None,
                "ticks_after": gaps[topic.name].after if topic.name in gaps else None,
            }
            for topic in info.topics
        ],
        "attachments": {file.name: len(file.data) for file in info.attachments},
    }


def _print(info: BagInfo, ticks: TickCounter) -> None:
    gaps, (first_ns, last_ns) = ticks.gaps(), ticks.span_ns()
    rows = [
        ("Bag", str(info.path)),
        ("Files", f"{', '.join(info.files)} ({info.size_bytes / _KIB:.1f} KiB, {info.storage})"),
    ]
    if info.message_count:
        rows += [("Start", _when(info.start_ns)), ("End", _when(info.end_ns))]
    rows += [("Duration", f"{info.duration_s:.3f} s"), ("Messages", str(info.message_count))]
    if gaps:  # the recorder's clock may have been set meanwhile, or time was simulated
        rows.append(("Weld time", f"{(last_ns - first_ns) * 1e-9:.3f} s, according to the stamps"))
    rows += [("Attachment", f"{file.name} ({len(file.data)} bytes)") for file in info.attachments]
    rows += [("Custom data", f"{key}: {value}") for key, value in info.custom_data.items()]
    rows += [("Problem", problem) for problem in info.problems]
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
    for topic in info.topics:
        count = info.counts.get(topic.name, 0)
        rate = f"{(count - 1) / info.duration_s:.2f}" if count > 1 and info.duration_s else ""
        topics.append((topic.name, topic.type_name, str(count), rate))
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
