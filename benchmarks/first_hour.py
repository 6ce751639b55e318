#!/usr/bin/env python3
"""The first hour with do-mpc, python-control, GEKKO and this project, step by step.

Writes its page of results.

usage: first_hour.py [--quick] [--json FILE]

Each is installed by pip into an environment of its own, in a temporary folder. The others'
examples come from their repositories (``git``), the steps and mistakes from first_hour.yaml.
"""

from __future__ import annotations

import ast
import json
import os
import re
import resource
import subprocess
import tempfile
import time
import venv
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import _benchmark
import yaml

from fsw_analysis.report import numbers

PAGE = "first-hour"
TOOLS: dict[str, Any] = yaml.safe_load(Path(__file__).with_suffix(".yaml").read_text("utf-8"))
OURS = "fsw"
MODULES = {"do-mpc": "do_mpc", "python-control": "control", "GEKKO": "gekko", OURS: OURS}
#: rows of the page: title, unit, digits
ROWS = {
    "install_cpu_s": ("install by pip", "s CPU", 0),
    "install_mb": ("installed", "MB", 0),
    "install_packages": ("packages", "", 0),
    "import_cpu_s": ("import", "s CPU", 1),
    "example_lines": ("own example, to a figure of a closed loop", "lines", 0),
    "example_cpu_s": ("", "s CPU", 1),
    "steps_lines": ("own controller, own plant, comparison", "lines", 0),
    "own_controller_cpu_s": ("own controller, to the figure", "s CPU", 1),
    "own_plant_cpu_s": ("own plant, to the figure", "s CPU", 1),
    "compare_cpu_s": ("comparison, to the figure", "s CPU", 1),
}
_LONGEST_S = 1200.0
_SAVED = """
import matplotlib.pyplot as plt
for number in plt.get_fignums():
    plt.figure(number).savefig(f"shown_{number}.png")
"""


def python_of(text: str, until: str) -> str:
    """Code of a notebook up to a cell, without cells that only show a value, and without magic."""
    kept = []
    for cell in json.loads(text)["cells"]:
        code = "".join(cell["source"])
        if cell["cell_type"] != "code":
            continue
        if until and until in code:
            break
        code = re.sub(r"^[%!].*$", "", code, flags=re.MULTILINE)
        body = ast.parse(code).body
        if not all(isinstance(part, ast.Expr) and not _acts(part.value) for part in body):
            kept.append(code)
    return "\n".join(kept)


def _acts(value: ast.expr) -> bool:
    return isinstance(value, ast.Call) and ast.unparse(value.func) not in ("print", "type", "bool")


def lines_of(code: str) -> int:
    """Lines with code: neither blank nor comment."""
    return sum(
        bool(line.strip()) and not line.strip().startswith("#") for line in code.split("\n")
    )


class Environment:
    """A tool in its own environment."""

    def __init__(self, name: str, folder: Path) -> None:
        self._name, self._folder, self._tool = name, folder / name, TOOLS[name]
        self._python = self._folder / "env" / "bin" / "python"

    def install(self) -> dict[str, float]:
        """Make the environment and install the packages; times, size and number of packages."""
        venv.create(self._folder / "env", with_pip=True)
        before = self._size_mb()
        packages = [
            str(_benchmark.WORKSPACE) if name == "." else name for name in self._tool["packages"]
        ]
        began = time.monotonic()
        cpu_s, done = self._timed("-m", "pip", "install", "--no-cache-dir", "-q", *packages)
        if done.returncode:
            raise SystemExit(f"{self._name} cannot be installed: {done.stderr[-2000:]}")
        listed = self._timed("-m", "pip", "list", "--format", "json")[1].stdout
        return {
            "install_cpu_s": cpu_s,
            "install_wall_s": time.monotonic() - began,
            "install_mb": self._size_mb() - before,
            "install_packages": len(json.loads(listed)) - 2,  # pip and setuptools
        }

    def run(self, code: str) -> tuple[float, subprocess.CompletedProcess[str]]:
        """Run a program in a new folder; CPU time, result."""
        return self._timed("-c", code)

    def figure(self, code: str) -> float:
        """Run a program that writes a figure; CPU time."""
        cpu_s, done = self.run(code)
        if done.returncode or not list(self._scratch.glob("*.png")):
            raise SystemExit(f"{self._name} draws nothing: {done.stderr[-2000:]}")
        return cpu_s

    def _timed(self, *arguments: str) -> tuple[float, subprocess.CompletedProcess[str]]:
        self._scratch = Path(tempfile.mkdtemp(dir=self._folder))
        surroundings = os.environ | {
            "MPLBACKEND": "agg",
            "PYTHONPATH": "",
            "HOME": str(self._folder),
        }
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        done = subprocess.run(
            [self._python, *arguments],
            cwd=self._scratch, env=surroundings, capture_output=True, text=True,
            timeout=_LONGEST_S, check=False,
        )  # fmt: skip
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, done

    def _size_mb(self) -> float:
        files = (self._folder / "env").rglob("*")
        return sum(file.stat().st_size for file in files if file.is_file()) / 1e6


