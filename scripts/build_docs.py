#!/usr/bin/env python3
"""Builds the documentation as a site in out/site, with the packages' generated reference.

usage: build_docs.py [--check]

The reference and the table of the safety requirements exist in the site alone. A few committed
pages hold a table or a drawing that is made from other files; they are rewritten. ``--check``
writes nothing outside out/site: the exit code is 1 when one of these pages is out of date. It is
always 1 when a requirement of the safety case has no test, and when the site has a dead link.
MkDocs loads this file as its hook: it adds the generated pages and turns formulas into MathML.
"""

from __future__ import annotations

import argparse
import html
import json
import os
import re
import subprocess
import sys
from itertools import takewhile
from pathlib import Path
from typing import Any

from _bootstrap import DISTRIBUTIONS, ensure

if __name__ == "__main__":
    ensure(dev=True)

import block_diagram
import safety_case
import yaml
from build_gallery import NOTEBOOKS, cells
from draw_state_machine import svg_diagram
from latex2mathml.converter import convert
from mkdocs.structure.files import File
from reference_pages import reference

import fsw

WORKSPACE = Path(__file__).resolve().parent.parent
CONTRIBUTING = WORKSPACE / "CONTRIBUTING.md"
#: what README calls the parts of the reference, and their first pages
REFERENCE = {
    "parameters": "reference/parameters.md",
    "messages": "reference/messages.md",
    "files": "reference/scenarios.md",
    "commands": "reference/command-line.md",
}
VERDICT = WORKSPACE / "docs" / "results" / "nmpc-or-pi.md"


def with_rows(page: str) -> str:
    """The page with the present rows of results tables that its marks ask for."""

    def rows(match: re.Match[str]) -> str:
        name, heading, labels = (
            match[1],
            match[2],
            {label.strip() for label in (match[3] or "").split(";")} - {""},
        )
        text = (WORKSPACE / "docs" / "results" / name).read_text(encoding="utf-8")
        section = text.partition(f"\n## {heading}\n")[2].partition("\n## ")[0]
        lines = list(
            takewhile(
                lambda line: line.startswith("|"), section[section.find("\n|") + 1 :].splitlines()
            )
        )
        taken = [line for line in lines[2:] if not labels or line.split("|")[1].strip() in labels]
        if not taken or (labels and len(taken) != len(labels)):
            raise SystemExit(f"docs/results/{name}, {heading}: not all rows are there: {match[3]}")
        return "\n".join(
            [match[0].partition("\n")[0], "", *lines[:2], *taken, "", "<!-- rows: end -->"]
        )

    pattern = r"<!-- rows of (\S+), ([^:\n]*?)(?:: (.*?))? -->\n.*?<!-- rows: end -->"
    return re.sub(pattern, rows, page, flags=re.DOTALL)


def with_packages(page: str) -> str:
    """The page with the drawing of the packages.

    An arrow leads to what is needed, unless a longer way leads there.
    """
    imports: dict[str, set[str]] = {}
    lines = ["```mermaid", "graph TD"]
    for folder in reversed(DISTRIBUTIONS):
        lines.append(f"    subgraph {folder.name}")
        for file in sorted(folder.glob("*/package.xml")):
            needed = re.findall(r"<(?:exec_|build_)?depend>(fsw\w*)<", file.read_text("utf-8"))
            imports[file.parent.name] = {*needed} - {"fsw_msgs"}
            lines.append(f"        {file.parent.name}")
        lines.append("    end")

    def below(name: str) -> set[str]:
        return imports[name] | {other for package in imports[name] for other in below(package)}

    for name, direct in imports.items():
        far = {other for package in direct for other in below(package)}
        lines += [f"    {name} --> {other}" for other in sorted(direct - far)]
    drawing = "\n".join([*lines, "```"])
    pattern = r"(<!-- packages: begin -->\n\n).*?(\n\n<!-- packages: end -->)"
    return re.sub(pattern, lambda match: f"{match[1]}{drawing}{match[2]}", page, flags=re.DOTALL)


def with_reference(page: str) -> str:
    """The first page with links to the pages of the reference, which are in the site alone."""
    for words, name in REFERENCE.items():
        page, count = re.subn(rf"(reference of all .*?)\b{words}\b", rf"\1[{words}]({name})", page)
        if count != 1:
            raise SystemExit(f"README.md, reference of all: {words} is named {count} times")
    return page


