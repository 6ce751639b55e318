"""Tests compare codes, names and figures, not wording.

Sentences in asserts and ``match=`` may only become fewer.
"""

from __future__ import annotations

import ast
import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

WORKSPACE = Path(__file__).resolve().parent.parent
#: from so many words on a text counts as a sentence
_WORDS = 4
_WORD = re.compile(r"[^\W\d_]+(?:['’-][^\W\d_]+)*")
#: sentences in the tests of a package, at most; no other package has any. Lower a number where a
#: test needs fewer, never raise one: compare a code or a field, or the facts in a text.
MOST = {
    "src/fsw_analysis": 2,
    "src/fsw_control": 3,
    "src/fsw_hmi": 5,
    "src/fsw_supervisor": 1,
    "test": 2,
}


def literals(node: ast.AST) -> Iterator[str]:
    """Texts in an expression; of a formatted one what is fixed in it."""
    if isinstance(node, ast.JoinedStr):
        yield "".join(
            str(part.value) if isinstance(part, ast.Constant) else "{}" for part in node.values
        )
    elif isinstance(node, ast.Constant):
        yield from [node.value] if isinstance(node.value, str) else []
    else:
        for child in ast.iter_child_nodes(node):
            yield from literals(child)


def is_sentence(text: str) -> bool:
    words = [part.strip(".,;:!?()[]'\"\\^$*") for part in text.split()]
    return sum(_WORD.fullmatch(word) is not None for word in words) >= _WORDS


def sentences(source: str) -> list[str]:
    """Texts of so many words with which a test's asserts, and its ``match=``, compare."""
    compared: list[ast.AST] = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Assert):
            compared.append(node.test)
        elif isinstance(node, ast.Call):
            compared += [keyword.value for keyword in node.keywords if keyword.arg == "match"]
    return [text for node in compared for text in literals(node) if is_sentence(text)]


def package_of(file: Path) -> str:
    """Folder of the package or the study of a test, ``test`` of those of several packages."""
    parts = file.relative_to(WORKSPACE).parts
    above = parts[: parts.index("test")]
    return "/".join(above) if above else "test"


def test_no_package_compares_more_sentences_than_before() -> None:
    files = [
        file
        for folder in ("src", "quality", "lab", "test")
        for file in (WORKSPACE / folder).rglob("test_*.py")
        if "test" in file.relative_to(WORKSPACE).parts
    ]
    assert len(files) > 100
    counts: Counter[str] = Counter()
    for file in files:
        counts[package_of(file)] += len(sentences(file.read_text(encoding="utf-8")))
    more = {name: count for name, count in counts.items() if count > MOST.get(name, 0)}
    assert more == {}


def test_sentences_are_counted_and_facts_are_not() -> None:
    source = (
        "assert text == 'no valid depth any more'\n"
        "assert f'{name} has ended too early' in text, 'this is what the reader sees'\n"
        "raises(ValueError, match=r'must be less than (.*)')\n"
        "assert 'force_kn = 120' in text and '0 to 95 kN' in text\n"
        "assert text.startswith('limits: ') and 'start.depth_mm' in text\n"
        "run('these four are no comparison')\n"
    )
    assert len(sentences(source)) == 3
