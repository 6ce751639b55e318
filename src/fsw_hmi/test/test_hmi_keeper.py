"""What survives a restart of the page's server."""

import json
import math

import pytest

from fsw_control.coded import Fact
from fsw_hmi.alarms import Alarm, AlarmList
from fsw_hmi.answers import Ended, Loss
from fsw_hmi.frames import COLUMNS, row
from fsw_hmi.keeper import Keeper, Kept

ROWS = [
    row(stamp_ns, [1.5] * (len(COLUMNS) - 2) + [math.nan]) for stamp_ns in (10**18, 10**18 + 10**8)
]
ENDED = Ended("anna", Fact.of(Loss.NOT_CONNECTED, limit_s=10.0))
ACTION = {"server_s": 1.0, "who": "anna", "action": "mode hold", "outcome": "done", "message": ""}


def kept(wall_s=1000.0):
    alarms = AlarmList(lambda count: Alarm("", "", "", "low"))
    alarms.update({name: Alarm(name, "", "", "medium") for name in "abc"}, 5.0)
    alarms.acknowledge(["a"], "anna")
    alarms.shelve("b", 10.0, "anna", "known", 5.0)
    return Kept(5.0, wall_s, alarms.entries, [ACTION], "anna (3f2a)", ENDED.fields)


@pytest.fixture
def told():
    return []


@pytest.fixture
def folder(tmp_path):
    """What a server has left that was killed."""
    keeper = Keeper(tmp_path / "new" / "weld", pytest.fail)
    assert keeper.load(1000.0) == (None, [])
    for one in ROWS:
        keeper.add(one)
    keeper.keep(kept())
    return tmp_path / "new" / "weld"


def test_state_and_rows_are_found_again_and_go_on(folder):
    for _ in range(3):
        keeper = Keeper(folder, pytest.fail)
        state, rows = keeper.load(1100.0)
        assert (state, rows) == (kept(), ROWS)
        keeper.keep(state)


def test_rows_of_a_weld_before_are_forgotten(folder):
    keeper = Keeper(folder, pytest.fail)
    keeper.load(1000.0)
    keeper.forget()
    keeper.add(ROWS[1])
    keeper.keep(kept())
    assert Keeper(folder, pytest.fail).load(1000.0)[1] == [ROWS[1]]


@pytest.mark.parametrize("wall_s", [999.0, 1601.0])
def test_state_of_another_weld_is_not_used(folder, wall_s, told):
    keeper = Keeper(folder, told.append)
    assert keeper.load(wall_s) == (None, [])
    assert ["another weld" in one for one in told] == [True]


@pytest.mark.parametrize(
    "text", ["", "{", "[]", "{}", '{"now_s": 1, "wall_s": 1000, "alarms": {"a": 3}}', "\udcff"]
)
def test_damaged_state_is_not_used(folder, text, told):
    (folder / "hmi_state.json").write_bytes(text.encode("utf-8", "surrogateescape"))
    keeper = Keeper(folder, told.append)
    assert keeper.load(1000.0) == (None, [])
    assert ["damaged" in one for one in told] == [True]
    keeper.keep(kept())
    assert Keeper(folder, pytest.fail).load(1000.0)[0] == kept()


def test_damaged_rows_are_left_out(folder, told):
    with (folder / "hmi_rows.jsonl").open("ab") as file:
        for damaged in (
            ["x"] * len(COLUMNS),
            [float("nan")] * len(COLUMNS),
        ):  # which no page can read
            file.write(json.dumps(damaged).encode() + b"\n")
        file.write(b'[1.0]\n\xff\xfe\n{"a": 1}\n[1.0,2')
    assert Keeper(folder, told.append).load(1000.0)[1] == ROWS
    assert ["6 damaged lines" in one for one in told] == [True]


def test_folder_that_cannot_be_written_is_told_and_harms_nothing(tmp_path, told):
    (tmp_path / "file").touch()
    keeper = Keeper(tmp_path / "file", told.append)
    assert keeper.load(1000.0) == (None, [])
    keeper.add(ROWS[0])
    keeper.forget()
    keeper.keep(kept())
    assert ["nothing survives" in one for one in told] == [True]


def test_disk_that_fills_up_is_told_once_and_harms_nothing(tmp_path, told):
    (tmp_path / "hmi_rows.jsonl").symlink_to("/dev/full")
    keeper = Keeper(tmp_path, told.append)
    keeper.load(1000.0)
    for _ in range(2):
        keeper.add(ROWS[0])
        keeper.keep(kept())
    assert ["No space left" in one for one in told] == [True]


def test_nothing_is_kept_without_a_folder():
    keeper = Keeper(None, pytest.fail)
    assert keeper.load(1000.0) == (None, [])
    keeper.add(ROWS[0])
    keeper.keep(kept())


def test_restored_alarms_wait_for_the_graph_before_they_are_gone():
    alarms = AlarmList(lambda count: Alarm("", "", "", "low"))
    alarms.restore(kept().alarms, 100.0, 105.0)
    assert {name: one.state for name, one in alarms.entries.items()} == {
        **{"a": "acknowledged", "b": "shelved", "c": "active"}
    }
    alarms.update({}, 106.0)
    alarms.update({"c": Alarm("c", "", "", "medium")}, 110.0)
    assert alarms.events == []
    alarms.update({"c": Alarm("c", "", "", "medium")}, 111.0)
    assert [(one.id, one.kind.word) for one in alarms.events] == [
        ("a", "cleared"),
        ("b", "cleared"),
    ]
    assert alarms.entries["b"].shelved_until_s == 705.0
