"""A weld in real time with the operator page."""

from __future__ import annotations

import contextlib
import secrets
import sys
from pathlib import Path
from urllib.parse import urlsplit

from fsw_scenario.graph import ONCE, WeldGraph
from fsw_scenario.launcher import Child, Launcher, Respawn

_PATIENCE_S = 120.0


def weld(graph: WeldGraph, launcher: Launcher, port: int) -> int:
    """Weld to the scenario's end; Ctrl-C ends all processes. Returns the exit code.

    Processes that die are restarted, except for plant and player: a weld cannot start half-way.
    Without them the others run until Ctrl-C, so that the operator can see why it has stopped, or
    stop it. The page stays after the weld, until Ctrl-C.
    """
    scenario = graph.scenario
    assert scenario is not None
    graph.folder.mkdir(parents=True, exist_ok=True)
    token, token_file = secrets.token_urlsafe(12), graph.folder / "token"
    token_file.touch(0o600, exist_ok=False)  # only its owner can read it
    token_file.write_text(f"{token}\n", encoding="utf-8")
    hmi = launcher.start("hmi", "hmi", ["--port", str(port), "--token-file", str(token_file)])
    launcher.wait_until(hmi.status, _PATIENCE_S, "the operator's page")
    url = hmi.status()["url"]
    # the same port after a restart
    hmi.arguments = ["--port", str(urlsplit(url).port), *hmi.arguments[2:]]
    print(f"operator's page: {url}")
    print(f"token: {token}")
    minutes = scenario.duration_s / 60.0
    print(
        f"{scenario.name} takes {minutes:.0f} min and continues if the page is closed; "
        "Ctrl-C ends it"
    )
    print(f"bag: {graph.bag}")
    # a domain of its own separates the weld from others on this machine; fsw.py has to know it
    print(
        f"ROS domain: {launcher.domain}; "
        f"in another terminal: export ROS_DOMAIN_ID={launcher.domain}",
        flush=True,
    )
    _weld(launcher, graph.start(launcher))
    launcher.stop("plant")  # first, so that the bag does not show the others leaving
    launcher.stop(*(name for name in reversed(launcher.children) if name != "hmi"))
    print("the weld is over; look at it:")
    is_installed = Path(sys.argv[0]).name == "fsw"
    page = "fsw node hmi" if is_installed else "python3 scripts/run_hmi.py"
    for bag in sorted(graph.folder.glob("bag*")):
        print(f"  {page} --bag {bag}")
    print("the page stays; Ctrl-C ends it", flush=True)
    respawn = Respawn(launcher, ["hmi"])
    with contextlib.suppress(KeyboardInterrupt):
        launcher.wait_until(respawn.update, float("inf"), "Ctrl-C", [])
    return 0


def _weld(launcher: Launcher, player: Child) -> None:
    """Weld to the scenario's end; the page also survives the plant and the player."""
    respawn = Respawn(launcher, [name for name in launcher.children if name not in ONCE])
    ended = set[str]()

    def over() -> bool:
        respawn.update()
        status = player.status()
        if not player.running and status.get("finished"):
            return True
        for child in (launcher.children["plant"], player):
            if child.running or child.name in ended:
                continue
            if not status:
                launcher.check([child.name])
            ended.add(child.name)
            print(
                f"{child.name} has ended with exit code {child.process.returncode}: "
                f"{child.last_lines()}\n"
                "the other processes keep running, also the page; Ctrl-C ends them",
                file=sys.stderr,
                flush=True,
            )
        return False

    # the programme may be held for any length of time
    launcher.wait_until(over, float("inf"), "the end of the weld", [])
