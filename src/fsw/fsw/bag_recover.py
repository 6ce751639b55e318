"""``fsw.py bag recover``: a whole copy of a damaged bag."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from fsw.bags import DAMAGED_TOO, add_bag_command, print_notes
from fsw.errors import CommandError
from fsw.progress import ProgressBar
from fsw_quality.attestation import ATTESTATION_NAME
from fsw_quality.signature import SUFFIX
from fsw_recorder.bag_writer import WriterOptions
from fsw_recorder.manifest import MANIFEST_NAME
from fsw_recorder.recover import recover
from fsw_recorder.recover_proven import recover_proven
from fsw_recorder.topic import TopicSelection


def add_command(commands: Any) -> None:
    """Add the command to the subcommands of ``bag``."""
    text = "copy everything readable from a damaged bag into a new, intact MCAP bag"
    copy = add_bag_command(commands, "recover", _run, text, DAMAGED_TOO)
    copy.add_argument("output", type=Path, nargs="?", help="folder of the new bag (default: <bag>_recovered)")
    text = "copy only chunks whose hashes are in the manifest, unchanged, so that they stay proven"
    copy.add_argument("--proven", action="store_true", help=text)
    copy.add_argument("--zstd", action="store_true", help="compress the new bag")
    copy.add_argument("--regex", default="", help="copy only topics whose whole name matches this expression")


def _run(arguments: argparse.Namespace) -> int:
    source: Path = arguments.bag
    stem = source.name.removesuffix(".mcap").removesuffix(".db3") or "bag"
    target = arguments.output or source.absolute().parent / f"{stem}_recovered"
    if arguments.proven:
        return _proven(source, target, bool(arguments.zstd or arguments.regex))
    options = WriterOptions(compression="zstd" if arguments.zstd else "")
    selection = TopicSelection(regex=arguments.regex, include_hidden=True)
    with ProgressBar(f"copying {source}") as bar:
        result = recover(source, target, options, bar, selection)
    print_notes(result.problems)
    print(f"{result.messages} messages of {result.topics} topics recovered to {target}")
    if source.is_dir() and (source / MANIFEST_NAME).exists():
        print_notes(["the copy has no manifest; what is provable stays so with --proven"])
    return 0


def _proven(source: Path, target: Path, changes: bool) -> int:
    if changes:
        raise CommandError("recover: --proven copies chunks as they are; leave out --zstd and --regex")
    evidence = (ATTESTATION_NAME, ATTESTATION_NAME + SUFFIX)
    with ProgressBar(f"copying {source}") as bar:
        result = recover_proven(source, target, evidence, bar)
    print_notes(result.lost)
    print(
        f"{result.proven} of {result.recorded} chunks and attachments proven, "
        f"{result.messages} messages recovered to {target}"
    )
    return 0
