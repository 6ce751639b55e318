"""The page of topics gives the quality of service that the nodes of a weld publish with."""

import re
from pathlib import Path

import pytest
import rclpy
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, ReliabilityPolicy

from fsw_control.controller_node import ControllerNode
from fsw_hmi.hmi_node import HmiNode
from fsw_msgs.srv import SetReference
from fsw_nmpc import NmpcController
from fsw_plant.plant_node import PlantNode
from fsw_quality.monitor_node import MonitorNode
from fsw_scenario.scenario_node import ScenarioNode
from fsw_supervisor.supervisor_node import SupervisorNode
from fsw_test_support.ros_graph import Spinner, domain_id

__all__ = ["domain_id"]
pytestmark = pytest.mark.slow
PAGE = Path(__file__).resolve().parents[2] / "docs" / "reference" / "topics.md"
ROW = re.compile(
    r"^\| `(/[\w/<>]+)` \|.*\| (reliable|transient local), keep last (\d+) \|$", re.MULTILINE
)
PROGRAMME = "{name: t, controller: nmpc, phases: [{name: dwell, duration_s: 60.0}]}"


def on_the_page():
    text = PAGE.read_text(encoding="utf-8")
    rows = {
        name.replace("<controller>", "nmpc"): (kind, int(depth))
        for name, kind, depth in ROW.findall(text)
    }
    assert len(rows) == text.partition("## Services")[0].count("\n| `/"), (
        "a row is written in another way"
    )
    return rows


@pytest.fixture
def published(monkeypatch):
    """Quality of service of each topic that a node of this process has published."""
    profiles, create = {}, Node.create_publisher

    def create_publisher(node, kind, topic, profile, **options):
        publisher = create(node, kind, topic, profile, **options)
        profiles.setdefault(publisher.topic_name, set()).add(described(publisher.qos_profile))
        return publisher

    monkeypatch.setattr(Node, "create_publisher", create_publisher)
    return profiles


def described(profile):
    assert (
        profile.history == HistoryPolicy.KEEP_LAST
        and profile.reliability == ReliabilityPolicy.RELIABLE
    )
    latched = profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
    return "transient local" if latched else "reliable", profile.depth


def test_quality_of_service_is_that_of_the_page(published, domain_id, tmp_path):
    values = {"fsw_plant:clock": "simulated", "fsw_plant:speed": 0.0, "fsw_hmi:port": 0}
    values |= {"fsw_hmi:token_file": tmp_path / "token"}
    values |= dict.fromkeys(
        (f"fsw_{name}:use_sim_time" for name in ("supervisor", "nmpc", "scenario")), "true"
    )
    arguments = [word for name, value in values.items() for word in ("-p", f"{name}:={value}")]
    (tmp_path / "weld.yaml").write_text(PROGRAMME)
    (tmp_path / "token").touch(mode=0o600)
    (tmp_path / "token").write_text("a token of some length")
    rclpy.init(args=["--ros-args", *arguments])
    try:
        spinner = Spinner()
        nmpc = ControllerNode("nmpc", NmpcController, NmpcController.parameters)
        nodes = [
            nmpc,
            SupervisorNode(),
            HmiNode(),
            MonitorNode(),
            ScenarioNode(str(tmp_path / "weld.yaml")),
            PlantNode(),
        ]
        for node in nodes:
            spinner.executor.add_node(node)
        rows = on_the_page()
        spinner.until(lambda: rows.keys() <= published.keys(), "all topics of the page")
        request = SetReference.Request(depth=2.7e-3, temperature=816.4)
        spinner.call(nmpc.create_client(SetReference, "fsw/set_reference"), request)
        spinner.executor.shutdown()
        for node in nodes:
            node.destroy_node()
    finally:
        rclpy.try_shutdown()
    assert {name: published[name] for name in rows} == {name: {row} for name, row in rows.items()}
    assert {name for name in published if name.startswith("/fsw/")} <= rows.keys()
