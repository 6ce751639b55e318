"""A small campaign, its welds and its folder."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest
import yaml

from fsw_campaign import definition
from fsw_campaign.definition import Campaign
from fsw_campaign.welds import Row, run_batch

SMALL: dict[str, Any] = {
    "name": "small",
    "scenario": "quick",
    "controllers": [
        "decentral:tight",
        {"controller": "decentral", "parameters": {"depth_gain": 9.0}, "label": "mine"},
    ],
    "welds": 4,
    "seed": 3,
    "distributions": {
        "plant.factors.copper_lag_s": {"uniform": [0.8, 1.2]},
        "plant.sensors.depth_noise_mm": {"loguniform": [1e-7, 1e-3]},
        "events[2].disturbance.amplitude_mm": {
            "normal": {"mean": 0.05, "deviation": 0.1, "low": -0.1, "high": 0.2}
        },
        "plant.noise": {"choice": [True, False]},
    },
    "limits": {
        "depth_error_mm": {"min": -0.09, "max": 0.09, "at_most_s": 1.0},
        "temperature_c": {"max": 910.0},
    },
}


def campaign(tmp_path: Path, **changes: Any) -> Campaign:
    """The small campaign with changes, read from a file."""
    file = tmp_path / "campaign.yaml"
    file.write_text(yaml.safe_dump(SMALL | changes, sort_keys=False))
    return definition.load(file)


def rows_of(made: Campaign, indices: Iterable[int] | None = None) -> list[Row]:
    """Rows of the welds of a campaign, of all by default."""
    labels = [entrant.label for entrant in made.entrants]
    indices = range(made.welds) if indices is None else indices
    return run_batch(made.text, [(i, made.parameters(i), labels) for i in indices])


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> tuple[Campaign, list[Row]]:
    """The small campaign and the rows of its welds."""
    made = campaign(tmp_path_factory.mktemp("small"))
    return made, rows_of(made)


@pytest.fixture(scope="module")
def folder(small: tuple[Campaign, list[Row]], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the small campaign; all its third weld's rows say that it diverged."""
    from fsw_campaign.dataset import Dataset  # needs pyarrow, without which the tests are skipped

    made, rows = small
    path = tmp_path_factory.mktemp("results") / "data"
    with Dataset(path, made) as written:
        written.write(
            [
                row | {"status": "diverged", "reason": "lost"} if row["index"] == 2 else row
                for row in rows
            ]
        )
    return path
