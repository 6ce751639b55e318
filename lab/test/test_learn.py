"""``fsw.py learn``: from bags to a profile that a later weld takes.

One line for bad input, nothing overwritten.
"""

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest
import yaml

import fsw
from fsw.bags import data_sha256
from fsw.main import main
from fsw_lab.heat_update import RECORD
from fsw_model import ModelParameters
from fsw_model.heat_profile import HeatProfile, ThermalModel
from fsw_nmpc import NmpcController
from fsw_scenario.closed_loop import ClosedLoop
from fsw_scenario.scenario_file import parse
from weld_series import bag

GOLDEN = Path(__file__).resolve().parents[2] / "test" / "golden"
WAY = {
    "name": "way",
    "controller": "nmpc",
    "phases": [
        {"name": "dwell", "duration_s": 20.0},
        {"name": "start", "to_deg": 10.0, "length_mm": 150.0},
    ],
}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def weld_to_bag(folder, seed, events=()):
    content = WAY | {"plant": {"seed": seed}, "events": list(events)}
    scenario = parse(yaml.safe_dump(content), "way")
    signals = ClosedLoop(scenario, {"nmpc": NmpcController()}).run()
    bag.write(folder / f"C{seed}", scenario, signals, {"machine": "emulator"}, {"nmpc": {}}, {})
    return folder / f"C{seed}"


@pytest.mark.slow
def test_later_weld_uses_the_learnt_heat(folder, capsys):
    bags = [weld_to_bag(folder, seed) for seed in (1, 2)]
    assert main(["learn", *map(str, bags), "--type", "way"]) == 0
    profile = HeatProfile.from_file(folder / "way.heat.yaml")
    assert [source.weld for source in profile.welds] == ["C1", "C2"]
    assert [source.sha256 for source in profile.welds] == [data_sha256(bag) for bag in bags]
    model = ModelParameters.from_file(folder / "way.model.yaml")
    assert ThermalModel.of(model) == profile.model
    (folder / "way.yaml").write_text(yaml.safe_dump(WAY), encoding="utf-8")
    weld = fsw.simulate(
        "way.yaml",
        controller="nmpc",
        parameters={"model_file": "way.model.yaml"},
        heat="way.heat.yaml",
    )
    share = weld.signals.statuses["nmpc"].disturbances["known_heat_share"]
    assert np.isfinite(share).all()
    capsys.readouterr()
    assert main(["learn", str(bags[0]), "--type", "way"]) == 1
    assert "way.heat.yaml" in capsys.readouterr().err


def accept(bag):
    """Put the record of an accepted weld into a bag."""
    (bag / RECORD).parent.mkdir()
    record = {"verdict": "accept", "files": [{"sha256": data_sha256(bag)}]}
    (bag / RECORD).write_text(json.dumps(record), encoding="utf-8")


@pytest.mark.slow
def test_accepted_weld_is_added_unless_its_heat_differs(folder, capsys):
    first, second, third = (weld_to_bag(folder, seed) for seed in (1, 2, 3))
    assert main(["learn", str(first), str(second), "--type", "way"]) == 0
    accept(third)
    assert main(["learn", "--update", "way.heat.yaml", str(third)]) == 0
    updated = (folder / "way.heat.yaml").read_text(encoding="utf-8")
    profile = HeatProfile.from_file(folder / "way.heat.yaml")
    assert [source.weld for source in profile.welds] == ["C1", "C2", "C3"]
    assert ThermalModel.of(ModelParameters.from_file(folder / "way.model.yaml")) == profile.model
    assert profile.welds[-1].left_out_kw is not None
    events = [
        {
            "at_s": 40.0 + 20.0 * k,
            "disturbance": {
                "channel": "temperature",
                "shape": "pulse",
                "amplitude_c": 6.0,
                "duration_s": 8.0,
            },
        }
        for k in range(4)
    ]
    strange = weld_to_bag(folder, 4, events)
    accept(strange)
    capsys.readouterr()
    assert main(["learn", "--update", "way.heat.yaml", str(strange)]) == 1
    assert (folder / "way.heat.yaml").read_text(encoding="utf-8") == updated


@pytest.mark.slow
def test_computed_profile_is_used_until_the_first_weld(folder):
    drawn, first = (weld_to_bag(folder, seed) for seed in (1, 2))
    assert main(["learn", str(drawn), "--type", "way", "--computed"]) == 0
    before = HeatProfile.from_file(folder / "way.heat.yaml")
    accept(first)
    assert main(["learn", "--update", "way.heat.yaml", str(first)]) == 0
    after = HeatProfile.from_file(folder / "way.heat.yaml")
    sources = [
        (source.weld, source.computed) for profile in (before, after) for source in profile.welds
    ]
    assert sources == [("C1", True), ("C2", False)]
    assert max(after.deviation_kw) < min(before.deviation_kw)
    assert after.model == before.model


def test_weld_without_a_path_cannot_be_learnt(folder, capsys):
    assert main(["learn", str(GOLDEN / "reference_tracking"), "--type", "way"]) == 1
    assert "path" in capsys.readouterr().err
    assert not list(folder.iterdir())


def test_digest_is_of_the_data_alone(folder):
    (folder / "a.mcap").write_bytes(b"data")
    (folder / "record.json").write_bytes(b"later")
    assert (
        data_sha256(folder)
        == hashlib.sha256(b"data").hexdigest()
        == data_sha256(folder / "a.mcap")
    )
