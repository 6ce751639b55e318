"""The ROS environment variables as a configuration of Cyclone DDS."""

from __future__ import annotations

import re
from xml.etree import ElementTree

import pytest
from rclpy.impl import discovery


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
    assert _peers(text) == []


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
    assert _peers(discovery.configuration(0, {"ROS_STATIC_PEERS": "10.0.0.1;host&name;"})) == [
        "10.0.0.1",
        "host&amp;name",
    ]


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