def notebook(text: str) -> str:
    """A script in cells as a notebook of Jupyter (nbformat 4)."""
    code: dict[str, Any] = {"execution_count": None, "outputs": []}
    return json.dumps(
        {
            "cells": [
                {
                    "cell_type": "markdown" if is_text else "code",
                    "metadata": {},
                    "source": content.splitlines(keepends=True),
                    **({} if is_text else code),
                }
                for is_text, content in cells(text)
            ],
            "metadata": {"language_info": {"name": "python"}},
            "nbformat": 4,
            "nbformat_minor": 4,
        }
    )


def on_config(config: Any) -> Any:
    """Name the version in the header of every page."""
    config.site_name = f"{config.site_name} {fsw.__version__}"
    return config


def on_files(files: Any, config: Any) -> Any:
    """Add the pages that are not committed."""
    pages = {f"reference/{name}": text for name, text in reference().items()}
    requirements, results = (
        yaml.safe_load(safety_case.REQUIREMENTS.read_text("utf-8")),
        safety_case.load_results()[0],
    )
    pages["concepts/safety-requirements.md"] = safety_case.table(
        requirements, safety_case.marked(), results
    )
    readme = (WORKSPACE / "README.md").read_text("utf-8")
    readme = re.sub(r"^Changes: .*\n\n", "", readme, flags=re.M)  # these files are no pages
    index = re.sub(
        r"\]\((?:docs/)?(?!\w+:)", lambda m: "](" if "docs" in m[0] else "](../", readme
    )
    pages["index.md"] = with_reference(index)
    for path in NOTEBOOKS.glob("*.py"):
        pages[f"gallery/{path.stem}.ipynb"] = notebook(path.read_text("utf-8"))
    for name, text in pages.items():
        files.append(File.generated(config, name, content=text))
    return files


def on_page_markdown(text: str, page: Any, config: Any, files: Any) -> str:
    """Draw what would need a script from the network, and offer the gallery's notebooks."""
    folder, _, name = page.file.src_uri.rpartition("/")
    if folder == "gallery":
        file = Path(name).with_suffix(".ipynb")
        text += f"\n[Download the notebook]({file}){{ download={file} .md-button }}\n"

    def drawn(match: re.Match[str]) -> str:
        is_graph = match[1].startswith("graph LR")
        return f"{block_diagram.svg(match[1], name) if is_graph else svg_diagram()}\n"

    return re.sub(r"```mermaid\n(.*?)```\n", drawn, text, flags=re.DOTALL)


def on_page_content(content: str, page: Any, config: Any, files: Any) -> str:
    """Formulas as MathML."""

    def mathml(match: re.Match[str]) -> str:
        tex = html.unescape(match[2] or match[3])
        tag = re.search(r"\\tag\{(.*?)\}", tex)
        formula = convert(
            tex.replace(tag[0], "") if tag else tex, display="inline" if match[2] else "block"
        )
        number = f"<span>({tag[1]})</span>" if tag else ""
        return formula if match[2] else f'<div class="equation">{number}{formula}</div>'

    pattern = r'<(span|div) class="arithmatex">(?:\\\((.*?)\\\)|\s*\\\[(.*?)\\\]\s*)</\1>'
    return re.sub(pattern, mathml, content, flags=re.DOTALL)


def main() -> int:
    """Run the script; returns the exit code."""
    cli = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    cli.add_argument(
        "--check",
        action="store_true",
        help="only check whether the committed pages are up to date",
    )
    check: bool = cli.parse_args().check
    requirements, tests = (
        yaml.safe_load(safety_case.REQUIREMENTS.read_text("utf-8")),
        safety_case.marked(),
    )
    safety = safety_case.PAGE.read_text("utf-8")
    pages = {
        CONTRIBUTING: with_packages(CONTRIBUTING.read_text("utf-8")),
        VERDICT: with_rows(VERDICT.read_text("utf-8")),
        safety_case.PAGE: safety_case.with_tables(
            safety, requirements, *safety_case.load_results()
        ),
    }
    faults = safety_case.faults(requirements, tests, safety)
    print(*(f"safety case: {fault}\n" for fault in faults), sep="", end="")
    stale = [path for path, text in pages.items() if path.read_text(encoding="utf-8") != text]
    if stale:
        outcome = "out of date; run python3 scripts/build_docs.py" if check else "written again"
        print(f"docs: {', '.join(path.name for path in stale)} {outcome}")
    for path in () if check else stale:
        path.write_text(pages[path], encoding="utf-8")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet"]
    built = subprocess.run(
        command, cwd=WORKSPACE, env=os.environ | {"NO_MKDOCS_2_WARNING": "1"}
    ).returncode
    return built or int(bool(faults or (stale and check)))


if __name__ == "__main__":
    sys.exit(main())
