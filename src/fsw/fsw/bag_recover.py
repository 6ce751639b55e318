"""``fsw.py bag recover``: an intact copy of a damaged bag."""

from __future__ import annotations

import argparse
from pathlib import Path

from fsw.bags import DAMAGED_TOO, bag_argument, print_notes
from fsw.command import command, option, switch
from fsw.console import ProgressBar
from fsw_recorder import recover as recovering
from fsw_recorder.bag_writer import WriterOptions
from fsw_recorder.manifest import MANIFEST_NAME
from fsw_recorder.topic import TopicSelection


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
        print_notes(
            ["the copy has no manifest: what the damaged bag still proves, it alone proves"]
        )
    return 0
