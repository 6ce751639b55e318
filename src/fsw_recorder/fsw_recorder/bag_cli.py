"""The commands ``bag info``, ``bag salvage``, ``bag export``, ``bag verify`` and ``bag shadow``."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from datetime import UTC, datetime
from importlib import import_module
from pathlib import Path
from typing import Any, TextIO

from fsw_recorder.bag_reader import BagInfo, BagReader
from fsw_recorder.bag_writer import WriterOptions
from fsw_recorder.errors import BagError
from fsw_recorder.salvage import salvage
from fsw_recorder.shadow_cli import add_shadow_command
from fsw_recorder.signal_export import export_weld
from fsw_recorder.signals import load_weld
from fsw_recorder.topic_selection import TopicSelection
from fsw_recorder.verify import Make, recorded_controllers, verify
from fsw_recorder.weld_signals import WeldSignals


def add_bag_commands(subparsers: Any) -> None:
    """Add the commands to the subparsers of ``bag``.

    Each sets the default ``run``: a function that takes the parsed arguments and returns the exit code. It raises
    `BagError` for bad input; `run_command` turns that into one line on stderr and exit code 1.
    """
    info = subparsers.add_parser(
        "info", help="what a bag holds", description="What a bag holds, counted message by message."
    )
    info.add_argument("bag", type=Path, help="bag folder or file (MCAP, sqlite3; whole, cut off or damaged)")
    info.add_argument("--json", action="store_true", help="print JSON")
    info.set_defaults(run=run_info)

    save = subparsers.add_parser(
        "salvage",
        help="copy what can be read into a new, whole bag",
        description="Copy what can be read of a cut off, damaged, split or compressed bag into a new, whole MCAP bag.",
    )
    save.add_argument("bag", type=Path, help="bag folder or file in any state")
    save.add_argument("output", type=Path, nargs="?", help="folder of the new bag (default: <bag>_salvaged)")
    save.add_argument("--zstd", action="store_true", help="compress the new bag")
    save.add_argument("--regex", default="", help="copy only topics whose whole name matches this expression")
    save.set_defaults(run=run_salvage)

    export = subparsers.add_parser(
        "export",
        help="write the aligned signals of a weld as a table",
        description="Write the aligned signals of a weld, one row per tick, in mm, degC, N m, kN, rpm, kW and s.",
    )
    export.add_argument("bag", type=Path, help="bag of a weld")
    export.add_argument("output", type=Path, nargs="?", help="table to write: .csv or .parquet (default: <bag>.csv)")
    export.add_argument(
        "--all", action="store_true", help="also the ticks after the end of the scenario that is attached to the bag"
    )
    export.set_defaults(run=run_export)

    check = subparsers.add_parser(
        "verify",
        help="replay controllers on a bag and compare with the recorded proposals, bit by bit",
        description="Drive controllers by a bag instead of the clock and compare their proposals with the recorded "
        "ones, bit by bit. Exit code 0: all equal; 1: they differ, or the bag cannot be replayed.",
    )
    check.add_argument("bag", type=Path, help="bag of a weld, recorded from its start")
    check.add_argument("--controller", metavar="NAME", help="replay only this one (default: all in the bag)")
    check.add_argument("--class", dest="kind", metavar="MODULE:CLASS", help="class of an own controller")
    check.add_argument("--parameters", metavar="PACKAGE:FILE", help="parameter descriptions of an own controller")
    check.set_defaults(run=run_verify)

    add_shadow_command(subparsers, progress_line)


def run_command(arguments: argparse.Namespace) -> int:
    """Run a parsed command; bad input is one line on stderr and exit code 1."""
    try:
        return int(arguments.run(arguments))
    except BagError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except BrokenPipeError:
        return 1


def progress_line(stream: TextIO | None = None) -> Callable[[float], None] | None:
    """Function that shows a fraction on a terminal; None where there is no terminal."""
    out = sys.stderr if stream is None else stream
    if not out.isatty():
        return None
    last = [-1]

    def show(fraction: float) -> None:
        percent = round(100 * fraction)
        if percent != last[0]:
            last[0] = percent
            out.write("\r\033[K" if percent >= 100 else f"\rreading {percent:3d} %")
            out.flush()

    return show


def run_info(arguments: argparse.Namespace) -> int:
    """``bag info``."""
    with BagReader(arguments.bag) as reader:
        info = reader.info(progress_line())
    if arguments.json:
        print(json.dumps(info_values(info), indent=2, ensure_ascii=False))
    else:
        print("\n".join(info_lines(info)))
    return 0


def info_values(info: BagInfo) -> dict[str, Any]:
    """Summary as plain values for JSON; times in s, sizes in bytes."""
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
                "count": one.count,
                "type_hash": one.type_hash,
                "ticks_missing": info.tick_gaps[one.name].missing if one.name in info.tick_gaps else None,
            }
            for one in info.topics
        ],
        "attachments": {one.name: len(one.data) for one in info.attachments},
        "custom_data": info.custom_data,
        "problems": info.problems,
    }


def info_lines(info: BagInfo) -> list[str]:
    """Summary as text."""

    def when(time_ns: int) -> str:
        try:
            text = datetime.fromtimestamp(time_ns // 1_000_000_000, tz=UTC).strftime("%Y-%m-%d %H:%M:%S")
        except (ValueError, OverflowError, OSError):
            return f"{time_ns} ns"
        return f"{text}.{time_ns % 1_000_000_000 // 1_000_000:03d} UTC"

    lines = [
        f"Bag:          {info.path}",
        f"Files:        {', '.join(info.files)} ({info.size_bytes / 1024:.1f} KiB, {info.storage})",
    ]
    if info.message_count:
        lines += [f"Start:        {when(info.start_ns)}", f"End:          {when(info.end_ns)}"]
    lines += [f"Duration:     {info.duration_s:.3f} s", f"Messages:     {info.message_count}"]
    lines += [f"Attachment:   {one.name} ({len(one.data)} bytes)" for one in info.attachments]
    lines += [f"Custom data:  {key}: {value}" for key, value in info.custom_data.items()]
    lines += [f"Problem:      {problem}" for problem in info.problems]
    width = max([len(topic.name) for topic in info.topics], default=0)
    for topic in info.topics:
        rate = f"{(topic.count - 1) / info.duration_s:8.2f} Hz" if topic.count > 1 and info.duration_s else " " * 11
        lines.append(f"Topic:        {topic.name:{width}}  {topic.count:8d}  {rate}  {topic.type_name}")
    return lines + _gap_lines(info)


def _gap_lines(info: BagInfo) -> list[str]:
    if not info.tick_gaps:
        return []
    lacking = {name: gaps for name, gaps in sorted(info.tick_gaps.items()) if gaps.missing}
    if not lacking:
        return [f"Ticks:        none missing on {len(info.tick_gaps)} topics, judged by their stamps"]
    width = max(len(name) for name in lacking)
    return [
        f"Ticks:        {name:{width}}  {gaps.missing:8d}  missing (not sent or lost), first of stamp "
        f"{gaps.first_ns * 1e-9:.3f} s"
        for name, gaps in lacking.items()
    ]


def run_salvage(arguments: argparse.Namespace) -> int:
    """``bag salvage``."""
    source: Path = arguments.bag
    stem = source.name.removesuffix(".zstd").removesuffix(".mcap").removesuffix(".db3") or "bag"
    target = arguments.output or source.absolute().parent / f"{stem}_salvaged"
    options = WriterOptions(compression="zstd" if arguments.zstd else "")
    selection = TopicSelection(regex=arguments.regex, include_hidden=True)
    result = salvage(source, target, options, progress_line(), selection)
    for problem in result.problems:
        print(f"note: {problem}", file=sys.stderr)
    print(f"{result.messages} messages of {result.topics} topics saved to {target}")
    return 0


def run_export(arguments: argparse.Namespace) -> int:
    """``bag export``."""
    source: Path = arguments.bag
    target = arguments.output or source.absolute().parent / f"{source.absolute().name}.csv"
    signals = load_weld(source, progress_line())
    for problem in signals.problems:
        print(f"note: {problem}", file=sys.stderr)
    if not arguments.all:
        signals = _within_scenario(signals)
    rows = export_weld(signals, target)
    print(f"{rows} rows written to {target}")
    return 0


def _within_scenario(signals: WeldSignals) -> WeldSignals:
    """Without the ticks after the scenario's end, as the figures of merit are computed; says how many."""
    from fsw_experiment.weld_events import cut_to_scenario

    cut = cut_to_scenario(signals)
    surplus = signals.n_ticks - cut.n_ticks
    if surplus:
        print(f"note: {surplus} ticks after the scenario's end are left out; --all keeps them", file=sys.stderr)
    return cut


