"""The recorder as a managed node: a whole bag from each activation."""

from pathlib import Path
from typing import Any

import pytest
from rclpy.parameter import Parameter

from fsw_msgs.msg import ShoulderDepth
from fsw_recorder.bag_reader import BagReader
from fsw_recorder.recorder_node import RecorderNode
from fsw_test_support.bags import decoder

pytestmark = pytest.mark.slow


def recorder_of(graph: Any, **values: Any) -> RecorderNode:
    overrides = [
        Parameter(name, value=value)
        for name, value in {"topics": ["/fsw/depth"], **values}.items()
    ]
    recorder = RecorderNode(context=graph.context, parameter_overrides=overrides)
    graph.executor.add_node(recorder)
    return recorder


def depths_of(bag: Path) -> list[float]:
    with BagReader(bag) as reader:
        assert not reader.problems
        return [message.depth for message in map(decoder(reader), reader.records(["/fsw/depth"]))]


def test_each_activation_makes_a_bag_that_is_whole_when_it_is_over(
    graph: Any, tmp_path: Path
) -> None:
    recorder = recorder_of(graph, output=str(tmp_path / "bag"), autostart=False)
    depth = graph.node.create_publisher(ShoulderDepth, "/fsw/depth", 100)
    assert [*tmp_path.iterdir()] == []
    recorder.trigger_configure()
    for name, value in (("bag", 1.0), ("bag_1", 2.0)):
        recorder.trigger_activate()
        graph.until(lambda: depth.get_subscription_count() > 0, "its subscription")
        depth.publish(ShoulderDepth(depth=value))
        graph.until(lambda: recorder.writer.statistics()["received"] == 1, "the message")
        recorder.trigger_deactivate()
        graph.until(lambda: depth.get_subscription_count() == 0, "the end of its subscription")
        assert depths_of(tmp_path / name) == [value]
    recorder.trigger_shutdown()
    graph.executor.remove_node(recorder)
    recorder.destroy_node()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bag", "bag_1"]


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        ({}, "exists already"),
        ({"output": "", "custom_data": ["nonsense"]}, "custom_data 'nonsense': "),
        ({"output": "", "attach": ["no_such_file"]}, "no_such_file: "),
        ({"output": "", "signing_key": "no_such_key"}, "key no_such_key"),
        ({"output": "", "regex": "["}, "regular expression"),
    ],
)
def test_it_says_why_it_cannot_be_configured(
    graph: Any,
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
    values: dict[str, Any],
    reason: str,
) -> None:
    recorder = recorder_of(graph, **({"output": str(tmp_path)} | values), autostart=False)
    recorder.trigger_configure()
    assert not recorder.is_configured
    assert f"cannot configure: {tmp_path if not values else ''}" in (
        printed := capfd.readouterr().err
    )
    assert reason in printed
    graph.executor.remove_node(recorder)
    recorder.destroy_node()


def test_a_bag_is_whole_even_if_ctrl_c_comes_while_it_is_begun(
    graph: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun: list[Path] = []

    def interrupt(_: RecorderNode) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(RecorderNode, "_discover", interrupt)
    monkeypatch.setattr(
        "fsw_recorder.after_recording.start", lambda _, folder: begun.append(folder)
    )
    with pytest.raises(KeyboardInterrupt):
        RecorderNode(
            context=graph.context,
            parameter_overrides=[
                Parameter("output", value=str(tmp_path / "bag")),
                Parameter("on_finished", value=["true"]),
            ],
        )
    assert depths_of(tmp_path / "bag") == [] and (tmp_path / "bag" / "metadata.yaml").exists()
    assert begun == [tmp_path / "bag"]
