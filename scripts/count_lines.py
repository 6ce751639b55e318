#!/usr/bin/env python3
"""Counts the code lines of packages and distributions (no blanks, comments, docstrings).

usage: count_lines.py [REVISION]

Tests are not counted. With a revision: also what they were there, and the difference. At the end
the functions, classes and files that are longer than they should be.
"""

import ast
import io
import re
import subprocess
import sys
import tokenize
from collections import Counter
from collections.abc import Iterator
from functools import cache
from pathlib import Path

WORKSPACE = Path(__file__).resolve().parents[1]
#: distribution by the first folder; scripts and examples belong to none
DISTRIBUTIONS = {
    "src": "core",
    "quality": "quality",
    "lab": "lab",
    "studies": "lab",
    "benchmarks": "lab",
}
LANGUAGES = {".py": "Python", ".c": "C", ".h": "C", ".js": "JavaScript"}
#: most code lines that a distribution should have of a language
BUDGETS = {
    ("core", "Python"): 20_000,
    ("quality", "Python"): 4_000,
    ("lab", "Python"): 9_000,
    ("core", "C"): 3_000,
    ("core", "JavaScript"): 2_000,
}
#: most code lines of a unit of Python, and the least of a module that has no reason to be short
LIMITS = {"function": 60, "class": 250, "file": 400}
SHORT = 60
#: short for a reason: what tools demand by name, thin nodes beside pure cores, a node's
#: parameters, a study's command, scripts
_MAY_BE_SHORT = re.compile(
    r"(^|/)(__init__|setup|parameters|conftest|command)\.py$"
    r"|_(ros|node)\.py$|^(scripts|examples)/"
)
#: and what is loaded by its name, so that a program loads only what it needs: entry points, names
#: of ``import fsw``, controllers as MODULE:CLASS, what ``python -m`` runs
_NAME = re.compile(r'"([\w.]+)(?::\w+)?"')
_RUN_BY_NAME = 'if __name__ == "__main__":'
#: mode of a symbolic link in a tree of git
_LINK = "120000"
_NO_CODE = {
    tokenize.COMMENT,
    tokenize.NL,
    tokenize.NEWLINE,
    tokenize.INDENT,
    tokenize.DEDENT,
    tokenize.ENDMARKER,
}


def code_lines(text: str, language: str = "Python") -> int:
    """Lines of a source text with code on them."""
    if (
        language != "Python"
    ):  # a comment leaves its line breaks; strings that look like one are kept
        pattern = (
            r'("(?:\\.|[^"\\\n])*"|\'(?:\\.|[^\'\\\n])*\'|`(?:\\.|[^`\\])*`)|//[^\n]*|/\*.*?\*/'
        )
        rest = re.sub(
            pattern, lambda match: match[1] or "\n" * match[0].count("\n"), text, flags=re.DOTALL
        )
        return sum(bool(line.strip()) for line in rest.splitlines())
    return len(_python_lines(text))


@cache
def _python_lines(text: str) -> set[int]:
    """Numbers of the lines with code."""
    lines: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in _NO_CODE:
            lines.update(range(token.start[0], token.end[0] + 1))
    for node in ast.walk(ast.parse(text)):
        # a docstring, of a field as well
        match node:
            case ast.Expr(ast.Constant(str())):
                lines.difference_update(range(node.lineno, (node.end_lineno or 0) + 1))
    return lines


def excesses(name: str, text: str) -> Iterator[tuple[int, str]]:
    """Units of a Python source that are over their limit: code lines, and what it is."""
    lines = _python_lines(text)
    if len(lines) > LIMITS["file"]:
        yield len(lines), f"file {name}"
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            unit = "class" if isinstance(node, ast.ClassDef) else "function"
            size = sum(line in lines for line in range(node.lineno, (node.end_lineno or 0) + 1))
            if size > LIMITS[unit]:
                yield size, f"{unit} {node.name} in {name}"


def short_modules() -> list[str]:
    """Modules of fewer than ``SHORT`` lines for which no rule gives a reason."""
    projects = [*WORKSPACE.glob("pyproject.toml"), *WORKSPACE.glob("*/pyproject.toml")]
    modules = {name: text for name, text in sources("") if name.endswith(".py")}
    texts = [*(path.read_text("utf-8") for path in projects), *modules.values()]
    by_name = {name.replace(".", "/") for text in texts for name in _NAME.findall(text)}
    return [
        name
        for name, text in modules.items()
        if not _MAY_BE_SHORT.search(name)
        and _RUN_BY_NAME not in text
        and "/".join(Path(name).with_suffix("").parts[2:]) not in by_name
        and code_lines(text) < SHORT
        and not _is_leaf(text)
    ]


