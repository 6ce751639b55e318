"""Which settings of Fast DDS a node gets."""

from __future__ import annotations

from xml.etree import ElementTree

import pytest

from fsw_control.fast_dds import settings, stay_on_this_machine

NAMES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")
RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("discovery", ["LOCALHOST", "SUBNET"])
def test_profiles_of_the_user_take_precedence(name: str, discovery: str) -> None:
    assert settings({name: "/mine.xml", RANGE: discovery}) == {}


def test_this_machine_only_is_a_profile_of_its_own() -> None:
    everywhere, here = settings({}), settings({RANGE: "LOCALHOST"})
    assert set(everywhere) == {NAMES[0]} and here[RANGE] == "SYSTEM_DEFAULT"
    assert everywhere[NAMES[0]] != here[NAMES[0]]
    assert settings({NAMES[0]: "", NAMES[1]: ""}) == everywhere
    assert settings(here) == {NAMES[0]: here[NAMES[0]]}, (
        "a process that a node starts is where the node is"
    )
    assert settings(here | {RANGE: "LOCALHOST"}) == here


def test_a_range_that_is_set_stays() -> None:
    environment = {RANGE: "SUBNET"}
    stay_on_this_machine(environment)
    assert environment == {RANGE: "SUBNET", **settings({})}
    environment = {}
    stay_on_this_machine(environment)
    assert environment == settings({RANGE: "LOCALHOST"})


def test_both_profiles_differ_in_the_transport_only() -> None:
    files = [
        ElementTree.parse(settings(environment)[NAMES[0]]).getroot()
        for environment in ({}, {RANGE: "LOCALHOST"})
    ]
    assert (
        len(
            {
                ElementTree.tostring(part)
                for file in files
                for part in file.iter()
                if part.tag.endswith("builtin")
            }
        )
        == 1
    )
    writers = [part for file in files for part in file if part.tag.endswith("data_writer")]
    assert len(writers) == 2 and len({ElementTree.tostring(part).strip() for part in writers}) == 1
