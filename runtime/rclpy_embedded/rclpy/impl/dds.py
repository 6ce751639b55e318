"""Cyclone DDS entities that carry serialized messages (CDR), with the QoS and USER_DATA of rmw_cyclonedds."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from functools import cache
from typing import Any

from cyclonedds.core import Entity, InstanceState, Policy, Qos, ReadCondition, SampleState, ViewState
from cyclonedds.idl import IdlStruct, make_idl_struct
from cyclonedds.idl.types import uint8
from rclpy.constants import INT64_MAX
from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, HistoryPolicy, LivelinessPolicy, QoSProfile, ReliabilityPolicy


class RawSample(IdlStruct):
    """A sample whose serialized form is given; the middleware looks at its first byte only."""

    def __init__(self, data: bytes) -> None:
        self.data = data
        #: What Cyclone DDS tells of a received one.
        self.sample_info: Any = None

    def serialize(self, buffer: Any = None, endianness: Any = None, use_version_2: bool | None = None) -> bytes:
        return self.data

    @classmethod
    def deserialize(cls, data: bytes, has_header: bool = True, use_version_2: bool | None = None) -> RawSample:
        return cls(data)

    deserialize_key = deserialize


@cache
def raw_type(dds_name: str) -> Any:
    # The one member (every ROS message has at least a byte) is named after the type: else DDS would take all these
    # types for the same and match them within a process.
    member = dds_name.replace("::", "__")
    return make_idl_struct("RawType", dds_name, {member: uint8}, dataclassify=False, bases=(RawSample,))


def matched(handles: Callable[[], list[int]]) -> list[int]:
    """Return the handles of what matches an endpoint, from cyclonedds' own method for it.

    That method counts first and reads then; a match that comes in between makes it fail, and asking again helps.
    """
    while True:
        try:
            return handles()
        except IndexError:
            continue


class Readable(ReadCondition):
    """Wakes an executor when a reader has something to take."""

    def __init__(self, reader: Any) -> None:
        super().__init__(reader, SampleState.Any | ViewState.Any | InstanceState.Any)

    @property
    def condition(self) -> Readable:
        """What the DDS wait set waits for."""
        return self

    def _wait_ns(self) -> int | None:
        return 0 if self.is_triggered() else None


def delete(entity: Entity | None) -> None:
    """Delete the DDS entity now, even if the Python object is still referenced."""
    if entity is not None:
        with suppress(KeyError):  # another thread deletes it, too
            entity.__del__()


def qos_to_dds(profile: QoSProfile, user_data: str, *, writer: bool) -> Qos:
    """Translate a profile as rmw_cyclonedds does."""
    if profile.history == HistoryPolicy.KEEP_ALL:
        history: Any = Policy.History.KeepAll
    else:
        history = Policy.History.KeepLast(max(1, profile.depth))
    best_effort = profile.reliability == ReliabilityPolicy.BEST_EFFORT
    policies: list[Any] = [
        Policy.DataRepresentation(use_cdrv0_representation=True),
        history,
        Policy.Reliability.BestEffort if best_effort else Policy.Reliability.Reliable(INT64_MAX),
        Policy.Userdata(user_data.encode()),
    ]
    if profile.durability == DurabilityPolicy.TRANSIENT_LOCAL:
        policies.append(Policy.Durability.TransientLocal)
        if writer:
            policies.append(Policy.DurabilityService(0, history, -1, -1, -1))
    else:
        policies.append(Policy.Durability.Volatile)
    if writer:
        policies.append(Policy.WriterDataLifecycle(autodispose=False))
        if lifespan := profile.lifespan.nanoseconds:
            policies.append(Policy.Lifespan(lifespan))
    if deadline := profile.deadline.nanoseconds:
        policies.append(Policy.Deadline(deadline))
    lease = profile.liveliness_lease_duration.nanoseconds or INT64_MAX
    manual = profile.liveliness == LivelinessPolicy.MANUAL_BY_TOPIC
    policies.append(Policy.Liveliness.ManualByTopic(lease) if manual else Policy.Liveliness.Automatic(lease))
    return Qos(*policies)


def profile_from_dds(qos: Qos) -> QoSProfile:
    """Translate discovered QoS back into a profile; policies that are absent become unknown."""

    def duration(policy: Any, field: str) -> Duration:
        return Duration(nanoseconds=getattr(policy, field, INT64_MAX))

    history, depth = HistoryPolicy.UNKNOWN, 0
    if qos[Policy.History] == Policy.History.KeepAll:
        history = HistoryPolicy.KEEP_ALL
    elif qos[Policy.History] is not None:
        history, depth = HistoryPolicy.KEEP_LAST, qos[Policy.History].depth
    reliable = isinstance(qos[Policy.Reliability], Policy.Reliability.Reliable)
    transient_local = qos[Policy.Durability] == Policy.Durability.TransientLocal
    liveliness = qos[Policy.Liveliness]
    manual = isinstance(liveliness, Policy.Liveliness.ManualByTopic)
    return QoSProfile(
        history=history,
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if transient_local else DurabilityPolicy.VOLATILE,
        lifespan=duration(qos[Policy.Lifespan], "lifespan"),
        deadline=duration(qos[Policy.Deadline], "deadline"),
        liveliness=LivelinessPolicy.MANUAL_BY_TOPIC if manual else LivelinessPolicy.AUTOMATIC,
        liveliness_lease_duration=duration(liveliness, "lease_duration"),
    )
