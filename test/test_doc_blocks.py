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
        if not block.mark or (every and not block.not_run)
    ]


PAGES = [path for path in doc_blocks.pages() if any(not block.file for block in chosen(path))]


@pytest.mark.slow
@pytest.mark.full
@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.stem)
def test_blocks_run_as_written(path, tmp_path):
    page = doc_blocks.Page(path, tmp_path)
    for block in chosen(path):
        assert page.run(block) == "", block


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
    page = doc_blocks.Page(path, tmp_path)
    assert all(page.run(block) for block in page.blocks)
