"""``fsw.py bag info``: what is in a bag."""

from __future__ import annotations

import argparse
import json
from datetime import UTC, datetime
from typing import Any

from fsw.bags import DAMAGED_TOO, add_bag_command
from fsw.progress import ProgressBar
from fsw_analysis.tick_gaps import TickCounter, TickGaps
from fsw_control.units import NANOSECONDS
from fsw_recorder.bag_reader import BagInfo, BagReader

_KIB = 1024


def add_command(commands: Any) -> None:
    """Add the command to the subcommands of ``bag``."""
    info = add_bag_command(commands, "info", _run, "contents of a bag, counted message by message", DAMAGED_TOO)
    info.add_argument("--json", action="store_true", help="print JSON")


def _run(arguments: argparse.Namespace) -> int:
    ticks = TickCounter()
    with BagReader(arguments.bag) as reader, ProgressBar(f"reading {arguments.bag}") as bar:
        info = reader.info(bar, ticks.note)
    if arguments.json:
        print(json.dumps(_info_values(info, ticks.gaps()), indent=2, ensure_ascii=False))
    else:
        print("\n".join(_info_lines(info, ticks.gaps())))
    return 0


def _info_values(info: BagInfo, gaps: dict[str, TickGaps]) -> dict[str, Any]:
    """Summary as plain values; times in ns or s, sizes in bytes."""
    return {
        "path": str(info.path),
        "storage": info.storage,
        "ros_distro": info.ros_distro,
        "files": info.files,
        "size_bytes": info.size_bytes,
        "messages": info.message_count,
        "start_ns": info.start_ns,
        "end_ns": info.end_ns,
        "duration_s": info.duration_s,
        "topics": [
            {
                "name": one.name,
                "type": one.type_name,
                "count": info.counts.get(one.name, 0),
                "type_hash": one.type_hash,
                "ticks_missing": gaps[one.name].missing if one.name in gaps else None,
            }
            for one in info.topics
        ],
        "attachments": {one.name: len(one.data) for one in info.attachments},
        "custom_data": info.custom_data,
        "problems": info.problems,
    }


def _info_lines(info: BagInfo, gaps: dict[str, TickGaps]) -> list[str]:
    lines = [
        f"Bag:          {info.path}",
        f"Files:        {', '.join(info.files)} ({info.size_bytes / _KIB:.1f} KiB, {info.storage})",
    ]
    if info.message_count:
        lines += [f"Start:        {_when(info.start_ns)}", f"End:          {_when(info.end_ns)}"]
    lines += [f"Duration:     {info.duration_s:.3f} s", f"Messages:     {info.message_count}"]
    lines += [f"Attachment:   {one.name} ({len(one.data)} bytes)" for one in info.attachments]
    lines += [f"Custom data:  {key}: {value}" for key, value in info.custom_data.items()]
    lines += [f"Problem:      {problem}" for problem in info.problems]
    width = max([len(topic.name) for topic in info.topics], default=0)
    for topic in info.topics:
        count = info.counts.get(topic.name, 0)
        rate = f"{(count - 1) / info.duration_s:8.2f} Hz" if count > 1 and info.duration_s else " " * 11
        lines.append(f"Topic:        {topic.name:{width}}  {count:8d}  {rate}  {topic.type_name}")
    lacking = {name: one for name, one in sorted(gaps.items()) if one.missing}
    if gaps and not lacking:
        lines.append(f"Ticks:        none missing on {len(gaps)} topics, judged by their stamps")
    for name, one in lacking.items():
        text = f"missing (not sent or lost), first of stamp {one.first_ns * 1e-9:.3f} s"
        lines.append(f"Ticks:        {name:{width}}  {one.missing:8d}  {text}")
    return lines


def _when(time_ns: int) -> str:
    seconds, nanoseconds = divmod(time_ns, NANOSECONDS)
    try:
        text = datetime.fromtimestamp(seconds, tz=UTC).strftime("%Y-%m-%d %H:%M:%S")
    except (ValueError, OverflowError, OSError):
        return f"{time_ns} ns"
    return f"{text}.{nanoseconds // 1_000_000:03d} UTC"