def run_verify(arguments: argparse.Namespace) -> int:
    """``bag verify``."""
    recorded = recorded_controllers(arguments.bag)
    names = [arguments.controller] if arguments.controller else recorded
    if not recorded or not set(names) <= set(recorded):
        raise BagError(f"{arguments.bag}: no proposals of {', '.join(names) or 'any controller'} in this bag")
    identical = True
    for name in names:
        make, parameters = _controller(name, arguments.kind, arguments.parameters)
        result = verify(arguments.bag, name, make, parameters)
        for note in result.notes:
            print(f"note: {note}", file=sys.stderr)
        print("\n".join(result.lines()), flush=True)
        identical &= result.identical
    return 0 if identical else 1


def _controller(name: str, kind: str | None, parameters: str | None) -> tuple[Make, tuple[str, str] | None]:
    """What makes a controller, and where its parameters are described."""
    if kind is not None:
        described = tuple(parameters.split(":")) if parameters else ()
        if len(described) not in (0, 2):
            raise BagError(f"--parameters {parameters}: write PACKAGE:FILE")
        module, _, class_name = kind.partition(":")
    else:
        from fsw_experiment.controllers import KNOWN

        if name not in KNOWN:
            raise BagError(f"controller {name} is not one of {', '.join(KNOWN)}; give its class with --class")
        module, class_name, *rest = KNOWN[name]
        described = (module, rest[0])
    try:
        made = getattr(import_module(module), class_name)
    except (ImportError, AttributeError, ValueError) as error:
        raise BagError(f"controller {name} is not available: {error}") from None
    if not described:
        return (lambda _: made()), None
    return made, (described[0], described[1])
