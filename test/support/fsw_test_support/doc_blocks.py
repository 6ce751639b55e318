"""The code blocks of the documentation, to run them as a reader would.

Each page has a folder of its own in which its blocks run one after the other, as a reader would
type them. Its Python is one program. A block with a title is that file. A comment before a block
says which test checks what cannot run, that it takes minutes, or what the reader has done
elsewhere (``$SHARED`` is a folder of all pages)::

    <!-- checked by: test/test_ros2_commands.py -->
    <!-- takes minutes -->
    <!-- before: scripts/fsw.py simulate quick --bag --out $SHARED/weld -->

The lines of a block marked ``<!-- stays up, ready: TEXT -->`` each run in a terminal of their own,
in the page's ROS domain. They are up while the other blocks of the page's section run, and end
with Ctrl-C.
"""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from fsw_control.free_domain import free_domain
from fsw_scenario.child_process import end_with_parent
from fsw_test_support.waiting import PATIENCE_S, wait_until

WORKSPACE = Path(__file__).resolve().parents[3]
#: what commands name by its path in the workspace; all else is written into the page's folder
LINKED = ("scripts", "src", "lab", "quality", "test", "examples", "benchmarks", "requirements")
#: Pages that take one or two minutes each. CI runs them in a job of their own, so that ``.ci/run``
#: ends within half an hour.
MINUTES = {
    *("bags", "campaigns", "canister-heat", "canister-weld", "evidence", "history"),
    *("identify", "learn", "record"),
}
_COMMAND = re.compile(
    r"(\S*/)?(python3?|fsw|pip) |\S*/\S+\.py |(sed|echo|head|env|cmake|ros2|rosdep|colcon|fsw\.py) "
)
_BLOCK = re.compile(
    r"^(?:<!-- (?P<mark>checked by: [^\n]*?|takes minutes|stays up, ready: [^\n]*?) -->\n)?"
    r"(?:<!-- before: (?P<before>[^\n]*?) -->\n)?"
    r"```(?P<language>\w*)(?: title=\"(?P<file>\S+)\")?\n(?P<text>.*?)^```$",
    re.MULTILINE | re.DOTALL,
)
_UP, _CHECKED = "stays up, ready: ", "checked by: "
LONGEST_S = 1800.0
#: of what Ctrl-C ends; the last one where it had hardly begun, which a shell calls 130, too
_CODES = (0, 130, -signal.SIGINT)
_Terminal = tuple[subprocess.Popen[str], Path]  #: its process, and what it has printed


@dataclass(frozen=True)
class Block:
    """A block that a reader can run."""

    path: Path  #: of the page
    line: int
    language: (
        str  #: ``python``, ``console``, ``bash`` (all of it is a script) or, of a file, its own
    )
    code: str  #: what to run; a shell's prompts and the output shown are left out
    file: str  #: name of the file that the block is
    shown: tuple[str, ...]  #: lines of output that the page shows after prompts
    mark: str  #: which test checks it, ``takes minutes``, or what shows that it is up
    section: int  #: of the page

    @property
    def fails(self) -> bool:
        """Whether the page shows that the command fails."""
        return any(line.startswith("error: ") for line in self.shown)

    @property
    def checked_by(self) -> Path | None:
        """The test that checks what cannot run."""
        name = self.mark.removeprefix(_CHECKED)
        return WORKSPACE / name if name != self.mark else None

    @property
    def commands(self) -> list[str]:
        """Lines of a shell's block without comments."""
        return [line.partition(" #")[0].strip() for line in self.code.splitlines()]

    @property
    def ready(self) -> str:
        """What it prints when it is up; empty unless it stays up."""
        return self.mark.removeprefix(_UP) if self.mark.startswith(_UP) else ""

    def __str__(self) -> str:
        return f"{self.path.relative_to(WORKSPACE)}:{self.line}"


def _commands(text: str) -> str:
    """The commands of a shell's block.

    Lines after a prompt, or all that call a program of ours.
    """
    lines = text.replace("\\\n", " ").splitlines()
    prompted = [line[2:] for line in lines if line.startswith("$ ")]
    return "\n".join(prompted or [line for line in lines if _COMMAND.match(line)])


