"""The command line of the operator's page: live, or over bags."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path

from fsw_control.node_arguments import NodeArguments, asks_for_help, parameter_help
from fsw_control.parameters import defaults, load


def parser() -> argparse.ArgumentParser:
    """The command line."""
    standard = defaults(load("fsw_hmi", "hmi.yaml"))
    whole = argparse.ArgumentParser(
        prog="run_hmi.py",
        description="Serve the operator's page of the weld that runs, or with --bag of welds that were recorded. "
        "Further parameters of the node go after --ros-args.",
    )
    whole.add_argument("--host", help=f"address to listen on (default: {standard['host']})")
    whole.add_argument("--port", type=int, help=f"port, 0: any free one (default: {standard['port']})")
    whole.add_argument(
        "--token-file", type=Path, metavar="FILE", help="holds the token for commands (default: a new one is printed)"
    )
    whole.add_argument(
        "--users-file", type=Path, metavar="FILE", help="named users who may command; made by 'fsw.py hmi user'"
    )
    whole.add_argument("--tls-cert", type=Path, metavar="FILE", help="certificate (PEM): encrypt; needs --tls-key")
    whole.add_argument(
        "--tls-key", type=Path, metavar="FILE", help="its private key (PEM), which its owner alone may read"
    )
    whole.add_argument(
        "--allow-host",
        action="append",
        metavar="NAME",
        help="further name or address under which browsers ask for the page; several times",
    )
    whole.add_argument(
        "--bag", action="append", type=Path, metavar="BAG", help="show this recorded weld; twice: compare two"
    )
    return whole


def main(args: Sequence[str] | None = None) -> int:
    """Serve the page until Ctrl-C; ``args`` as ``sys.argv``. Returns the exit code."""
    argv = list(sys.argv if args is None else args)
    split = argv.index("--ros-args") if "--ros-args" in argv else len(argv)
    arguments = NodeArguments("fsw_hmi", "", load("fsw_hmi", "hmi.yaml"))
    if asks_for_help(argv):
        print(f"{parser().format_help()}\n{parameter_help(arguments.specs)}")
        return 0
    parsed = parser().parse_args(argv[1:split])
    if parsed.bag:
        from fsw_hmi.bag_app import serve

        tls = str(parsed.tls_cert or ""), str(parsed.tls_key or "")
        return serve(parsed.bag, parsed.host, parsed.port, parsed.allow_host or [], tls)
    from fsw_control.node_main_ros import run
    from fsw_hmi.hmi_node import HmiNode

    return run(HmiNode, [argv[0], *argv[split:], *_overrides(parsed)], arguments)


def _overrides(parsed: argparse.Namespace) -> list[str]:
    """Options as parameters of the node; JSON is YAML that needs no quotes."""
    given = {"host": parsed.host, "port": parsed.port, "allow_hosts": parsed.allow_host}
    for name in ("token_file", "users_file", "tls_cert", "tls_key"):
        path = getattr(parsed, name)
        given[name] = None if path is None else str(path.absolute())
    words = ["--ros-args"]
    for name, value in given.items():
        if value is not None:
            words += ["-p", f"{name}:={json.dumps(value)}"]
    return words


if __name__ == "__main__":
    sys.exit(main())
