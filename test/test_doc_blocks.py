"""Every block of the documentation that takes seconds runs as it is written."""

import pytest

from fsw_test_support import doc_blocks


def quick(path):
    return [block for block in doc_blocks.blocks(path) if not block.mark]


PAGES = [path for path in doc_blocks.pages() if any(not block.file for block in quick(path))]


@pytest.mark.slow
@pytest.mark.full
@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.stem)
def test_blocks_run_as_written(path, tmp_path):
    page = doc_blocks.Page(path, tmp_path)
    for block in quick(path):
        assert page.run(block) == "", block


def test_prompts_output_and_marks_are_read(tmp_path):
    path = tmp_path / "page.md"
    path.write_text(
        '```yaml title="a.yaml"\nk: 1\n```\n<!-- takes minutes -->\n<!-- before: true -->\n'
        "```console\n$ cat a.yaml\nk: 1\nerror: no\n```\n<!-- not run: x -->\n```python\n1\n```\n"
    )
    file, shell, python = doc_blocks.blocks(path)
    assert (file.file, file.code) == ("a.yaml", "k: 1\n")
    assert (shell.code, shell.shown_error) == ("true\ncat a.yaml", "error: no")
    assert shell.mark == "takes minutes" and not shell.not_run
    assert python.not_run and python.line == 12


def test_a_block_that_ends_otherwise_is_reported(tmp_path):
    path = tmp_path / "page.md"
    path.write_text(
        "```console\n$ true\n$ false\n```\n```console\n$ echo no; exit 1\nerror: x\n```\n"
    )
    page = doc_blocks.Page(path, tmp_path)
    assert all(page.run(block) for block in page.blocks)
