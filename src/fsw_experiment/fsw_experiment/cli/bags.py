"""``fsw.py bag``: what is in a recorded weld, what it was like, and a whole copy of a damaged one."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from fsw_analysis import kpi, kpi_table, phase_kpi
from fsw_analysis.bag_labels import labels
from fsw_analysis.changes import cut_to_scenario
from fsw_analysis.export import export_weld
from fsw_analysis.signals import load_weld
from fsw_analysis.tick_gaps import TickCounter, TickGaps
from fsw_analysis.weld_signals import WeldSignals
from fsw_control.units import NANOSECONDS
from fsw_experiment.cli.errors import CommandError
from fsw_experiment.cli.outputs import add_force, check_new, write_json
from fsw_experiment.cli.progress import ProgressBar
from fsw_experiment.scenario import ScenarioError
from fsw_experiment.scenario_file import parse
from fsw_recorder.bag_reader import BagInfo, BagReader
from fsw_recorder.bag_writer import WriterOptions
from fsw_recorder.recover import recover
from fsw_recorder.topic import TopicSelection

_KIB = 1024
_STATE = "bag folder or file (MCAP, sqlite3; whole, cut off or damaged)"


def add_command(
    commands: Any,
    name: str,
    run: Any,
    text: str,
    bag: str = "bag of a weld",
    description: str = "",
    several: bool = False,
) -> argparse.ArgumentParser:
    """Add a command on one or several bags."""
    parser: argparse.ArgumentParser = commands.add_parser(
        name, help=text, description=description or f"{name}: {text}."
    )
    parser.add_argument("bag", type=Path, help=bag, nargs="+" if several else None)
    parser.set_defaults(run=run)
    return parser


def add_commands(commands: Any) -> None:
    """Add the commands to the subcommands of ``bag``."""
    info = add_command(commands, "info", _info, "contents of a bag, counted message by message", _STATE)
    info.add_argument("--json", action="store_true", help="print JSON")

    text = "copy what can be read of a damaged bag into a new, whole MCAP bag"
    copy = add_command(commands, "recover", _recover, text, _STATE)
    copy.add_argument("output", type=Path, nargs="?", help="folder of the new bag (default: <bag>_recovered)")
    copy.add_argument("--zstd", action="store_true", help="compress the new bag")
    copy.add_argument("--regex", default="", help="copy only topics whose whole name matches this expression")

    figures_of_merit = add_command(
        commands, "kpi", _kpi, "figures of merit of a weld, and of each phase of a whole weld"
    )
    figures_of_merit.add_argument("--json", type=Path, metavar="FILE", help="also write them, and those of each event")
    add_force(figures_of_merit)

    text = "the paper's figures of a weld; several bags are overlaid"
    plot = add_command(commands, "plot", _plot, text, several=True)
    plot.add_argument("--out", type=Path, default=Path("."), help="folder for the PNG files (default: here)")
    plot.add_argument(
        "--figures", type=int, nargs="*", choices=range(4, 10), help="figures 4 to 9 (default: the scenario's)"
    )
    add_force(plot)

    text = "figures of merit of two or more welds side by side"
    compare = add_command(commands, "compare", _compare, text, several=True)
    compare.add_argument("--json", type=Path, metavar="FILE", help="also write them as JSON")
    compare.add_argument("--out", type=Path, help="also draw the welds overlaid, into this folder")
    add_force(compare)

    text = "write the aligned signals of a weld as a table, one row per tick, in paper's units"
    export = add_command(commands, "export", _export, text)
    export.add_argument("output", type=Path, nargs="?", help="CSV file to write (default: <bag>.csv)")
    export.add_argument("--all", action="store_true", help="also the ticks after the end of the attached scenario")
    add_force(export)


def print_notes(notes: Iterable[str]) -> None:
    """Report what is wrong with a bag on stderr, apart from the result."""
    for note in notes:
        print(f"note: {note}", file=sys.stderr)


def read_weld(bag: Path) -> WeldSignals:
    """Signals of a bag; what is wrong with it is reported on stderr."""
    with ProgressBar(f"reading {bag}") as bar:
        signals = load_weld(bag, bar)
    print_notes(signals.problems)
    return signals


def _info(arguments: argparse.Namespace) -> int:
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


def _recover(arguments: argparse.Namespace) -> int:
    source: Path = arguments.bag
    stem = source.name.removesuffix(".mcap").removesuffix(".db3") or "bag"
    target = arguments.output or source.absolute().parent / f"{stem}_recovered"
    options = WriterOptions(compression="zstd" if arguments.zstd else "")
    selection = TopicSelection(regex=arguments.regex, include_hidden=True)
    with ProgressBar(f"copying {source}") as bar:
        result = recover(source, target, options, bar, selection)
    print_notes(result.problems)
    print(f"{result.messages} messages of {result.topics} topics recovered to {target}")
    return 0


def _welds(bags: list[Path]) -> dict[str, WeldSignals]:
    """Welds by the labels that distinguish them, each cut to the length of its scenario."""
    return {label: cut_to_scenario(read_weld(bag)) for label, bag in zip(labels(bags), bags, strict=True)}


def _print_kpis(welds: dict[str, WeldSignals], file: Path | None) -> None:
    results = [kpi.compute(signals, label) for label, signals in welds.items()]
    print(kpi_table.text(results), end="")
    phases = [
        phase_kpi.compute(signals, label, phase_kpi.recorded_spans(signals)) if signals.phases else []
        for label, signals in welds.items()
    ]
    if any(phases):
        print("\n" + phase_kpi.markdown([run for run in phases if run]), end="")
    write_json(
        file, [result | {"phases": [asdict(one) for one in run]} for result, run in zip(results, phases, strict=True)]
    )


def _draw(welds: dict[str, WeldSignals], folder: Path, force: bool, numbers: Sequence[int] | None = None) -> None:
    """Draw figures of the paper, by default those that the first weld's scenario names."""
    from fsw_analysis.figures import Run, draw  # matplotlib takes a second to import

    text = next(iter(welds.values())).attachments.get("scenario.yaml")
    if numbers is None and text:
        try:
            numbers = parse(text.decode("utf-8", "replace"), "scenario.yaml of the bag").figures
        except ScenarioError as error:
            print_notes([str(error)])
    check_new([folder / f"{name}.png" for name in (*(f"fig{one}" for one in numbers or ()), "overview")], force)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        paths = draw([Run(label, signals) for label, signals in welds.items()], numbers or (), folder)
    except OSError as error:
        raise CommandError(f"cannot write figures into {folder}: {error.strerror}") from None
    print("\n".join(map(str, paths)))


