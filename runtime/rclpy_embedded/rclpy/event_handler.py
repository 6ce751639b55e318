"""Events of the middleware: matches, incompatible QoS, missed deadlines, liveliness, lost messages."""

import inspect
from collections.abc import Callable
from dataclasses import dataclass, fields
from enum import IntEnum
from typing import Any, ClassVar, Self

from cyclonedds.core import DDSException, DDSStatus, Entity
from rclpy._rclpy_pybind11 import UnsupportedEventTypeError as UnsupportedEventTypeError
from rclpy.callback_groups import CallbackGroup
from rclpy.logging import get_logger
from rclpy.qos import QoSPolicyKind, qos_policy_name_from_kind
from rclpy.waitable import Waitable

# Policy ids of the DDS specification.
_POLICIES = {
    2: QoSPolicyKind.DURABILITY,
    4: QoSPolicyKind.DEADLINE,
    8: QoSPolicyKind.LIVELINESS,
    11: QoSPolicyKind.RELIABILITY,
    13: QoSPolicyKind.HISTORY,
    21: QoSPolicyKind.LIFESPAN,
}


@dataclass(frozen=True)
class CountInfo:
    """How often something happened: missed deadlines, lost liveliness, lost messages."""

    total_count: int
    total_count_change: int


@dataclass(frozen=True)
class IncompatibleQoSInfo(CountInfo):
    """How many peers do not match, and the last policy that was why."""

    last_policy_id: int

    @property
    def last_policy_kind(self) -> QoSPolicyKind:
        """The policy in the notation of ROS."""
        return _POLICIES.get(self.last_policy_id, QoSPolicyKind.INVALID)


@dataclass(frozen=True)
class MatchedInfo(CountInfo):
    current_count: int
    current_count_change: int


@dataclass(frozen=True)
class LivelinessChangedInfo:
    """How many publishers are alive and how many are not."""

    alive_count: int
    not_alive_count: int
    alive_count_change: int
    not_alive_count_change: int


QoSRequestedDeadlineMissedInfo = QoSOfferedDeadlineMissedInfo = CountInfo
QoSLivelinessLostInfo = QoSMessageLostInfo = IncompatibleTypeInfo = CountInfo
QoSLivelinessChangedInfo = LivelinessChangedInfo
QoSRequestedIncompatibleQoSInfo = QoSOfferedIncompatibleQoSInfo = IncompatibleQoSInfo
QoSSubscriptionMatchedInfo = QoSPublisherMatchedInfo = MatchedInfo


class _EventType(IntEnum):
    """Number in rcl, name among the callbacks, name of the DDS status (incompatible types have none), type of info."""

    callback: str
    status: str
    info: type[Any]

    def __new__(cls, value: int, callback: str, status: str, info: type[Any]) -> Self:
        member = int.__new__(cls, value)
        member._value_, member.callback, member.status, member.info = value, callback, status, info
        return member


class QoSPublisherEventType(_EventType):
    RCL_PUBLISHER_OFFERED_DEADLINE_MISSED = 0, "deadline", "offered_deadline_missed", CountInfo
    RCL_PUBLISHER_LIVELINESS_LOST = 1, "liveliness", "liveliness_lost", CountInfo
    RCL_PUBLISHER_OFFERED_INCOMPATIBLE_QOS = 2, "incompatible_qos", "offered_incompatible_qos", IncompatibleQoSInfo
    RCL_PUBLISHER_INCOMPATIBLE_TYPE = 3, "incompatible_type", "", CountInfo
    RCL_PUBLISHER_MATCHED = 4, "matched", "publication_matched", MatchedInfo


class QoSSubscriptionEventType(_EventType):
    RCL_SUBSCRIPTION_REQUESTED_DEADLINE_MISSED = 0, "deadline", "requested_deadline_missed", CountInfo
    RCL_SUBSCRIPTION_LIVELINESS_CHANGED = 1, "liveliness", "liveliness_changed", LivelinessChangedInfo
    RCL_SUBSCRIPTION_REQUESTED_INCOMPATIBLE_QOS = (
        2,
        "incompatible_qos",
        "requested_incompatible_qos",
        IncompatibleQoSInfo,
    )
    RCL_SUBSCRIPTION_MESSAGE_LOST = 3, "message_lost", "sample_lost", CountInfo
    RCL_SUBSCRIPTION_INCOMPATIBLE_TYPE = 4, "incompatible_type", "", CountInfo
    RCL_SUBSCRIPTION_MATCHED = 5, "matched", "subscription_matched", MatchedInfo


