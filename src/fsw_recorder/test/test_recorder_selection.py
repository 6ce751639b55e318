"""Topic selection, QoS rules, sequence gaps, attachments."""

from datetime import datetime
from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from fsw_recorder import BagError
from fsw_recorder.bag_metadata import OfferedQos, parse_qos, qos_text
from fsw_recorder.recording import custom_entries, free_sibling, media_type, output_folder, read_attachment, versions
from fsw_recorder.repeats import Repeats
from fsw_recorder.sequence_gaps import SequenceGaps
from fsw_recorder.topic_selection import TopicSelection, hears, replayed_qos, requested_qos, strongest_first

BEST_EFFORT = OfferedQos(reliability="best_effort", depth=5)
LATCHED = OfferedQos(durability="transient_local", depth=1)
durations = st.tuples(st.integers(0, 2**31), st.integers(1, 999_999_999))
profiles = st.builds(
    OfferedQos,
    st.sampled_from(["reliable", "best_effort"]),
    st.sampled_from(["volatile", "transient_local"]),
    st.sampled_from(["keep_last", "keep_all"]),
    st.integers(0, 1000),
    durations,
    durations,
    st.sampled_from(["automatic", "manual_by_topic"]),
    durations,
)


@pytest.mark.parametrize(
    ("selection", "taken"),
    [
        (TopicSelection(), {"/a", "/b/c"}),
        (TopicSelection(include_hidden=True), {"/a", "/b/c", "/_h/x"}),
        (TopicSelection(topics=("/a",)), {"/a"}),
        (TopicSelection(topics=("/_h/x",)), {"/_h/x"}),
        (TopicSelection(regex="/b/.*"), {"/b/c"}),
        (TopicSelection(topics=("/a",), regex="/b/.*"), {"/a", "/b/c"}),
        (TopicSelection(exclude=("/a",)), {"/b/c"}),
        (TopicSelection(topics=("/a",), exclude=("/a",)), set()),
        (TopicSelection(exclude_regex="b"), {"/a"}),
    ],
)
def test_selection(selection: TopicSelection, taken: set[str]) -> None:
    assert {name for name in ("/a", "/b/c", "/_h/x") if selection.takes(name)} == taken


def test_broken_expression() -> None:
    with pytest.raises(BagError, match="regular expression"):
        TopicSelection(regex="(")


def test_request_hears_every_publisher() -> None:
    assert requested_qos([OfferedQos()], 1000) == OfferedQos(depth=1000)
    assert requested_qos([OfferedQos(), BEST_EFFORT], 10).reliability == "best_effort"
    assert requested_qos([LATCHED], 10) == OfferedQos(durability="transient_local", depth=10)
    assert requested_qos([LATCHED, OfferedQos()], 10).durability == "volatile"
    assert requested_qos([OfferedQos(durability="transient_local", depth=5000)], 10).depth == 5000
    assert requested_qos([], 10).reliability == "best_effort"


@given(profiles, profiles)
def test_a_request_for_the_weakest_hears_both(first: OfferedQos, second: OfferedQos) -> None:
    request = requested_qos([first, second], 10)
    assert hears(request, first) and hears(request, second)


def test_who_hears_whom() -> None:
    reliable, unreliable = OfferedQos(), BEST_EFFORT
    assert hears(unreliable, reliable) and not hears(reliable, unreliable)
    assert hears(reliable, LATCHED) and not hears(LATCHED, reliable)
    assert strongest_first([unreliable, LATCHED, reliable]) in (
        [LATCHED, reliable, unreliable],
        [LATCHED, unreliable, reliable],
    )


def test_repeats_are_recognised_as_long_as_they_are_kept() -> None:
    repeats = Repeats(kept=2)
    assert [repeats.seen(1, b"a"), repeats.seen(1, b"b"), repeats.seen(1, b"a"), repeats.seen(2, b"a")] == [
        False,
        False,
        True,
        False,
    ]
    assert not repeats.seen(1, b"a")


def test_replay_offers_what_any_publisher_offered() -> None:
    assert replayed_qos([]) == OfferedQos()
    assert replayed_qos([BEST_EFFORT]).reliability == "best_effort"
    assert replayed_qos([BEST_EFFORT, LATCHED]) == OfferedQos(durability="transient_local", depth=5)


@given(st.lists(profiles, max_size=3))
def test_qos_text_and_back(offers: list[OfferedQos]) -> None:
    assert parse_qos(qos_text(offers)) == offers
    assert isinstance(yaml.safe_load(qos_text(offers) or "[]"), list)


@given(st.text(max_size=50))
def test_any_qos_text_is_understood_or_left(text: str) -> None:
    assert isinstance(parse_qos(text), list)


def test_numbers_of_older_bags() -> None:
    text = "- history: 1\n  depth: 7\n  reliability: 2\n  durability: 1\n  deadline:\n    sec: 0\n    nsec: 0"
    assert parse_qos(text) == [OfferedQos(reliability="best_effort", durability="transient_local", depth=7)]


def test_sequence_gaps() -> None:
    gaps = SequenceGaps()
    assert [gaps.note("/a", number) for number in (5, 6, 9, 10, 2, 3)] == [0, 0, 2, 0, 0, 0]
    gaps.note("/b", 1)
    gaps.forget("/b")
    assert gaps.note("/b", 100) == 0
    gaps.report("/b", 4)
    assert gaps.lost == {"/a": 2, "/b": 4} and gaps.total == 6


def test_numbers_of_a_new_publisher_are_no_gap() -> None:
    gaps = SequenceGaps()
    for number in (500, 503):
        gaps.note("/a", number)
    gaps.confirm("/a")
    for number in (1, 504):
        gaps.note("/a", number)
    assert gaps.lost == {"/a": 504}
    gaps.forget("/a")
    assert gaps.lost == {"/a": 2}


@given(st.sets(st.integers(0, 200), min_size=1))
def test_gaps_are_what_is_missing(received: set[int]) -> None:
    gaps = SequenceGaps()
    for number in sorted(received):
        gaps.note("/a", number)
    assert gaps.total == max(received) - min(received) + 1 - len(received)


def test_attachments(tmp_path: Path) -> None:
    (tmp_path / "scenario.yaml").write_bytes(b"a: 1")
    assert read_attachment(str(tmp_path / "scenario.yaml")) == b"a: 1"
    with pytest.raises(BagError, match=r"missing\.yaml"):
        read_attachment(str(tmp_path / "missing.yaml"))
    assert media_type("a.yaml") == "application/yaml" and media_type("a.bin") == "application/octet-stream"


def test_custom_data() -> None:
    assert custom_entries(["a=b", " c = d=e "]) == {"a": "b", "c": "d=e"}
    with pytest.raises(BagError, match="key=value"):
        custom_entries(["nothing"])


def test_output_folder() -> None:
    assert output_folder("", datetime(2026, 1, 2, 3, 4, 5)) == Path("out/weld_2026_01_02-03_04_05")
    assert output_folder("x/y", datetime(2026, 1, 2)) == Path("x/y")


def test_versions_name_python_and_packages() -> None:
    assert {"python", "mcap", "numpy"} <= set(versions())


def test_free_sibling(tmp_path: Path) -> None:
    bag = tmp_path / "my.weld"
    assert free_sibling(bag) == bag
    bag.mkdir()
    (tmp_path / "my.weld_1").write_text("something else")
    (tmp_path / "my.weld_2").symlink_to("nowhere")
    assert free_sibling(bag) == tmp_path / "my.weld_3"
