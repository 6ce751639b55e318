"""Converts between the bag's words for QoS and rclpy's profiles."""

from __future__ import annotations

from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, HistoryPolicy, LivelinessPolicy, QoSProfile, ReliabilityPolicy

from fsw_recorder.bag_metadata import OfferedQos

_LONG_NS = 9_223_372_036_854_775_807


def profile_of(qos: OfferedQos) -> QoSProfile:
    """Profile to subscribe or publish with; deadlines and lifespans are not asked for."""
    best_effort = qos.reliability == "best_effort"
    latched = qos.durability == "transient_local"
    return QoSProfile(
        depth=max(qos.depth, 1),
        history=HistoryPolicy.KEEP_ALL if qos.history == "keep_all" else HistoryPolicy.KEEP_LAST,
        reliability=ReliabilityPolicy.BEST_EFFORT if best_effort else ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


def offered_by(profile: QoSProfile) -> OfferedQos:
    """What a publisher offers, in the bag's words."""
    manual = profile.liveliness == LivelinessPolicy.MANUAL_BY_TOPIC
    return OfferedQos(
        reliability="best_effort" if profile.reliability == ReliabilityPolicy.BEST_EFFORT else "reliable",
        durability="transient_local" if profile.durability == DurabilityPolicy.TRANSIENT_LOCAL else "volatile",
        history={HistoryPolicy.KEEP_ALL: "keep_all", HistoryPolicy.KEEP_LAST: "keep_last"}.get(
            profile.history, "unknown"
        ),
        depth=int(profile.depth),
        deadline=_seconds(profile.deadline),
        lifespan=_seconds(profile.lifespan),
        liveliness="manual_by_topic" if manual else "automatic",
        liveliness_lease=_seconds(profile.liveliness_lease_duration),
    )


def _seconds(duration: Duration) -> tuple[int, int]:
    nanoseconds = duration.nanoseconds
    if nanoseconds <= 0:
        nanoseconds = _LONG_NS
    return nanoseconds // 1_000_000_000, nanoseconds % 1_000_000_000