class EventHandler(Waitable):
    """Calls back when an event of a publisher's writer or a subscription's reader happens."""

    def __init__(
        self, *, callback_group: CallbackGroup, callback: Callable[[Any], Any], event_type: IntEnum, parent_impl: Entity
    ) -> None:
        if not isinstance(event_type, _EventType):
            raise UnsupportedEventTypeError(f"{event_type!r} is not supported by the middleware")
        super().__init__(callback_group)
        self.event_type = event_type
        self.callback = callback
        #: The writer or reader, which wakes the executor.
        self.condition = parent_impl
        self._status, self._take_status = 0, None
        if event_type.status:
            self._status = getattr(DDSStatus, event_type.status.title().replace("_", ""))
            self._take_status = getattr(parent_impl, f"get_{event_type.status}_status")
        parent_impl.set_status_mask(parent_impl.get_status_mask() | self._status)
        # What happened before the mask was set raised no status, but was counted.
        self._pending = self._read()

    def _wait_ns(self) -> int | None:
        return 0 if self._pending is not None or self.condition.get_status_changes() & self._status else None

    def add_to_wait_set(self, wait_set: Any) -> None:
        wait_set.add_event(self)

    def is_ready(self, wait_set: Any) -> bool:
        return self._wait_ns() == 0

    def _read(self) -> Any:
        if self._take_status is None:
            return None
        try:
            status = self._take_status()
        except DDSException:  # deleted in the meantime
            return None
        # What a callback gets has fields of the DDS status, under the same names.
        values = {field.name: getattr(status, field.name) for field in fields(self.event_type.info)}
        has_changed = any(value for name, value in values.items() if name.endswith("_change"))
        return self.event_type.info(**values) if has_changed else None

    def take_data(self) -> Any:
        pending, self._pending = self._pending, None
        return pending if pending is not None else self._read()

    async def execute(self, taken_data: Any) -> None:
        if taken_data is not None:
            result = self.callback(taken_data)
            if inspect.isawaitable(result):
                await result

    def destroy(self) -> None:
        """Stop looking; the DDS entity belongs to the publisher or subscription."""
        self._pending = None


#: Former name.
QoSEventHandler = EventHandler


@dataclass(kw_only=True, eq=False)
class _EventCallbacks:
    """Callbacks for events of a publisher or subscription; each takes the event's info.

    Without `incompatible_qos` a warning is logged, unless `use_default_callbacks` is False. `incompatible_type` is
    accepted and never called, as with rmw_cyclonedds_cpp: Cyclone DDS does not report it.
    """

    deadline: Callable[[CountInfo], Any] | None = None
    incompatible_qos: Callable[[IncompatibleQoSInfo], Any] | None = None
    liveliness: Callable[[Any], Any] | None = None
    incompatible_type: Callable[[CountInfo], Any] | None = None
    matched: Callable[[MatchedInfo], Any] | None = None
    use_default_callbacks: bool = True

    _EVENTS: ClassVar[type[_EventType]]
    _WARNING: ClassVar[str]

    def create_event_handlers(
        self, callback_group: CallbackGroup, entity: Entity, topic_name: str, logger_name: str = "rclpy"
    ) -> list[EventHandler]:
        """Make the handlers of a publisher's writer or a subscription's reader."""

        def warn(event: IncompatibleQoSInfo) -> None:
            policy = qos_policy_name_from_kind(event.last_policy_kind)
            get_logger(logger_name).warn(f"{self._WARNING.format(topic_name)} Last incompatible policy: {policy}")

        defaults: dict[str, Callable[[Any], None]] = {}
        if self.use_default_callbacks:
            defaults = {"incompatible_qos": warn, "incompatible_type": lambda _: None}
        # A new entity has every status in its mask; one that is never taken would end every wait at once.
        entity.set_status_mask(0)
        return [
            EventHandler(callback_group=callback_group, callback=callback, event_type=event_type, parent_impl=entity)
            for event_type in self._EVENTS
            if (callback := getattr(self, event_type.callback) or defaults.get(event_type.callback)) is not None
        ]


@dataclass(kw_only=True, eq=False)
class SubscriptionEventCallbacks(_EventCallbacks):
    __doc__ = _EventCallbacks.__doc__

    message_lost: Callable[[CountInfo], Any] | None = None

    _EVENTS = QoSSubscriptionEventType
    _WARNING = (
        "New publisher discovered on topic '{}', offering incompatible QoS. No messages will be received from it."
    )


@dataclass(kw_only=True, eq=False)
class PublisherEventCallbacks(_EventCallbacks):
    __doc__ = _EventCallbacks.__doc__

    _EVENTS = QoSPublisherEventType
    _WARNING = "New subscription discovered on topic '{}', requesting incompatible QoS. No messages will be sent to it."
