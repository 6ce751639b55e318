"""Recorded welds stay what they were.

Their figures of merit, and the proposals of the controllers that run on them.

When a change of plant or controllers is meant, record the bags again with
``scripts/record_golden_bags.py``.
"""

import json
import math
from pathlib import Path
from typing import Any

import pytest

from fsw_analysis import kpi
from fsw_analysis.changes import cut_to_scenario
from fsw_analysis.messages import WeldMessages
from fsw_analysis.signals import load_weld
from fsw_lab.replay import Comparison, Replay, replay
from fsw_recorder.bag_reader import BagReader
from fsw_recorder.definitions import interface_hash
from fsw_scenario.controllers import kind_of

GOLDEN = Path(__file__).parent / "golden"
BAGS = sorted(folder.name for folder in GOLDEN.iterdir() if folder.is_dir())
CLOSED_LOOP = [name for name in BAGS if not name.startswith("open_loop")]
CONTROLLERS = [
    (name, controller)
    for name in CLOSED_LOOP
    for controller in ("decentral", "nmpc")
    if controller == "decentral" or not name.endswith("_decentral")
]
#: equal bit by bit on the machine of the recording; elsewhere the last digits of exp() and the
#: like may differ, and another compiler may order the sums of the kernel differently
TOLERANCE_KN_RPM = {"decentral": 1e-9, "nmpc": 1e-6}


def numbers(value: Any, path: str = "") -> dict[str, float]:
    """All numbers in nested JSON by their path; NaN where there is none."""
    if isinstance(value, dict):
        return {
            key: number
            for name, part in value.items()
            for key, number in numbers(part, f"{path}/{name}").items()
        }
    if isinstance(value, list):
        return {
            key: number
            for index, part in enumerate(value)
            for key, number in numbers(part, f"{path}/{index}").items()
        }
    if value is None:
        return {path: math.nan}
    return {path: value} if isinstance(value, int | float) else {}


def test_every_paper_scenario_has_one() -> None:
    assert len(BAGS) == 6 and len(CLOSED_LOOP) == 4
    recorded = [
        (name, controller)
        for name in CLOSED_LOOP
        for controller in WeldMessages(GOLDEN / name).controllers("proposal")
    ]
    assert sorted(recorded) == CONTROLLERS
    for name in BAGS:
        assert sum(file.stat().st_size for file in (GOLDEN / name).iterdir()) < 1_100_000


def test_replayed_bag_has_the_messages_of_today() -> None:
    """The documentation replays it to nodes; those of another version it does not play."""
    with BagReader(GOLDEN / "reference_tracking") as reader:
        for topic in reader.topics().values():
            assert interface_hash(topic.type_name) == topic.type_hash, topic.name


@pytest.mark.parametrize("name", BAGS)
def test_figures_of_merit(name: str) -> None:
    signals = load_weld(GOLDEN / name)
    assert signals.problems == []
    expected = numbers(json.loads((GOLDEN / name / "kpi.json").read_text(encoding="utf-8")))
    values = numbers(json.loads(json.dumps(kpi.compute(cut_to_scenario(signals), name))))
    assert values == pytest.approx(expected, rel=1e-9, abs=1e-12, nan_ok=True)
    assert len(values) > 10


def largest(result: Comparison) -> float:
    """Largest difference of any manipulated variable; infinite when the health differs."""
    return max(
        [
            max(abs(difference.force_kn), abs(difference.speed_rpm))
            if not difference.text
            else float("inf")
            for difference in result.differences
        ],
        default=0.0,
    )


def replayed(name: str, controller: str, **changed: Any) -> Replay:
    made = kind_of(controller)
    return replay(WeldMessages(GOLDEN / name), controller, made, made.parameters, changed)


@pytest.mark.parametrize(("name", "controller"), CONTROLLERS)
def test_controllers_propose_what_they_proposed(name: str, controller: str) -> None:
    again = replayed(name, controller)
    result = again.against_own(controller)
    assert again.notes == [] and result.ticks >= 2400
    assert largest(result) <= TOLERANCE_KN_RPM[controller], "\n".join(result.lines())


def test_other_tuning_is_distinguished() -> None:
    result = replayed("reference_tracking_decentral", "decentral", tuning="tight").against_own(
        "decentral"
    )
    assert largest(result) > 0.1 and not result.identical
