"""Quality of service of recorded topics, in the types of ``rosbags``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import yaml
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2.metadata import dump_qos_v9, parse_qos

#: an infinite duration, as ROS 2 writes it
INFINITE = QosTime(9223372036, 854775807)


def profile(reliable: bool = True, latched: bool = False, depth: int = 10) -> Qos:
    """A profile with the given strength and defaults otherwise."""
    return Qos(
        QosHistory.KEEP_LAST,
        depth,
        QosReliability.RELIABLE if reliable else QosReliability.BEST_EFFORT,
        QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE,
        INFINITE,
        INFINITE,
        QosLiveliness.AUTOMATIC,
        INFINITE,
        False,
    )


def is_reliable(qos: Qos) -> bool:
    """Whether messages are resent until they arrive."""
    return bool(qos.reliability != QosReliability.BEST_EFFORT)


def is_latched(qos: Qos) -> bool:
    """Whether late subscribers get the last messages."""
    return bool(qos.durability == QosDurability.TRANSIENT_LOCAL)


def qos_values(profiles: Sequence[Qos]) -> list[Any]:
    """Profiles as ``metadata.yaml`` holds them."""
    return list(dump_qos_v9(list(profiles)))


def qos_text(profiles: Sequence[Qos]) -> str:
    """Profiles as in the channel metadata of an MCAP file; empty if there are none."""
    return yaml.safe_dump(qos_values(profiles), sort_keys=False).strip() if profiles else ""


def read_qos(text: Any) -> list[Qos]:
    """Profiles from channel metadata of any version; empty if damaged."""
    try:
        return [
            qos for qos in parse_qos(text) if isinstance(qos.depth, int) and 0 <= qos.depth < 2**31
        ]
    except Exception:  # rosbags passes on any exception caused by damage
        return []


def missing_requests(offers: Sequence[Qos], present: Sequence[Qos], depth: int) -> list[Qos]:
    """QoS of the additional subscriptions needed to receive every publisher at its strength.

    A reliable subscription does not match a best-effort publisher, and a best-effort one loses
    messages of a reliable one; similarly a latched (transient local) one does not match a
    volatile publisher. A publisher's larger depth overrides ``depth``, so that all latched
    messages are received.
    """
    requests = list(present)
    for offer in sorted(
        offers, key=lambda qos: (-is_reliable(qos) - is_latched(qos), -qos.depth, repr(qos))
    ):
        reliable, latched = is_reliable(offer), is_latched(offer)
        if not any(
            is_reliable(request) <= reliable and is_latched(request) <= latched
            for request in requests
        ):
            requests.append(profile(reliable, latched, max(depth, offer.depth)))
    return requests[len(present) :]


def replayed_qos(offers: Sequence[Qos]) -> Qos:
    """QoS that matches all subscriptions of the recorded publishers: the strongest of theirs."""
    if not offers:
        return profile()
    depth = max(1, *(offer.depth for offer in offers))
    return profile(any(map(is_reliable, offers)), any(map(is_latched, offers)), depth)
