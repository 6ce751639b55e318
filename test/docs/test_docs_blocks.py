"""Every block of the documentation that takes seconds runs as it is written and prints what is shown.

With ``FSW_ALL_BLOCKS`` in the environment also those that take minutes. The pages are in three
files, which run beside each other: of graphs, of a series of welds, and here the others.
"""

import re
from pathlib import Path

import pytest

from fsw_test_support import doc_blocks

#: whose blocks another test runs, for what they leave
ELSEWHERE = {"install": "test/test_wheels.py"}
PAGES = [path for path in doc_blocks.pages("") if path.stem not in ELSEWHERE]


@pytest.mark.full
@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.stem)
def test_blocks_run_as_written(path, tmp_path):
    doc_blocks.run(path, tmp_path)


def test_each_page_is_of_a_file():
    kinds = {path for kind in ("graph", "series", "") for path in doc_blocks.pages(kind)}
    assert kinds == {
        path
        for path in doc_blocks.pages()
        if any(not block.file for block in doc_blocks.chosen(path))
    }
    assert {*ELSEWHERE} <= {path.stem for path in kinds}
    assert {path.stem for path in doc_blocks.pages()} >= doc_blocks.MINUTES
    assert all((doc_blocks.WORKSPACE / test).is_file() for test in ELSEWHERE.values())


def test_each_block_runs_or_is_checked():
    every = [block for path in doc_blocks.pages() for block in doc_blocks.blocks(path)]
    assert sum(block.mark == "takes minutes" for block in every) <= 1
    others = [block for block in every if block.checked_by]
    assert len(others) <= 9
    assert [block for block in others if not block.checked_by.is_file()] == []


def test_commands_that_this_file_checks_run_elsewhere():
    """On another page, or in ``.ci/run``, with the options that choose the tests."""
    every = [block for path in doc_blocks.pages() for block in doc_blocks.blocks(path)]
    [block] = [block for block in every if block.checked_by == Path(__file__)]
    run = [line for block in every if not block.checked_by for line in block.commands]
    core = (doc_blocks.WORKSPACE / "scripts/_core.py").read_text("utf-8")
    run += [f"python3 {demo}" for demo in re.findall(r'^DEMO = \["(.*)"\]', core, re.MULTILINE)]
    ci = (doc_blocks.WORKSPACE / ".ci/run").read_text("utf-8").splitlines()
    run += [line.partition(" --")[0] for line in ci]
    assert block.commands and {*block.commands} - {*run} == set()


def test_prompts_output_and_marks_are_read(tmp_path):
    path = tmp_path / "page.md"
    path.write_text(
        '```yaml title="a.yaml"\nk: 1\n```\n<!-- takes minutes -->\n<!-- before: true -->\n'
        "```console\n$ cat a.yaml\nk: 1\nerror: no\n```\n<!-- checked by: x -->\n```python\n1\n```\n"
    )
    file, shell, python = doc_blocks.blocks(path)
    assert (file.file, file.code) == ("a.yaml", "k: 1\n")
    assert (shell.code, shell.shown) == ("true\ncat a.yaml", ("k: 1", "error: no"))
    assert shell.fails
    assert shell.mark == "takes minutes" and not shell.checked_by
    assert python.checked_by == doc_blocks.WORKSPACE / "x" and python.line == 12


def test_a_block_that_ends_otherwise_is_reported(tmp_path):
    path = tmp_path / "page.md"
    path.write_text(
        "```console\n$ true\n$ false\n```\n```console\n$ echo no; exit 1\nerror: x\n```\n"
        "```console\n$ echo yes\nno\n```\n"
    )
    with doc_blocks.Page(path, tmp_path) as page:
        assert all(page.run(block) for block in page.blocks)


WAITS = (
    '<!-- stays up, ready: up -->\n```console\n$ python3 -uc "import signal, sys; '
    "signal.signal(2, lambda *_: (open('down', 'w'), sys.exit({code}))); print('up'); signal.pause()\"\n```\n"
)


def test_what_stays_up_ends_with_its_section(tmp_path):
    path = tmp_path / "page.md"
    path.write_text(
        f"# A\n{WAITS.format(code=0)}```console\n$ test ! -e down\n```\n"
        "# B\n```console\n$ test -e down\n```\n"
    )
    with doc_blocks.Page(path, tmp_path) as page:
        assert [page.run(block) for block in page.blocks] == ["", "", ""]


def test_what_does_not_come_up_or_ends_otherwise_is_reported(tmp_path):
    path = tmp_path / "page.md"
    path.write_text(
        f"{WAITS.format(code=3)}<!-- stays up, ready: up -->\n```console\n$ false\n```\n"
    )
    with doc_blocks.Page(path, tmp_path) as page:
        other, none = page.blocks
        assert page.run(other) == "" and page.run(none)
        assert ": 3: up" in page.end()


def test_what_ends_by_itself_before_its_section_is_reported(tmp_path):
    path = tmp_path / "page.md"
    path.write_text(
        "<!-- stays up, ready: up -->\n```console\n$ bash -c 'echo $$ > pid; echo up'\n```\n"
        "```console\n$ while [ -e /proc/$(cat pid)/fd/1 ]; do :; done\n```\n"
    )
    with doc_blocks.Page(path, tmp_path) as page:
        assert [page.run(block) for block in page.blocks] == ["", ""]
        assert "ended by itself: 0" in page.end()


def test_pages_whose_programs_have_fixed_ports_wait_for_each_other(tmp_path, monkeypatch):
    path = tmp_path / "page.md"
    path.write_text(WAITS.format(code=0))
    first, second = (tmp_path / name for name in ("first", "second"))
    first.mkdir(), second.mkdir()
    with doc_blocks.Page(path, first):  # which may have to wait for pages of another clone
        monkeypatch.setattr(doc_blocks, "LONGEST_S", 0.1)
        with pytest.raises(AssertionError, match="ports"):
            doc_blocks.Page(path, second).__enter__()