def example_of(name: str, clones: Path) -> tuple[str, str]:
    """Code of the tool's own example, and the commit it is from."""
    tool = TOOLS[name]
    if name == OURS:
        text = (_benchmark.WORKSPACE / tool["example"]).read_text(encoding="utf-8")
        block = re.search(r"```python\n(import fsw\n.*?)```", text, re.DOTALL)
        assert block is not None
        return block.group(1), ""
    folder = clones / tool["repository"].rpartition("/")[2]
    if not folder.exists():
        _git("clone", "-q", "--depth", "1", tool["repository"], str(folder))
    text = _git("-C", str(folder), "show", f"HEAD:{tool['example']}")
    if tool["example"].endswith(".ipynb"):
        text = python_of(text, tool["until"])
    for old, new in tool["changes"].items():
        text = text.replace(old, new)
    return text, _git("-C", str(folder), "rev-parse", "--short", "HEAD").strip()


def _git(*arguments: str) -> str:
    return subprocess.run(["git", *arguments], check=True, capture_output=True, text=True).stdout


def answer(mistake: Mapping[str, str], done: subprocess.CompletedProcess[str]) -> dict[str, Any]:
    """What a program with a mistake says: the end of its error, and whether that helps."""
    printed = done.stderr.strip()
    heads = list(re.finditer(r"^[\w.]*(?:Error|Exception|Warning)\b", printed, re.MULTILINE))
    text = printed[heads[-1].start() :] if heads and done.returncode else printed
    text = text if done.returncode else ""
    return {
        "code": mistake["code"],
        "silent": done.returncode == 0,
        "names_it": _has(text, mistake["wrong"]),
        "says_right": _has(text, mistake["right"]),
        "text": re.sub(r"(/[^\s/'\":]+){2,}/", "", " ".join(text.split()))[:200],
    }


def _has(text: str, word: str) -> bool:
    return bool(re.search(rf"(?<!\w){re.escape(word)}(?!\w)", text, re.IGNORECASE))


def measured(name: str, folder: Path) -> dict[str, Any]:
    """All steps with a tool."""
    tool, environment = TOOLS[name], Environment(name, folder)
    (folder / name).mkdir()
    figures: dict[str, Any] = environment.install()
    example, commit = example_of(name, folder)
    figures["commit"] = commit
    module = MODULES[name]
    _, done = environment.run(
        f"from importlib.metadata import version; print(version('{_dist(name)}'))"
    )
    figures["version"] = done.stdout.strip()
    figures["import_cpu_s"], _ = environment.run(f"import {module}")
    figures["example_lines"] = lines_of(example)
    figures["example_cpu_s"] = environment.figure(example + _SAVED)
    figures["steps_lines"] = lines_of(tool["setup"]) + sum(map(lines_of, tool["steps"].values()))
    for step, code in tool["steps"].items():
        whole = tool["setup"] + code.replace("{figure}", "figure.png")
        figures[f"{step}_cpu_s"] = environment.figure(whole)
    figures["mistakes"] = {
        title: answer(mistake, environment.run(f"{tool['setup']}\n{mistake['code']}\n")[1])
        for title, mistake in tool["mistakes"].items()
    }
    return figures


def _dist(name: str) -> str:
    return {OURS: "fsw-control", "python-control": "control"}.get(name, name.lower())


def lost(figures: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Rows in which this project needs more than the best of the others."""
    losses = []
    for key, (title, unit, digits) in ROWS.items():
        best = min((name for name in figures if name != OURS), key=lambda name: figures[name][key])
        own, other = figures[OURS][key], figures[best][key]
        if round(own, digits) > round(other, digits):
            title = title or ROWS["example_lines"][0]
            losses.append(
                f"{title}: {own:.{digits}f} {unit}, {best} {other:.{digits}f}".replace(" ,", ",")
            )
    return losses


def rows(figures: Mapping[str, Mapping[str, Any]]) -> list[list[str]]:
    """The table of the steps."""
    table = [["", "", *(f"{name} {of['version']}" for name, of in figures.items())]]
    for key, (title, unit, digits) in ROWS.items():
        table.append([title, unit, *(f"{of[key]:.{digits}f}" for of in figures.values())])
    return table


def mistakes(figures: Mapping[str, Mapping[str, Any]]) -> list[list[str]]:
    """The table of the mistakes."""
    table = [["mistake", *figures]]
    for title in next(iter(figures.values()))["mistakes"]:
        table.append([title, *(_verdict(of["mistakes"][title]) for of in figures.values())])
    return table


def _verdict(said: Mapping[str, Any]) -> str:
    if said["silent"]:
        return "no error"
    parts = [
        word
        for word, key in (("names it", "names_it"), ("says what is right", "says_right"))
        if said[key]
    ]
    return ", ".join(parts) or "an error that names neither"


def content_of(figures: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Content of the page."""
    examples = {
        name: f"{tool['repository']}, `{tool['example']}`, {figures[name]['commit']}"
        for name, tool in TOOLS.items()
        if tool["repository"]
    }
    tables = {"rows": rows(figures), "mistakes": mistakes(figures), "lost": lost(figures)}
    return {**tables, "examples": examples}


def measure(quick: bool) -> tuple[dict[str, Any], dict[str, Any]]:
    """Figures of all tools, and the content of the page; writes the page's numbers."""
    with tempfile.TemporaryDirectory() as folder:
        figures = {name: measured(name, Path(folder)) for name in ([OURS] if quick else TOOLS)}
    if quick:
        return _benchmark.flat(figures), {}
    (_benchmark.RESULTS / f"{PAGE}_tables.json").write_text(numbers(figures), "utf-8")
    return _benchmark.flat(figures), content_of(figures)


if __name__ == "__main__":
    _benchmark.run(__doc__, "this project alone, no page", measure, PAGE)
