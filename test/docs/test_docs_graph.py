"""Pages whose nodes stay up while their next blocks run.

Their ports are fixed, so they take turns.
"""

import pytest

from fsw_test_support import doc_blocks


@pytest.mark.full
@pytest.mark.parametrize("path", doc_blocks.pages("graph"), ids=lambda path: path.stem)
def test_blocks_run_as_written(path, tmp_path):
    doc_blocks.run(path, tmp_path)
