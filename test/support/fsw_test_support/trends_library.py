"""uPlot for tests that look at trends; without npm or its registry they are skipped."""

from __future__ import annotations

from pathlib import Path

import npm_packages
import pytest


@pytest.fixture(scope="session")
def uplot() -> Path:
    """The folder of uPlot's files."""
    if npm_packages.main():
        pytest.skip("uPlot cannot be had")
    return npm_packages.UPLOT
