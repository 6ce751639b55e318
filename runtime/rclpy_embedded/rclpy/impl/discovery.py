"""The range of discovery: ROS environment variables as a Cyclone DDS configuration."""

import os
import sys
from collections.abc import Mapping
from html import escape
from pathlib import Path

# rmw uses 32, which is also the limit of processes on a machine; this leaves room for more and fits the port range.
_MAX_PARTICIPANTS = 119
_RANGES = ("SUBNET", "LOCALHOST", "OFF", "SYSTEM_DEFAULT")
# Participants announce themselves to every port on this machine as often as this. Those in the range LOCALHOST listen
# to no multicast and those in SUBNET to no loopback interface, so they meet by these announcements only.
_ANNOUNCEMENT_INTERVAL = "2s"


def loopback_only() -> bool:
    """Return whether nothing but the loopback interface has an IPv4 route (containers, sandboxes, no cable; Linux)."""
    try:
        routes = Path("/proc/net/route").read_text().splitlines()[1:]
        for name in {route.split("\t", 1)[0] for route in routes} - {"lo"}:
            flags = int(Path("/sys/class/net", name, "flags").read_text(), 16)
            # Up and multicast-capable is what Cyclone DDS needs for its own choice.
            if flags & 0x1 and flags & 0x1000:
                return False
    except (OSError, ValueError):
        return False
    return True


def discovery_range(environ: Mapping[str, str] = os.environ) -> str:
    """Return the requested range: SUBNET, LOCALHOST, OFF or SYSTEM_DEFAULT."""
    if environ.get("ROS_LOCALHOST_ONLY", "") == "1":
        return "LOCALHOST"
    wanted = environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "") or "SUBNET"
    if wanted in _RANGES:
        return wanted
    print(
        f"ROS_AUTOMATIC_DISCOVERY_RANGE is {wanted!r}, expected one of {', '.join(_RANGES)}; using LOCALHOST",
        file=sys.stderr,
    )
    return "LOCALHOST"


def static_peers(environ: Mapping[str, str] = os.environ) -> list[str]:
    return [peer for peer in environ.get("ROS_STATIC_PEERS", "").split(";") if peer]


def configuration(domain: int, environ: Mapping[str, str] = os.environ) -> str:
    """Return the configuration of a domain: what the ROS variables say, then CYCLONEDDS_URI, which wins."""
    wanted, peers, user = discovery_range(environ), static_peers(environ), environ.get("CYCLONEDDS_URI", "")
    general = interfaces = discovery = ""
    if wanted == "LOCALHOST":
        general = "<AllowMulticast>false</AllowMulticast>"
        # What other nodes send to localhost comes in here, and Cyclone DDS takes it from chosen interfaces only.
        interfaces = '<NetworkInterface address="127.0.0.1"/>'
        if peers and not loopback_only():
            interfaces += '<NetworkInterface autodetermine="true"/>'
    elif wanted == "OFF":
        general = "<AllowMulticast>false</AllowMulticast>"
        discovery = f"<ParticipantIndex>none</ParticipantIndex><Tag>ros_discovery_off_{os.getpid()}</Tag>"
    elif wanted == "SUBNET" and loopback_only():
        interfaces = '<NetworkInterface name="lo" multicast="true"/>'
    if wanted in ("LOCALHOST", "SUBNET"):
        limit = min(_MAX_PARTICIPANTS, (65535 - 7411 - 250 * domain) // 2)
        addresses = "".join(f'<Peer address="{escape(peer)}"/>' for peer in ("localhost", *peers))
        discovery = (
            f"<SPDPInterval>{_ANNOUNCEMENT_INTERVAL}</SPDPInterval><ParticipantIndex>auto</ParticipantIndex>"
            f"<MaxAutoParticipantIndex>{limit}</MaxAutoParticipantIndex>"
            # Without an end, as by the Cyclone DDS of Jazzy; the default here is 30 s.
            f"<InitialLocatorPruneDelay>inf</InitialLocatorPruneDelay><Peers>{addresses}</Peers>"
        )
    # An explicit interface in CYCLONEDDS_URI would add to ours instead of replacing it.
    if interfaces and "<Interfaces>" not in user.replace(" ", "") and "NetworkInterfaceAddress" not in user:
        general += f"<Interfaces>{interfaces}</Interfaces>"
    elements = f"<General>{general}</General><Discovery>{discovery}</Discovery>"
    return f"<CycloneDDS><Domain>{elements}</Domain></CycloneDDS>" + ("," + user if user else "")


def domain_id(environ: Mapping[str, str] = os.environ) -> int:
    """Return the domain of ROS_DOMAIN_ID, 0 without it; RuntimeError if it is not a number from 0 to 232."""
    text = environ.get("ROS_DOMAIN_ID", "").strip() or "0"
    if not text.isdecimal() or int(text) > 232:
        raise RuntimeError(f"ROS_DOMAIN_ID is not an integer from 0 to 232: {text!r}")
    return int(text)
