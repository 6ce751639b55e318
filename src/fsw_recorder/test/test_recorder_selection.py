"""Topic selection, QoS rules, repeated messages, attachments."""

import json
from datetime import datetime
from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)

from fsw_control.schema.files import free_sibling
from fsw_recorder import BagError
from fsw_recorder.recording import (
    code_sha256,
    custom_entries,
    media_type,
    output_folder,
    read_attachment,
    versions_text,
)
from fsw_recorder.topic import (
    TopicSelection,
    is_latched,
    is_reliable,
    missing_requests,
    profile,
    qos_text,
    read_qos,
    replayed_qos,
)
from fsw_recorder.topic_subscription_ros import Repeats

BEST_EFFORT = profile(reliable=False, depth=5)
LATCHED = profile(latched=True, depth=1)
WELDS = (
    "/cell1/fsw/depth",
    "/cell1/fsw_plant/transition_event",
    "/cell1/b/fsw/depth",
    "/cell10/fsw/depth",
    "/fsw/depth",
    "/fsw/fsw_mine/proposal",
    "/diagnostics",
    "/camera/image",
)
durations = st.builds(QosTime, st.integers(0, 2**31), st.integers(1, 999_999_999))
profiles = st.builds(
    Qos,
    st.sampled_from([QosHistory.KEEP_LAST, QosHistory.KEEP_ALL]),
    st.integers(0, 1000),
    st.sampled_from([QosReliability.RELIABLE, QosReliability.BEST_EFFORT]),
    st.sampled_from([QosDurability.VOLATILE, QosDurability.TRANSIENT_LOCAL]),
    durations,
    durations,
    st.sampled_from([QosLiveliness.AUTOMATIC, QosLiveliness.MANUAL_BY_TOPIC]),
    durations,
    st.just(False),
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


@given(st.text())
def test_without_rules_every_topic_of_whatever_name_is_selected(name: str) -> None:
    """Bags of others have topics without the slash at the beginning."""
    assert TopicSelection(include_hidden=True).takes(name)


def test_broken_expression() -> None:
    with pytest.raises(BagError, match="regular expression"):
        TopicSelection(regex="(")


@pytest.mark.parametrize(
    ("offers", "present", "added"),
    [
        ([profile()], [], [profile(depth=1000)]),
        ([BEST_EFFORT, profile()], [], [profile(depth=1000), profile(reliable=False, depth=1000)]),
        ([profile()], [profile(reliable=False)], []),
        ([BEST_EFFORT], [profile()], [profile(reliable=False, depth=1000)]),
        ([LATCHED, profile()], [], [profile(latched=True, depth=1000), profile(depth=1000)]),
        ([LATCHED], [profile()], []),
        ([profile(latched=True, depth=5000)], [], [profile(latched=True, depth=5000)]),
        ([], [], []),
    ],
)
def test_subscriptions_that_are_missing(
    offers: list[Qos], present: list[Qos], added: list[Qos]
) -> None:
    assert missing_requests(offers, present, 1000) == added


@given(st.lists(profiles, max_size=4))
def test_once_every_publisher_is_heard_nothing_is_missing(offers: list[Qos]) -> None:
    requests = missing_requests(offers, [], 10)
    assert missing_requests(offers, requests, 10) == [] and bool(requests) == bool(offers)


@pytest.mark.parametrize(
    ("selection", "taken"),
    [
        (TopicSelection(), {*WELDS}),
        (
            TopicSelection(namespace="/"),
            {"/fsw/depth", "/fsw/fsw_mine/proposal", "/diagnostics", "/camera/image"},
        ),
        (TopicSelection(namespace="/cell1/b"), {"/cell1/b/fsw/depth", "/diagnostics"}),
        (
            TopicSelection(namespace="/cell1"),
            {"/cell1/fsw/depth", "/cell1/fsw_plant/transition_event", "/diagnostics"},
        ),
        (
            TopicSelection(namespace="/cell1", regex=".*/depth"),
            {weld for weld in WELDS if weld.endswith("depth")},
        ),
        (TopicSelection(namespace="/cell1", topics=("/fsw/depth",)), {"/fsw/depth"}),
    ],
)
def test_a_recorder_leaves_the_welds_of_other_namespaces_alone(
    selection: TopicSelection, taken: set[str]
) -> None:
    assert {name for name in WELDS if selection.takes(name)} == taken


@pytest.mark.parametrize(
    ("namespace", "taken"),
    [
        ("/cell1", {"/cell1/fsw_plant", "/cell1/camera", "/robot"}),
        ("/", {"/fsw_plant", "/robot", "/cell1/camera"}),
        ("", {"/cell1/fsw_plant", "/cell1/camera", "/cell2/fsw_plant", "/fsw_plant", "/robot"}),
    ],
)
def test_parameters_are_those_of_the_weld_and_of_what_all_share(
    namespace: str, taken: set[str]
) -> None:
    nodes = {
        "/cell1/fsw_plant",
        "/cell1/camera",
        "/cell2/fsw_plant",
        "/fsw_plant",
        "/robot",
        "/_ros2cli_1",
        "/a/_hidden",
    }
    assert {
        name for name in nodes if TopicSelection(namespace=namespace).takes_node(name)
    } == taken


def test_repeats_are_recognised_as_long_as_they_are_kept() -> None:
    repeats = Repeats(kept=2)
    assert [
        repeats.seen(1, b"a"),
        repeats.seen(1, b"b"),
        repeats.seen(1, b"a"),
        repeats.seen(2, b"a"),
    ] == [
        False,
        False,
        True,
        False,
    ]
    assert not repeats.seen(1, b"a")


def test_replay_offers_what_any_publisher_offered() -> None:
    assert replayed_qos([]) == profile()
    assert not is_reliable(replayed_qos([BEST_EFFORT]))
    assert replayed_qos([BEST_EFFORT, LATCHED]) == profile(latched=True, depth=5)


@given(st.lists(profiles, max_size=3))
def test_qos_text_and_back(offers: list[Qos]) -> None:
    assert read_qos(qos_text(offers)) == offers
    assert isinstance(yaml.safe_load(qos_text(offers) or "[]"), list)


@given(st.text(max_size=50))
def test_any_qos_text_is_understood_or_left(text: str) -> None:
    assert isinstance(read_qos(text), list)


def test_numbers_of_older_bags() -> None:
    time = "{sec: 0, nsec: 0}"
    text = f"- {{history: 1, depth: 7, reliability: 2, durability: 1, deadline: {time}, "
    text += f"lifespan: {time}, liveliness: 1, liveliness_lease_duration: {time}, "
    text += "avoid_ros_namespace_conventions: false}"
    (qos,) = read_qos(text)
    assert qos.depth == 7 and not is_reliable(qos) and is_latched(qos)


def test_attachments(tmp_path: Path) -> None:
    (tmp_path / "scenario.yaml").write_bytes(b"a: 1")
    assert read_attachment(str(tmp_path / "scenario.yaml")) == b"a: 1"
    with pytest.raises(BagError, match=r"missing\.yaml"):
        read_attachment(str(tmp_path / "missing.yaml"))
    assert (
        media_type("a.yaml") == "application/yaml"
        and media_type("a.bin") == "application/octet-stream"
    )


def test_custom_data() -> None:
    assert custom_entries(["a=b", " c = d=e "]) == {"a": "b", "c": "d=e"}
    with pytest.raises(BagError, match="key=value"):
        custom_entries(["nothing"])


def test_output_folder() -> None:
    assert output_folder("", datetime(2026, 1, 2, 3, 4, 5)) == Path("out/weld_2026_01_02-03_04_05")
    assert output_folder("x/y", datetime(2026, 1, 2)) == Path("x/y")


def test_versions_name_python_and_packages() -> None:
    assert {"python", "mcap", "numpy"} <= set(json.loads(versions_text()))


def test_code_is_hashed_by_name_and_content(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(tmp_path))
    kernel = tmp_path / "welding" / "kernel"
    kernel.mkdir(parents=True)
    seen = []
    for file, content in (
        ("__init__.py", "a = 1"),
        ("__init__.py", "a = 2"),
        ("kernel/a.c", "int a;"),
        ("kernel/a.h", "int a;"),
        ("notes.txt", "no code"),
    ):
        (kernel.parent / file).write_text(content)
        seen.append(code_sha256("welding"))
    assert len(set(seen[:4])) == 4 and seen[4] == seen[3]


def test_free_sibling(tmp_path: Path) -> None:
    bag = tmp_path / "my.weld"
    assert free_sibling(bag) == bag
    bag.mkdir()
    (tmp_path / "my.weld_1").write_text("something else")
    (tmp_path / "my.weld_2").symlink_to("nowhere")
    assert free_sibling(bag) == tmp_path / "my.weld_3"
