"""Which welds may be added to a heat profile: each refusal, and one that is none."""

import hashlib
import json
from pathlib import Path
from types import SimpleNamespace

import pytest
import yaml

from fsw_control.schema.models import InputError
from fsw_lab.heat_update import (
    RECORD,
    TYPE,
    Refusal,
    RefusedWeldError,
    check_heat,
    check_record,
    check_type,
    earlier_bags,
)
from fsw_model import nominal
from fsw_model.heat_profile import HeatProfile, HeatSource, ThermalModel

WAY = {"name": "way", "phases": [{"name": "start", "to_deg": 2.0, "length_mm": 20.0}]}


def profile(*welds, lacks=None, rise_kw=1.0, **source):
    """A profile of welds, names with what their bags hold; ``lacks``: the last one's."""
    sources = [HeatSource(weld=name, sha256=digest(data), **source) for name, data in welds]
    sources[-1] = sources[-1].changed(left_out_kw=lacks)
    return HeatProfile(
        type="lid",
        model=ThermalModel.of(nominal()),
        welds=tuple(sources),
        travel_mm=(0.0, 10.0),
        heat_kw=(0.0, rise_kw),
        deviation_kw=(0.2, 0.2),
    )


def digest(data):
    return hashlib.sha256(data).hexdigest()


def bag(folder, name="C002", data=b"two", verdict="accept", judged=None):
    made = folder / name
    (made / RECORD).parent.mkdir(parents=True)
    (made / "data.mcap").write_bytes(data)
    record = {"verdict": verdict, "files": [{"sha256": digest(judged or data)}]}
    (made / RECORD).write_text(json.dumps(record))
    return made


def refusal_of(check, *arguments):
    with pytest.raises(RefusedWeldError) as refused:
        check(*arguments)
    return refused.value.refusal


def test_an_accepted_weld_may_be_added(tmp_path):
    check_record(bag(tmp_path), profile(("C001", b"one")))


@pytest.mark.parametrize(
    ("weld", "expected"),
    [
        ({"data": b"one"}, Refusal.KNOWN),
        ({"verdict": "review"}, Refusal.NOT_ACCEPTED),
        ({"verdict": "reject"}, Refusal.NOT_ACCEPTED),
        ({"judged": b"another weld"}, Refusal.OTHER_RECORD),
    ],
)
def test_other_records_are_refused(tmp_path, weld, expected):
    assert refusal_of(check_record, bag(tmp_path, **weld), profile(("C001", b"one"))) is expected


@pytest.mark.parametrize("text", [None, "{}", "[]", '{"verdict": "accept"}'])
def test_without_a_record_it_is_refused(tmp_path, text):
    made = bag(tmp_path)
    (made / RECORD).unlink()
    if text is not None:
        (made / RECORD).write_text(text)
    assert refusal_of(check_record, made, profile(("C001", b"one"))) is Refusal.NO_RECORD


def weld(way=WAY, **identity):
    """What is compared of a weld."""
    custom = dict.fromkeys(TYPE, "A") | {"canister": "C1", "lid": "L1"} | identity
    text = yaml.safe_dump(way).encode() if way else b""
    return SimpleNamespace(path=Path("C002"), custom=custom, attachments={"scenario.yaml": text})


def test_a_weld_of_the_type_may_have_another_dwell():
    dwell = {"name": "dwell", "duration_s": 5.0}
    check_type(weld(WAY | {"phases": [dwell, *WAY["phases"]]}), [weld()])


def test_every_weld_of_a_type_has_a_canister_and_a_lid_of_its_own():
    check_type(weld(canister="C2", lid="L2"), [weld()])


@pytest.mark.parametrize("key", TYPE)
def test_another_kind_of_canister_or_lid_tool_or_machine_is_refused(key):
    assert refusal_of(check_type, weld(**{key: "B"}), [weld(), weld()]) is Refusal.IDENTITY


@pytest.mark.parametrize(
    "way",
    [
        None,
        WAY | {"phases": [WAY["phases"][0] | {"length_mm": 21.0}]},
        WAY | {"phases": [WAY["phases"][0] | {"to_deg": 1.0}]},
    ],
)
def test_another_path_is_refused(way):
    assert refusal_of(check_type, weld(way), [weld()]) is Refusal.PATH


def test_a_weld_whose_heat_is_far_from_the_others_is_refused():
    before = profile(("C001", b"one"))
    check_heat(before, profile(("C001", b"one"), ("C002", b"two"), lacks=0.39))
    after = profile(("C001", b"one"), ("C002", b"two"), lacks=0.41)
    assert refusal_of(check_heat, before, after) is Refusal.HEAT


def test_computed_profile_is_replaced_by_the_first_weld(tmp_path):
    """Which is of another type if its heat rises by far more than 0.4 kW on both sides allow."""
    computed = profile(("drawn", b"drawn"), computed=True)
    assert not earlier_bags(computed, tmp_path, 7)
    check_heat(computed, profile(("C001", b"one"), rise_kw=1.7))
    other = profile(("C001", b"one"), rise_kw=1.9)
    assert refusal_of(check_heat, computed, other) is Refusal.HEAT


def test_the_last_welds_bags_are_needed_unchanged(tmp_path):
    known = profile(("C001", b"one"), ("C002", b"two"), ("C003", b"three"))
    bag(tmp_path, "C002", b"two")
    made = bag(tmp_path, "C003", b"three")
    assert [path.name for path in earlier_bags(known, tmp_path, 2).values()] == ["C002", "C003"]
    with pytest.raises(InputError, match="C001"):
        earlier_bags(known, tmp_path, 3)
    (made / "data.mcap").write_bytes(b"changed")
    with pytest.raises(InputError, match="C003"):
        earlier_bags(known, tmp_path, 2)
