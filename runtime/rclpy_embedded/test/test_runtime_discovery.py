"""The ROS environment variables as a configuration of Cyclone DDS."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from typing import Any
from xml.etree import ElementTree

import pytest
from rclpy._rclpy_pybind11 import RCLError
from rclpy.context import Context
from rclpy.impl import discovery, session


def _element(text: str, path: str) -> str | None:
    return ElementTree.fromstring(text.split(",<")[0].split(",file:")[0]).findtext(f"Domain/{path}")


def _peers(text: str) -> list[str]:
    return re.findall(r'Peer address="([^"]*)"', text)


@pytest.fixture(autouse=True)
def _with_network(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(discovery, "loopback_only", lambda: False)


def test_subnet_is_the_default() -> None:
    text = discovery.configuration(0, {})
    assert _element(text, "General/AllowMulticast") is None
    assert "NetworkInterface" not in text


@pytest.mark.parametrize("wanted", ["SUBNET", "LOCALHOST"])
def test_both_ranges_announce_themselves_on_this_machine(wanted: str) -> None:
    text = discovery.configuration(0, {"ROS_AUTOMATIC_DISCOVERY_RANGE": wanted})
    assert _peers(text) == ["localhost"]
    assert _element(text, "Discovery/SPDPInterval") == "2s"


@pytest.mark.parametrize("environ", [{"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}, {"ROS_LOCALHOST_ONLY": "1"}])
def test_localhost(environ: dict[str, str]) -> None:
    text = discovery.configuration(0, environ)
    assert _element(text, "General/AllowMulticast") == "false"
    assert _element(text, "Discovery/ParticipantIndex") == "auto"
    assert int(_element(text, "Discovery/MaxAutoParticipantIndex") or 0) > 40
    assert _peers(text) == ["localhost"]
    assert re.findall(r"<NetworkInterface ([^/]*)/>", text) == ['address="127.0.0.1"']


def test_localhost_and_static_peers() -> None:
    text = discovery.configuration(0, {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "ROS_STATIC_PEERS": "10.0.0.1"})
    assert _peers(text) == ["localhost", "10.0.0.1"]
    assert re.findall(r"<NetworkInterface ([^/]*)/>", text) == ['address="127.0.0.1"', 'autodetermine="true"']


def test_off() -> None:
    text = discovery.configuration(0, {"ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF", "ROS_STATIC_PEERS": "10.0.0.1"})
    assert _element(text, "General/AllowMulticast") == "false"
    assert _element(text, "Discovery/ParticipantIndex") == "none"
    assert (_element(text, "Discovery/Tag") or "").startswith("ros_discovery_off_")
    assert _peers(text) == []


def test_system_default_changes_nothing() -> None:
    text = discovery.configuration(0, {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SYSTEM_DEFAULT"})
    assert not _element(text, "Discovery") and not _element(text, "General")


def test_unknown_range_is_localhost(capsys: pytest.CaptureFixture[str]) -> None:
    assert discovery.discovery_range({"ROS_AUTOMATIC_DISCOVERY_RANGE": "PLANET"}) == "LOCALHOST"
    assert "PLANET" in capsys.readouterr().err


def test_static_peers() -> None:
    peers = _peers(discovery.configuration(0, {"ROS_STATIC_PEERS": "10.0.0.1;host&name;"}))
    assert peers == ["localhost", "10.0.0.1", "host&amp;name"]


@pytest.mark.parametrize("environ", [{"ROS_LOCALHOST_ONLY": "1"}, {"ROS_STATIC_PEERS": "10.0.0.1"}])
def test_peers_are_called_for_ever(environ: dict[str, str]) -> None:
    assert _element(discovery.configuration(0, environ), "Discovery/InitialLocatorPruneDelay") == "inf"


def test_loopback_only(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(discovery, "loopback_only", lambda: True)
    assert 'name="lo" multicast="true"' in discovery.configuration(0, {})
    assert _peers(discovery.configuration(0, {})) == ["localhost"]
    own = "<CycloneDDS><Domain><General><Interfaces><NetworkInterface/></Interfaces></General></Domain></CycloneDDS>"
    assert 'name="lo"' not in discovery.configuration(0, {"CYCLONEDDS_URI": own})


def test_cyclonedds_uri_is_appended() -> None:
    assert discovery.configuration(0, {"CYCLONEDDS_URI": "file:///etc/dds.xml"}).endswith(",file:///etc/dds.xml")


@pytest.mark.parametrize("uri", ["nonsense", "file:///none.xml", "file:///Größe.xml"])
def test_a_configuration_that_cannot_be_used_is_named(monkeypatch: pytest.MonkeyPatch, uri: str) -> None:
    monkeypatch.setenv("CYCLONEDDS_URI", uri)
    with pytest.raises(RuntimeError, match=f"cannot join domain 232; CYCLONEDDS_URI is '{uri}'"):
        session._new_domain(232)


def test_ports_fit_in_high_domains() -> None:
    text = discovery.configuration(232, {"ROS_LOCALHOST_ONLY": "1"})
    highest = int(_element(text, "Discovery/MaxAutoParticipantIndex") or 0)
    assert 7400 + 250 * 232 + 11 + 2 * highest <= 65535


@pytest.mark.parametrize(("text", "domain"), [("", 0), ("7", 7), (" 232 ", 232)])
def test_domain_id(text: str, domain: int) -> None:
    assert discovery.domain_id({"ROS_DOMAIN_ID": text}) == domain


@pytest.mark.parametrize("text", ["x", "-1", "233", "1.5"])
def test_bad_domain_id(text: str) -> None:
    with pytest.raises(RuntimeError, match="ROS_DOMAIN_ID"):
        discovery.domain_id({"ROS_DOMAIN_ID": text})


@pytest.mark.parametrize(
    ("name", "value"), [("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF"), ("ROS_STATIC_PEERS", "10.0.0.1")]
)
def test_contexts_of_a_process_have_one_range_in_a_domain(
    context: Context, domain_id: int, name: str, value: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = Context()
    with (
        monkeypatch.context() as changed,
        pytest.raises(RCLError, match=f"domain {domain_id} .* cannot be joined with .*{value}"),
    ):
        changed.setenv(name, value)
        other.init(args=[])
    assert not other.ok()
    other.init(args=[])
    other.destroy()
    context.destroy()
    monkeypatch.setenv(name, value)
    alone = Context()
    alone.init(args=[])
    alone.destroy()


@pytest.mark.parametrize("ranges", [("SUBNET", "LOCALHOST"), ("LOCALHOST", "SUBNET")])
def test_processes_in_different_ranges_find_each_other(
    ranges: tuple[str, str], run_program: Callable[..., Any]
) -> None:
    source = """
import rclpy
rclpy.init()
node = rclpy.create_node("node_" + __import__("sys").argv[1])
print("ready", flush=True)
print(node.wait_for_node("node_" + __import__("sys").argv[2], 120), flush=True)
input()
"""
    programs = []
    for own, other in zip("ab", "ba", strict=True):
        environ = {**os.environ, "ROS_AUTOMATIC_DISCOVERY_RANGE": ranges[len(programs)]}
        programs.append(run_program(source, own, other, environ=environ))
        assert programs[-1].line() == "ready"
    assert [program.line() for program in programs] == ["True", "True"]
