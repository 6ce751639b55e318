"""Command line of the operator's page, live or on bags."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from fsw_control.node_arguments import NodeArguments, asks_for_help, parameter_help
from fsw_control.parameters import describe
from fsw_control.schema.entry import quiet_start
from fsw_control.schema.extensions import Extra
from fsw_hmi.parameters import HmiParameters

#: what serves the page; ROS 2 does not bring it
EXTRA = Extra("fsw-control", "hmi", ("argon2", "starlette", "uvicorn", "websockets"))
#: parameters of the node that are options, too
_OPTIONS = (
    *("host", "port", "token_file", "users_file", "tls_cert", "tls_key", "allow_hosts"),
    "pages_folder",
)


def parser() -> argparse.ArgumentParser:
    """The command line."""
    whole = argparse.ArgumentParser(
        prog="run_hmi.py",
        description="Serve the operator's page of the weld that runs, or with --bag of welds that "
        "were recorded. Further parameters of the node go after --ros-args.",
    )
    specs = describe(HmiParameters)
    kinds: dict[str, dict[str, Any]] = {"port": {"type": int}, "allow_hosts": {"action": "append"}}
    for name in _OPTIONS:
        text, default = specs[name].description, specs[name].default
        text += f" (default: {default})" if default else ""
        flag = f"--{name.removesuffix('s').replace('_', '-')}"
        whole.add_argument(flag, dest=name, metavar="VALUE", help=text, **kinds.get(name, {}))
    text = "show this recorded weld; twice: compare two"
    whole.add_argument("--bag", action="append", type=Path, metavar="BAG", help=text)
    return whole


def main(args: Sequence[str] | None = None) -> int:
    """Serve the page until Ctrl-C; ``args`` as ``sys.argv``. Returns the exit code."""
    argv = list(sys.argv if args is None else args)
    split = argv.index("--ros-args") if "--ros-args" in argv else len(argv)
    arguments = NodeArguments("fsw_hmi", "", HmiParameters)
    if asks_for_help(argv):
        print(f"{parser().format_help()}\n{parameter_help(HmiParameters)}")
        return 0
    parsed = parser().parse_args(argv[1:split])
    if EXTRA.missing():
        print(f"hmi: {EXTRA.absence}", file=sys.stderr)
        return 2
    if parsed.bag:
        from fsw_hmi.bag_view import serve

        tls = parsed.tls_cert or "", parsed.tls_key or ""
        return serve(parsed.bag, parsed.host, parsed.port, parsed.allow_hosts or [], tls)
    with quiet_start():
        from fsw_control.node_main_ros import run
        from fsw_hmi.hmi_node import HmiNode

    return run(HmiNode, [argv[0], *argv[split:], *_overrides(parsed)], arguments)


def _overrides(parsed: argparse.Namespace) -> list[str]:
    """Options as parameters of the node; JSON is YAML that needs no quotes."""
    values = {name: getattr(parsed, name) for name in _OPTIONS}
    given = [f"{name}:={json.dumps(value)}" for name, value in values.items() if value is not None]
    return ["--ros-args", *(word for text in given for word in ("-p", text))]


if __name__ == "__main__":
    sys.exit(main())
