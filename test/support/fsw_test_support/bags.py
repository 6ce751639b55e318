"""Bags that genuine ROS 2 recorded and the bag of a made-up weld, as fixtures.

Decoded messages.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from fsw_recorder.bag_reader import BagReader, BagRecord
from fsw_recorder.definitions import Definitions, definition_of
from fsw_test_support.sample_weld import write_sample_weld

#: bags of genuine ``ros2 bag record``
GENUINE = Path(__file__).resolve().parents[3] / "src" / "fsw_recorder" / "test" / "data"
NAMES = ("mcap_default", "mcap_filezstd", "mcap_split", "mcap_zstd", "sqlite3")


@pytest.fixture(params=NAMES)
def genuine_bag(request: pytest.FixtureRequest) -> Path:
    """Folder of a bag that genuine ``ros2 bag record`` made."""
    return GENUINE / str(request.param)


@pytest.fixture(scope="session")
def genuine() -> Path:
    """Folder of all genuine bags."""
    return GENUINE


@pytest.fixture(scope="session")
def weld_bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Bag of a made-up weld of 300 ticks; not to be changed."""
    folder = tmp_path_factory.mktemp("weld") / "weld"
    write_sample_weld(folder, 300)
    return folder


def decoder(reader: BagReader) -> Callable[[BagRecord], Any]:
    """Makes messages of a bag's records, by its definitions or the installed ones.

    A `BagError` when one is damaged.
    """
    topics, definitions = reader.topics(), Definitions()

    def message(record: BagRecord) -> Any:
        return definitions.decode(
            record.type_name, definition_of(topics[record.topic]), record.data
        )

    return message


def decode(reader: BagReader, record: BagRecord) -> Any:
    """The message of one record."""
    return decoder(reader)(record)
