"""Converts between rclpy's QoS profiles and those of a bag."""

from __future__ import annotations

from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime

from fsw_recorder.qos import INFINITE


def profile_of(qos: Qos) -> QoSProfile:
    """Profile to subscribe or publish with, of what `fsw_recorder.qos.profile` makes."""
    return QoSProfile(
        depth=max(qos.depth, 1),
        history=HistoryPolicy[qos.history.name],
        reliability=ReliabilityPolicy[qos.reliability.name],
        durability=DurabilityPolicy[qos.durability.name],
    )


def offered_by(profile: QoSProfile) -> Qos:
    """What a publisher offers, as a bag says it."""
    return Qos(
        QosHistory[profile.history.name],
        int(profile.depth),
        QosReliability[profile.reliability.name],
        QosDurability[profile.durability.name],
        _time(profile.deadline),
        _time(profile.lifespan),
        QosLiveliness[profile.liveliness.name],
        _time(profile.liveliness_lease_duration),
        False,
    )


def _time(duration: Duration) -> QosTime:
    return QosTime(*divmod(duration.nanoseconds, 10**9)) if duration.nanoseconds > 0 else INFINITE
