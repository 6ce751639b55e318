"""A weld in real time with the operator's page beside it."""

from __future__ import annotations

import os
import secrets
import sys
from pathlib import Path

from fsw_experiment.graph import WeldGraph
from fsw_experiment.launcher import Launcher, LaunchError

_ADDRESS = r"http://\S+"


def weld(graph: WeldGraph, launcher: Launcher, port: int) -> int:
    """Weld to the scenario's end; Ctrl-C ends everything. Returns the exit code.

    The page is no part of the weld: when it ends the weld goes on.
    """
    graph.folder.mkdir(parents=True, exist_ok=True)
    token, token_file = secrets.token_urlsafe(12), graph.folder / "token"
    _write_secret(token_file, token)
    launcher.start("hmi", "fsw_hmi.main", ["--port", str(port), "--token-file", str(token_file)])
    print(f"operator's page: {launcher.wait_for_text('hmi', _ADDRESS)}")
    print(f"token: {token}")
    minutes = graph.scenario.duration_s / 60.0
    print(f"{graph.scenario.name} takes {minutes:.0f} min and goes on if the page is closed; Ctrl-C ends it")
    print(f"bag: {graph.bag}", flush=True)
    player = graph.start(launcher)
    parts = [name for name in launcher.children if name not in ("hmi", "scenario", "supervisor", "standby")]
    page_told = False

    def over() -> bool:
        nonlocal page_told
        if not page_told and not launcher.children["hmi"].running:
            page_told = True
            print(f"the page has ended, the weld goes on; see {launcher.children['hmi'].log}", file=sys.stderr)
        return not player.running

    # an operator may hold the programme for as long as he likes
    launcher.wait_until(over, float("inf"), "the end of the weld", parts)
    if player.process.returncode:
        raise LaunchError(f"the scenario player has ended: {player.last_words()}")
    print(f"the weld is over; look at it: python3 scripts/run_hmi.py --bag {graph.bag}")
    return 0


def _write_secret(path: Path, text: str) -> None:
    """Write a file that its owner alone may read."""
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w", encoding="utf-8") as file:
        file.write(text + "\n")
