"""Fixtures of the recorder's tests."""

from pathlib import Path

import pytest
from fsw_recorder.sample_weld import write_sample_weld

DATA = Path(__file__).parent / "data"
GENUINE = ("mcap_default", "mcap_filezstd", "mcap_split", "mcap_zstd", "sqlite3")


@pytest.fixture(params=GENUINE)
def genuine_bag(request: pytest.FixtureRequest) -> Path:
    """Folder of a bag that genuine ``ros2 bag record`` made."""
    return DATA / request.param


@pytest.fixture(scope="session")
def genuine() -> Path:
    """Folder of all genuine bags."""
    return DATA


@pytest.fixture(scope="session")
def weld_bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Bag of a made-up weld of 300 ticks; not to be changed."""
    folder = tmp_path_factory.mktemp("weld") / "weld"
    write_sample_weld(folder, 300)
    return folder
