"""Converts between rclpy's QoS profiles and those of a bag."""

from __future__ import annotations

from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, HistoryPolicy, LivelinessPolicy, QoSProfile, ReliabilityPolicy
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime

from fsw_recorder.qos import INFINITE, is_latched, is_reliable

_NS = 1_000_000_000


def profile_of(qos: Qos) -> QoSProfile:
    """Profile to subscribe or publish with; deadlines and lifespans are not asked for."""
    return QoSProfile(
        depth=max(qos.depth, 1),
        history=HistoryPolicy.KEEP_ALL if qos.history == QosHistory.KEEP_ALL else HistoryPolicy.KEEP_LAST,
        reliability=ReliabilityPolicy.RELIABLE if is_reliable(qos) else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if is_latched(qos) else DurabilityPolicy.VOLATILE,
    )


def offered_by(profile: QoSProfile) -> Qos:
    """What a publisher offers, as a bag says it."""
    best_effort = profile.reliability == ReliabilityPolicy.BEST_EFFORT
    latched = profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
    histories = {HistoryPolicy.KEEP_ALL: QosHistory.KEEP_ALL, HistoryPolicy.KEEP_LAST: QosHistory.KEEP_LAST}
    manual = profile.liveliness == LivelinessPolicy.MANUAL_BY_TOPIC
    return Qos(
        histories.get(profile.history, QosHistory.UNKNOWN),
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
    return QosTime(*divmod(duration.nanoseconds, _NS)) if duration.nanoseconds > 0 else INFINITE
