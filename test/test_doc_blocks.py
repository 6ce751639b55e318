"""Every block of the documentation that takes seconds runs as it is written and prints what is shown.

With ``FSW_ALL_BLOCKS`` in the environment also those that take minutes.
"""

import os

import pytest

from fsw_test_support import doc_blocks


def chosen(path):
    every = "FSW_ALL_BLOCKS" in os.environ
    return [
        block
        for block in doc_blocks.blocks(path)
        if not block.mark or block.ready or (every and not block.not_run)
    ]


PAGES = [path for path in doc_blocks.pages() if any(not block.file for block in chosen(path))]


@pytest.mark.slow
@pytest.mark.full
@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.stem)
def test_blocks_run_as_written(path, tmp_path):
    with doc_blocks.Page(path, tmp_path) as page:
        for block in chosen(path):
            assert page.run(block) == "", block
        assert page.end() == ""


def test_few_blocks_do_not_run():
    marks = [block.mark for path in doc_blocks.pages() for block in doc_blocks.blocks(path)]
    assert sum(mark.startswith("not run") for mark in marks) <= 6
    assert marks.count("takes minutes") <= 4


def test_prompts_output_and_marks_are_read(tmp_path):
    path = tmp_path / "page.md"
    path.write_text(
        '```yaml title="a.yaml"\nk: 1\n```\n<!-- takes minutes -->\n<!-- before: true -->\n'
        "```console\n$ cat a.yaml\nk: 1\nerror: no\n```\n<!-- not run: x -->\n```python\n1\n```\n"
    )
    file, shell, python = doc_blocks.blocks(path)
    assert (file.file, file.code) == ("a.yaml", "k: 1\n")
    assert (shell.code, shell.shown) == ("true\ncat a.yaml", ("k: 1", "error: no"))
    assert shell.fails
    assert shell.mark == "takes minutes" and not shell.not_run
    assert python.not_run and python.line == 12


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
