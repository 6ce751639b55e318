"""A command of the command line in this process."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pytest

from fsw.main import main
from fsw_test_support.sample_weld import write_sample_weld


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int | str | None, str, str]:
    """Exit code, standard output and standard error of a command."""
    code: int | str | None
    try:
        code = main(list(arguments))
    except SystemExit as end:
        code = end.code
    captured = capsys.readouterr()
    return code, captured.out, captured.err


def replaces_nothing(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, arguments: Sequence[str]
) -> None:
    """A command refuses to replace files without --force; ``{bag}``, ``{file}`` ...

    in its words stand for paths.
    """
    write_sample_weld(tmp_path / "bag", 50)
    files = [
        tmp_path / name
        for name in ("precious", "precious.csv", "precious.png", "precious.md", "overview.png")
    ]
    for file in files:
        file.write_text("x")
    places = {
        "file": files[0],
        "new": tmp_path / "new",
        "bag": tmp_path / "bag",
        "folder": tmp_path,
    }
    code, _, error = run(capsys, *(word.format(**places) for word in arguments))
    assert code == 1
    assert "exists" in error.splitlines()[-1] and "--force" in error.splitlines()[-1]
    assert all(file.read_text() == "x" for file in files)
