"""Settings of Fast DDS for all nodes, as environment variables; the user's take precedence."""

from __future__ import annotations

from collections.abc import Mapping, MutableMapping
from pathlib import Path

_PROFILES = Path(__file__).with_name("fast_dds.xml")
_PROFILES_HERE = Path(__file__).with_name("fast_dds_localhost.xml")
#: variables that may name the user's own profiles
_NAMES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")
_RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"


def settings(environment: Mapping[str, str]) -> dict[str, str]:
    """Variables to add to an environment before ``rclpy.init``.

    Nodes use UDP and no shared memory: after a node was killed, the others may continue to write
    to the deleted memory of its port, so that it hears nothing when it is started again
    (eProsima/Fast-DDS#5053). With the range ``LOCALHOST`` rmw_fastrtps adds shared memory to every
    profile; one for the loopback interface replaces this range.
    """
    profile = next(filter(None, map(environment.get, _NAMES)), "")
    if profile not in ("", str(_PROFILES), str(_PROFILES_HERE)):
        return {}
    if environment.get(_RANGE) == "LOCALHOST":
        return {_NAMES[0]: str(_PROFILES_HERE), _RANGE: "SYSTEM_DEFAULT"}
    return {_NAMES[0]: profile or str(_PROFILES)}


def stay_on_this_machine(environment: MutableMapping[str, str]) -> None:
    """Restrict discovery to this machine, unless the environment has a range already."""
    environment.setdefault(_RANGE, "LOCALHOST")
    environment.update(settings(environment))
