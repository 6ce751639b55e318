"""uPlot for tests that look at trends; without npm or its registry they are skipped."""

from __future__ import annotations

from pathlib import Path

import pytest

from fsw_hmi import npm, page_files


@pytest.fixture(scope="session")
def uplot() -> Path:
    """The folder of uPlot's files."""
    try:
        return page_files.install()
    except npm.NpmError as error:
        pytest.skip(f"uPlot: {error}")