def _kpi(arguments: argparse.Namespace) -> int:
    check_new([arguments.json], arguments.force)
    _print_kpis(_welds([arguments.bag]), arguments.json)
    return 0


def _plot(arguments: argparse.Namespace) -> int:
    _draw(_welds(arguments.bag), arguments.out, arguments.force, arguments.figures)
    return 0


def _compare(arguments: argparse.Namespace) -> int:
    if len(arguments.bag) < 2:
        raise CommandError("bag compare: give two bags or more")
    check_new([arguments.json], arguments.force)
    welds = _welds(arguments.bag)
    _print_kpis(welds, arguments.json)
    if arguments.out is not None:
        _draw(welds, arguments.out, arguments.force)
    return 0


def _export(arguments: argparse.Namespace) -> int:
    source: Path = arguments.bag
    target = arguments.output or source.absolute().parent / f"{source.absolute().name}.csv"
    check_new([target], arguments.force)
    signals = read_weld(source)
    if not arguments.all:
        whole, signals = signals.n_ticks, cut_to_scenario(signals)
        if signals.n_ticks < whole:
            print_notes([f"{whole - signals.n_ticks} ticks after the scenario's end are left out; --all keeps them"])
    print(f"{export_weld(signals, target)} rows written to {target}")
    return 0