def _is_leaf(text: str) -> bool:
    """Whether a module imports only the standard library.

    Every program can import it before and without the rest.
    """
    imports = [
        node.module or "" if isinstance(node, ast.ImportFrom) else node.names[0].name
        for node in ast.parse(text).body
        if isinstance(node, ast.Import | ast.ImportFrom)
    ]
    return all(name.partition(".")[0] in sys.stdlib_module_names for name in imports)


def too_long() -> list[tuple[int, str]]:
    """All units of the working tree that are over their limit, the longest first."""
    every = (excesses(*source) for source in sources("") if source[0].endswith(".py"))
    return sorted((excess for some in every for excess in some), reverse=True)


def _git(*words: str, **options: bytes) -> bytes:
    return subprocess.run(
        ["git", *words], cwd=WORKSPACE, stdout=subprocess.PIPE, check=True, **options
    ).stdout


def sources(revision: str) -> Iterator[tuple[str, str]]:
    """Path and text of each source file at a revision, else of the working tree.

    Git reports its errors itself.
    """
    if not revision:
        for name in sorted(
            set(_git("ls-files", "-z", "-co", "--exclude-standard").decode().split("\0"))
        ):
            path = WORKSPACE / name
            if _counted(name) and path.is_file() and not path.is_symlink():
                yield name, path.read_text(encoding="utf-8")
        return
    entries = _git("ls-tree", "-r", "-z", revision).decode().split("\0")
    files = (entry.partition("\t")[2] for entry in entries if not entry.startswith(_LINK))
    names = [name for name in files if _counted(name)]
    answer = io.BytesIO(
        _git("cat-file", "--batch", input="".join(f"{revision}:{n}\n" for n in names).encode())
    )
    for name in names:
        size = int(answer.readline().split()[2])
        yield name, answer.read(size + 1).decode()


def _counted(name: str) -> bool:
    path = Path(name)
    return (
        path.suffix in LANGUAGES
        and "test" not in path.parts[:-1]
        and path.name != "eslint.config.js"
    )


def _package(name: str) -> str:
    parts = Path(name).parts
    return "/".join(parts[: 3 if parts[1:2] == ("studies",) else 2 if len(parts) > 2 else 1])


def count(revision: str) -> Counter[tuple[str, str]]:
    """Code lines by package and language."""
    counts: Counter[tuple[str, str]] = Counter()
    for name, text in sources(revision):
        language = LANGUAGES[Path(name).suffix]
        counts[_package(name), language] += code_lines(text, language)
    return counts


def totals(lines: Counter[tuple[str, str]]) -> Counter[tuple[str, str]]:
    """Code lines by distribution and language."""
    counts: Counter[tuple[str, str]] = Counter()
    for (package, language), number in lines.items():
        counts[DISTRIBUTIONS.get(package.partition("/")[0], "other"), language] += number
    return counts


def _print(
    now: Counter[tuple[str, str]], before: Counter[tuple[str, str]] | None, last: str
) -> None:
    for key in sorted({*now, *(before or ())}):
        then = f"{before[key]:>8} {now[key] - before[key]:>+7}" if before is not None else ""
        budget = f"{BUDGETS[key]:>8}" if last and key in BUDGETS else ""
        print(f"{' '.join(key):<40}{now[key]:>7}{then}{budget}")


def main() -> int:
    """Print a table of the packages, and one of the distributions with their budgets."""
    if sys.argv[1:2] in (["-h"], ["--help"]):
        print(__doc__)
        return 0
    try:
        now, before = count(""), count(sys.argv[1]) if sys.argv[1:] else None
    except subprocess.CalledProcessError:
        return 2
    _print(now, before, "")
    print(
        "\ndistribution, language, code lines"
        + (", before, difference" if before else "")
        + ", budget"
    )
    _print(totals(now), None if before is None else totals(before), "budget")
    print(f"\nmodules under {SHORT} lines: {len(short_modules())}; over their limits:")
    for size, unit in too_long():
        print(f"{size:>6} {unit}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
