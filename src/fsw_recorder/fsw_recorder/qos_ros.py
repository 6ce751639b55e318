"""Converts between rclpy's QoS profiles and those of a bag."""

from __future__ import annotations

from rclpy.duration import Duration
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    QoSProfile,
    ReliabilityPolicy,
)
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)

from fsw_recorder.qos import INFINITE


def profile_of(qos: Qos) -> QoSProfile:
    """Convert a profile of `fsw_recorder.qos.profile` for subscribing or publishing."""
    return QoSProfile(
        depth=max(qos.depth, 1),
        history=HistoryPolicy[qos.history.name],
        reliability=ReliabilityPolicy[qos.reliability.name],
        durability=DurabilityPolicy[qos.durability.name],
    )


def offered_by(profile: QoSProfile) -> Qos:
    """QoS offered by a publisher, as stored in a bag; unreported policies have their default."""
    best_effort = profile.reliability == ReliabilityPolicy.BEST_EFFORT
    latched = profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
    manual = profile.liveliness == LivelinessPolicy.MANUAL_BY_TOPIC
    return Qos(
        QosHistory[profile.history.name],
        int(profile.depth),
        QosReliability.BEST_EFFORT if best_effort else QosReliability.RELIABLE,
        QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE,
        _time(profile.deadline),
        _time(profile.lifespan),
        QosLiveliness.MANUAL_BY_TOPIC if manual else QosLiveliness.AUTOMATIC,
        _time(profile.liveliness_lease_duration),
        False,
    )


def _time(duration: Duration) -> QosTime:
    return QosTime(*divmod(duration.nanoseconds, 10**9)) if duration.nanoseconds > 0 else INFINITE
