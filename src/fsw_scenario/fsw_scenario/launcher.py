"""Starts the parts of the graph as processes, monitors them and ends them all in any case."""

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
from fsw_control.status_file import VARIABLE, read_status

_POLL_S = 0.02
#: exit code of a node whose arguments or parameters are wrong
REFUSED = 2
#: exit code of the scenario player after the programme of a weld was aborted
ABORTED = 3
#: pause before a process is started again, doubled each time that it ended sooner than _SOON_S;
#: how often (chosen)
RESPAWN_DELAY_S, _SOON_S, _MOST_SOON = 0.5, 10.0, 6


class LaunchError(RuntimeError):
    """A process could not be started, ended too early, or an awaited condition was not met in time."""


@dataclass(slots=True)
class Child:
    """One running part of the graph; its log has everything that it prints, after what its predecessors printed."""

    name: str
    process: subprocess.Popen[bytes]
    log: Path
    module: str
    arguments: Sequence[str]
    begin: int  #: of its part of the log

    @property
    def running(self) -> bool:
        """Whether it has not ended."""
        return self.process.poll() is None

    def text(self) -> str:
        """Its output so far."""
        return self.log.read_bytes()[self.begin :].decode(errors="replace")

    def status(self) -> dict[str, Any]:
        """The status that it wrote last, see ``fsw_control.status_file``."""
        return read_status(self.log.with_suffix(".status"))

    def last_lines(self) -> str:
        """The last lines that it printed, as one line; none of information where there are others."""
        lines = self.text().strip().splitlines()
        wrong = [line for line in lines if not line.startswith(("[DEBUG]", "[INFO]"))]
        return " | ".join((wrong or lines)[-5:]) or "it printed nothing"


class Launcher:
    """Context in which processes run; leaving it ends them: SIGINT, then SIGTERM, then SIGKILL, ``patience_s`` apart.

    All are in one ROS domain, and each has its ``<name>.log`` in ``log_folder``, which is made if
    necessary. Children that outlive the launcher because it was killed get SIGTERM from the kernel
    (Linux). A discovery server is not used: it joins the nodes of all domains into one graph.
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

    def start(self, name: str, module: str, arguments: Sequence[str] = ()) -> Child:
        """Start the ``main`` of a Python module as a process.

        One that has ended may be restarted; its log is continued.

        Raises
        ------
        LaunchError
            When a process of this name runs already.
        """
        if name in self.children and self.children[name].running:
            raise LaunchError(f"{name} is running already")
        command = [
            sys.executable,
            "-m",
            "fsw_scenario.child_process",
            str(os.getpid()),
            module,
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
                # a session of its own: Ctrl-C reaches the launcher alone, which then ends its
                # children in order
                start_new_session=True,
            )
        self.children[name] = child = Child(name, process, log, module, tuple(arguments), begin)
        return child

    def check(self, expected_to_run: Sequence[str] | None = None) -> None:
        """Raise LaunchError if a process (any, or one of those named) has ended."""
        for name in self.children if expected_to_run is None else expected_to_run:
            child = self.children[name]
            if not child.running:
                code = child.process.returncode
                raise LaunchError(
                    f"{name} has ended with exit code {code}: {child.last_lines()} (see {child.log})"
                )

    def wait_until(
        self,
        condition: Callable[[], object],
        timeout_s: float,
        what: str,
        watch: Sequence[str] | None = None,
    ) -> None:
        """Wait until ``condition`` is true while the processes run; ``what`` names it in the error message.

        Raises
        ------
        LaunchError
            When a process of ``watch`` (by default any) ends, or when it takes too long.
        """
        end = time.monotonic() + timeout_s
        while not condition():
            self.check(watch)
            if time.monotonic() > end:
                raise LaunchError(
                    f"waited {timeout_s:g} s without success for {what}; logs are in {self.log_folder}"
                )
            time.sleep(_POLL_S)

    def stop(self, *names: str) -> dict[str, int]:
        """End processes (all by default, the last started first) and return their exit codes."""
        chosen = (
            [self.children[name] for name in names]
            if names
            else list(reversed(self.children.values()))
        )
        for sign in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL):
            for child in chosen:
                child.process.send_signal(sign)  # nothing happens to one that has ended
            end = time.monotonic() + self._patience_s
            while any(child.running for child in chosen) and time.monotonic() < end:
                time.sleep(_POLL_S)
        return {child.name: child.process.wait() for child in chosen}


@dataclass(slots=True)
class _Restarts:
    """State of a process that is restarted when it ends."""

    began_s: float
    due_s: float | None = None  #: when it is to be started again
    first: bool = True  #: whether it has not been started again yet
    soon: int = 0  #: how often in succession it ended soon after its start


class Respawn:
    """Restarts processes that have ended, as the launch file does, and says so.

    ``names`` are running processes; ``report`` gets a line for the person at the console;
    ``clock`` is monotonic.
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
        """Restart processes that have ended; to be called often.

        Raises
        ------
        LaunchError
            When a process refuses its very first start. A later refusal may pass, as a full disk
            does.
        """
        now_s = self._clock()
        for name, restarts in self._restarts.items():
            child = self._launcher.children[name]
            if child.running or restarts.soon >= _MOST_SOON:
                continue
            if restarts.due_s is None:
                self._on_end(child, restarts, now_s)
            elif now_s >= restarts.due_s:
                self._launcher.start(name, child.module, child.arguments)
                restarts.began_s, restarts.due_s, restarts.first = now_s, None, False

    def _on_end(self, child: Child, restarts: _Restarts, now_s: float) -> None:
        code = child.process.returncode
        if restarts.first and code == REFUSED:
            self._launcher.check([child.name])
        restarts.soon = restarts.soon + 1 if now_s - restarts.began_s < _SOON_S else 0
        restarts.due_s = now_s + RESPAWN_DELAY_S * 2.0 ** max(0, restarts.soon - 1)
        what = "is started again"
        if restarts.soon >= _MOST_SOON:
            what = f"is given up: it ended {restarts.soon} times in succession"
        self._report(f"{child.name} has ended with exit code {code} and {what}; see {child.log}")
