"""Starts the parts of the graph as processes, monitors them, and always ends them."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fsw_control.fast_dds import stay_on_this_machine
from fsw_control.schema.extensions import program_path
from fsw_control.schema.files import VARIABLE, read_status

_POLL_S = 0.02
#: exit code of a node with invalid arguments or parameters
REFUSED = 2
#: exit code of the scenario player after the programme of a weld was aborted
ABORTED = 3
#: pause before a restart, doubled each time that the process ended sooner than _SOON_S; number of
#: such restarts (chosen)
RESPAWN_DELAY_S, _SOON_S, _MOST_SOON = 0.5, 10.0, 6


class LaunchError(RuntimeError):
    """A process could not be started, ended too early, or a condition timed out."""


@dataclass(slots=True)
class Child:
    """A running part of the graph; its log contains its output after its predecessors'."""

    name: str
    process: subprocess.Popen[bytes]
    log: Path
    program: str
    arguments: Sequence[str]
    begin: int  #: of its part of the log

    @property
    def running(self) -> bool:
        """Whether it is running."""
        return self.process.poll() is None

    def text(self) -> str:
        """Its output so far."""
        return self.log.read_bytes()[self.begin :].decode(errors="replace")

    def status(self) -> dict[str, Any]:
        """Its last status, see ``fsw_control.schema.files``."""
        return read_status(self.log.with_suffix(".status"))

    def last_lines(self) -> str:
        """Its last output lines joined; without information lines if there are others."""
        lines = self.text().strip().splitlines()
        wrong = [line for line in lines if not line.startswith(("[DEBUG]", "[INFO]"))]
        return " | ".join((wrong or lines)[-5:]) or "it printed nothing"


class Launcher:
    """Context of processes; on exit: SIGINT, SIGTERM, SIGKILL, ``patience_s`` apart.

    All share a ROS domain, and each has its ``<name>.log`` in ``log_folder``, which is created if
    necessary. Children that survive a killed launcher get SIGTERM from the kernel (Linux). There
    is no discovery server: it would join the nodes of all domains into one graph.
    """

    def __init__(self, log_folder: Path, domain: int, patience_s: float = 15.0) -> None:
        self.log_folder, self.domain = log_folder, domain
        self.children: dict[str, Child] = {}
        self._patience_s = patience_s
        self._environment = {
            **os.environ,
            "ROS_DOMAIN_ID": str(domain),
            "PYTHONUNBUFFERED": "1",
            "PYTHONPATH": os.pathsep.join(path for path in sys.path if path),
        }
        self._environment.pop("ROS_DISCOVERY_SERVER", None)
        stay_on_this_machine(self._environment)
        log_folder.mkdir(parents=True, exist_ok=True)

    def __enter__(self) -> Launcher:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def start(self, name: str, program: str, arguments: Sequence[str] = ()) -> Child:
        """Start a node (entry point in ``fsw.nodes``), or a module's ``main``, as a process.

        A process that has ended may be restarted; its log is continued.

        Raises
        ------
        LaunchError
            If a process of this name is running.
        """
        if name in self.children and self.children[name].running:
            raise LaunchError(f"{name} is running already")
        command = [
            sys.executable,
            "-m",
            "fsw_scenario.child_process",
            str(os.getpid()),
            program_path(program),
            *arguments,
        ]
        log = self.log_folder / f"{name}.log"
        status = log.with_suffix(".status")
        status.unlink(missing_ok=True)
        with log.open("ab" if name in self.children else "wb") as file:
            begin = file.tell()
            process = subprocess.Popen(
                command,
                env={**self._environment, VARIABLE: str(status)},
                stdin=subprocess.DEVNULL,
                stdout=file,
                stderr=subprocess.STDOUT,
                # a session of its own: Ctrl-C reaches only the launcher, which then ends its
                # children in order
                start_new_session=True,
            )
        self.children[name] = child = Child(name, process, log, program, tuple(arguments), begin)
        return child

    def check(self, expected_to_run: Sequence[str] | None = None) -> None:
        """Raise LaunchError if a process (any, or a named one) has ended."""
        for name in self.children if expected_to_run is None else expected_to_run:
            child = self.children[name]
            if not child.running:
                code = child.process.returncode
                raise LaunchError(
                    f"{name} has ended with exit code {code}: "
                    f"{child.last_lines()} (see {child.log})"
                )

    def wait_until(
        self,
        condition: Callable[[], object],
        timeout_s: float,
        awaited: str,
        watch: Sequence[str] | None = None,
    ) -> None:
        """Wait for a ``condition`` while the processes run; errors name what is ``awaited``.

        Raises
        ------
        LaunchError
            If a process of ``watch`` (by default any) ends, or on a time-out.
        """
        end = time.monotonic() + timeout_s
        while not condition():
            self.check(watch)
            if time.monotonic() > end:
                raise LaunchError(
                    f"waited {timeout_s:g} s without success for {awaited}; "
                    f"logs are in {self.log_folder}"
                )
            time.sleep(_POLL_S)

    def stop(self, *names: str) -> dict[str, int]:
        """End processes (default: all, last started first) and return their exit codes."""
        chosen = (
            [self.children[name] for name in names]
            if names
            else list(reversed(self.children.values()))
        )
        for sign in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL):
            for child in chosen:
                child.process.send_signal(sign)  # no effect on one that has ended
            end = time.monotonic() + self._patience_s
            while any(child.running for child in chosen) and time.monotonic() < end:
                time.sleep(_POLL_S)
        return {child.name: child.process.wait() for child in chosen}


@dataclass(slots=True)
class _Restarts:
    """State of a process that is restarted when it ends."""

    began_s: float
    due_s: float | None = None  #: time of the next restart
    first: bool = True  #: it has not been restarted yet
    soon: int = 0  #: number of consecutive early ends


class Respawn:
    """Restarts processes that have ended, like the launch file, and reports it.

    ``names`` are running processes; ``report`` gets a line for the console; ``clock`` is
    monotonic.
    """

    def __init__(
        self,
        launcher: Launcher,
        names: Sequence[str],
        report: Callable[[str], object] = lambda line: print(line, file=sys.stderr, flush=True),
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._launcher, self._report, self._clock = launcher, report, clock
        self._restarts = {name: _Restarts(clock()) for name in names}

    def update(self) -> None:
        """Restart processes that have ended; call it often.

        Raises
        ------
        LaunchError
            If a process is refused at its very first start. A later refusal may be temporary, such
            as a full disk.
        """
        now_s = self._clock()
        for name, restarts in self._restarts.items():
            child = self._launcher.children[name]
            if child.running or restarts.soon >= _MOST_SOON:
                continue
            if restarts.due_s is None:
                self._on_end(child, restarts, now_s)
            elif now_s >= restarts.due_s:
                self._launcher.start(name, child.program, child.arguments)
                restarts.began_s, restarts.due_s, restarts.first = now_s, None, False

    def _on_end(self, child: Child, restarts: _Restarts, now_s: float) -> None:
        code = child.process.returncode
        if restarts.first and code == REFUSED:
            self._launcher.check([child.name])
        restarts.soon = restarts.soon + 1 if now_s - restarts.began_s < _SOON_S else 0
        restarts.due_s = now_s + RESPAWN_DELAY_S * 2.0 ** max(0, restarts.soon - 1)
        outcome = "is started again"
        if restarts.soon >= _MOST_SOON:
            outcome = f"is given up: it ended {restarts.soon} times in succession"
        self._report(
            f"{child.name} has ended with exit code {code} and {outcome}; see {child.log}"
        )
