"""Pages on recorded welds share a short series of them, which the first one welds."""

import pytest

from fsw_test_support import doc_blocks


@pytest.mark.full
@pytest.mark.parametrize("path", doc_blocks.pages("series"), ids=lambda path: path.stem)
def test_blocks_run_as_written(path, tmp_path):
    doc_blocks.run(path, tmp_path)