def _shown(text: str) -> tuple[str, ...]:
    """Lines of output below a prompt; ``…`` stands for others, or for words that differ."""
    lines = text.replace("\\\n", " ").splitlines()
    after = next((i for i, line in enumerate(lines) if line.startswith("$ ")), len(lines))
    output = (line.strip() for line in lines[after:] if not line.startswith("$ "))
    return tuple(line for line in output if line not in ("", "…"))


def _printed(line: str, output: str) -> bool:
    parts = (re.escape(part) for part in line.split("…"))
    return re.search(".*".join(parts), output) is not None


def lines_of(text: str) -> list[str]:
    """Lines of a page's blocks without prompts, and its inline code."""
    text = text.replace("\\\n", " ")
    parts = re.findall(r"^```\w*\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    rest = re.sub(r"^```.*?^```", "", text, flags=re.MULTILINE | re.DOTALL)
    inline = re.findall(r"`([^`\n]+)`", rest)
    return [line.removeprefix("$ ") for line in [*"\n".join(parts).splitlines(), *inline]]


def blocks(path: Path) -> list[Block]:
    """Those of a page, in its order."""
    text = path.read_text("utf-8")
    result = []
    for match in _BLOCK.finditer(text):
        language = match["language"] or "console"
        code = _commands(match["text"]) if language == "console" else match["text"]
        if code and (match["file"] or language in ("python", "console")):
            result.append(
                Block(
                    path=path,
                    line=text.count("\n", 0, match.start("language")) + 1,
                    language=language,
                    code="\n".join(filter(None, (match["before"], code))),
                    file=match["file"] or "",
                    shown=_shown(match["text"]) if language == "console" else (),
                    mark=match["mark"] or "",
                    section=len(re.findall(r"^#+ ", text[: match.start()], re.MULTILINE)),
                )
            )
    return result


def pages(kind: str | None = None) -> list[Path]:
    """Pages with blocks; the gallery's have a test of their own, results are generated.

    Of a kind only those with blocks to run: ``graph`` where nodes stay up, ``series`` of those who
    share its welds, else an empty text.
    """
    written = [WORKSPACE / "README.md", *sorted((WORKSPACE / "docs").rglob("*.md"))]
    others = {"gallery", "results"}
    pages = [path for path in written if not others & {*path.parts} and blocks(path)]
    return pages if kind is None else [path for path in pages if _kind(chosen(path)) == kind]


def _kind(of_page: list[Block]) -> str | None:
    if any(block.ready for block in of_page):
        return "graph"
    if any("$SHARED/series" in block.code for block in of_page):
        return "series"
    return "" if any(not block.file for block in of_page) else None


def chosen(path: Path) -> list[Block]:
    """The blocks of a page that run; with ``FSW_ALL_BLOCKS`` also those that take minutes."""
    every = "FSW_ALL_BLOCKS" in os.environ
    if path.stem in MINUTES and not every:
        return []
    return [
        block
        for block in blocks(path)
        if not block.mark or block.ready or (every and not block.checked_by)
    ]


def run(path: Path, root: Path) -> None:
    """Run a page's blocks in a folder; an assertion fails where one does not end as shown."""
    with Page(path, root) as page:
        for block in chosen(path):
            assert page.run(block) == "", block
        assert page.end() == ""


@contextmanager
def _ports() -> Iterator[None]:
    """Reserve the ports that commands name, e.g. 8080, against other runs on this machine.

    The reservation is the name of a local socket, as that of a ROS domain is.
    """
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as reservation:

        def bound() -> bool:
            with suppress(OSError):
                reservation.bind("\0fsw_doc_blocks")
            return bool(reservation.getsockname())

        wait_until(bound, "another run of pages to leave their ports", LONGEST_S)
        yield


class Page:
    """A page and the folder in which its blocks run."""

    def __init__(self, path: Path, root: Path):
        self.blocks = blocks(path)
        self.folder = root / path.stem
        self.folder.mkdir()
        for name in LINKED:
            (self.folder / name).symlink_to(WORKSPACE / name)
        (self.folder / ".venv").symlink_to(sys.prefix)
        #: a page's Python is one program, which runs with its last block
        self._python: list[str] = []
        self._section = 0
        self._up: list[_Terminal] = []
        self._held = ExitStack()

    def __enter__(self) -> Page:
        if any(block.ready for block in self.blocks):
            self._held.enter_context(_ports())
        self._environment = {
            **os.environ,
            "HOME": str(self.folder),  # for keys and files that pages write there
            "XDG_CACHE_HOME": os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache"),
            "MPLBACKEND": "Agg",
            "PIP_NO_COMPILE": "1",  # only what is imported, then
            "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
            "SHARED": str(self.folder.parent.parent),
            "ROS_DOMAIN_ID": str(self._held.enter_context(free_domain())),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        }
        return self

    def __exit__(self, *_: object) -> None:
        self.end()
        self._held.close()

    def run(self, block: Block) -> str:
        """Run a block.

        The end of its output where it does not end as the page shows, else nothing.
        """
        ended = self.end() if block.section != self._section else ""
        self._section = block.section
        if ended:
            return ended
        if block.file:
            (self.folder / block.file).write_text(block.code, encoding="utf-8")
            return ""
        if block.ready:
            return self._start(block)
        command = ["bash", "-euo", "pipefail", "-c", block.code]
        if block.language == "python":
            self._python.append(block.code)
            if len(self._python) < sum(
                b.language == "python" and not (b.file or b.mark) for b in self.blocks
            ):
                return ""
            program = self.folder / "blocks.py"
            program.write_text("".join(self._python), encoding="utf-8")
            command = [sys.executable, program.name]
        done = subprocess.run(
            command,
            cwd=self.folder,
            env=self._environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=LONGEST_S,
            check=False,
        )
        as_shown = (done.returncode != 0) == block.fails
        missing = [line for line in block.shown if not _printed(line, done.stdout)]
        return "" if as_shown and not missing else f"{missing}: {done.stdout[-2000:]}"

    def _start(self, block: Block) -> str:
        """Start each line of a block, and wait until all that shows that they are up is printed.

        That it is ready may also be seen in a terminal that is up already.
        """
        started: list[_Terminal] = []
        before = {log: log.stat().st_size for _, log in self._up}
        for line in block.code.splitlines():
            log = self.folder / f"terminal_{len(self._up) + 1}.log"
            with log.open("w") as stream:
                process = subprocess.Popen(
                    ["bash", "-c", f"exec {line}"],
                    cwd=self.folder,
                    env=self._environment,
                    stdout=stream,
                    stderr=subprocess.STDOUT,
                    start_new_session=True,  # as a terminal, whose Ctrl-C reaches all in it
                    preexec_fn=partial(end_with_parent, os.getpid()),
                    text=True,
                )
            started.append((process, log))
            self._up.append((process, log))

        def output(terminals: list[_Terminal]) -> str:
            new = (log.read_bytes()[before.get(log, 0) :] for _, log in terminals)
            return b"".join(new).decode("utf-8", "replace")

        def missing() -> list[str]:
            lines = [line for line in block.shown if not _printed(line, output(started))]
            return lines if _printed(block.ready, output(self._up)) else [block.ready, *lines]

        wait_until(
            lambda: not missing() or any(process.poll() is not None for process, _ in started),
            f"{block.code} to print {[block.ready, *block.shown]}",
        )
        left = missing()
        return f"{left}: {output(self._up)[-2000:]}" if left else ""

    def end(self) -> str:
        """End with Ctrl-C, the last first, what is up.

        What did not end as it should, with its output.
        """
        faults = []
        while self._up:
            process, log = self._up.pop()
            if (code := process.poll()) is not None:
                faults.append(
                    f"{process.args!r} ended by itself: {code}: {log.read_text('utf-8')[-2000:]}"
                )
                continue
            try:
                os.killpg(process.pid, signal.SIGINT)
                code = process.wait(PATIENCE_S)
            except subprocess.TimeoutExpired:
                os.killpg(process.pid, signal.SIGKILL)
                code = process.wait()
            if code not in _CODES:
                faults.append(f"{process.args!r}: {code}: {log.read_text('utf-8')[-2000:]}")
        return "\n".join(faults)
