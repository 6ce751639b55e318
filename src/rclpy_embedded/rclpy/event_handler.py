"""Events of the middleware: matches, incompatible QoS, missed deadlines, liveliness, lost messages."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

from cyclonedds.core import DDSException, DDSStatus, Entity
from rclpy.callback_groups import CallbackGroup
from rclpy.exceptions import UnsupportedEventTypeError
from rclpy.logging import get_logger
from rclpy.qos import QoSPolicyKind, qos_policy_name_from_kind
from rclpy.waitable import Waitable

__all__ = [
    "EventHandler",
    "PublisherEventCallbacks",
    "QoSPublisherEventType",
    "QoSSubscriptionEventType",
    "SubscriptionEventCallbacks",
    "UnsupportedEventTypeError",
]


class QoSPublisherEventType(IntEnum):
    """Events of a publisher; the values are those of rcl."""

    RCL_PUBLISHER_OFFERED_DEADLINE_MISSED = 0
    RCL_PUBLISHER_LIVELINESS_LOST = 1
    RCL_PUBLISHER_OFFERED_INCOMPATIBLE_QOS = 2
    RCL_PUBLISHER_INCOMPATIBLE_TYPE = 3
    RCL_PUBLISHER_MATCHED = 4


class QoSSubscriptionEventType(IntEnum):
    """Events of a subscription; the values are those of rcl."""

    RCL_SUBSCRIPTION_REQUESTED_DEADLINE_MISSED = 0
    RCL_SUBSCRIPTION_LIVELINESS_CHANGED = 1
    RCL_SUBSCRIPTION_REQUESTED_INCOMPATIBLE_QOS = 2
    RCL_SUBSCRIPTION_MESSAGE_LOST = 3
    RCL_SUBSCRIPTION_INCOMPATIBLE_TYPE = 4
    RCL_SUBSCRIPTION_MATCHED = 5


@dataclass(frozen=True)
class CountInfo:
    """How often something happened: missed deadlines, lost liveliness, lost messages."""

    total_count: int
    total_count_change: int


@dataclass(frozen=True)
class IncompatibleQoSInfo(CountInfo):
    """How many peers do not match, and the last policy that was why."""

    last_policy_kind: QoSPolicyKind


@dataclass(frozen=True)
class MatchedInfo(CountInfo):
    """How many peers match."""

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
QoSLivelinessLostInfo = QoSMessageLostInfo = CountInfo
QoSLivelinessChangedInfo = LivelinessChangedInfo
QoSRequestedIncompatibleQoSInfo = QoSOfferedIncompatibleQoSInfo = IncompatibleQoSInfo
QoSSubscriptionMatchedInfo = QoSPublisherMatchedInfo = MatchedInfo

# Policy ids of the DDS specification.
_POLICIES = {
    2: QoSPolicyKind.DURABILITY,
    4: QoSPolicyKind.DEADLINE,
    8: QoSPolicyKind.LIVELINESS,
    11: QoSPolicyKind.RELIABILITY,
    13: QoSPolicyKind.HISTORY,
    21: QoSPolicyKind.LIFESPAN,
}


def _count(status: Any) -> CountInfo:
    return CountInfo(status.total_count, status.total_count_change)


def _incompatible(status: Any) -> IncompatibleQoSInfo:
    kind = _POLICIES.get(status.last_policy_id, QoSPolicyKind.INVALID)
    return IncompatibleQoSInfo(status.total_count, status.total_count_change, kind)


def _matched(status: Any) -> MatchedInfo:
    return MatchedInfo(status.total_count, status.total_count_change, status.current_count, status.current_count_change)


def _liveliness(status: Any) -> LivelinessChangedInfo:
    return LivelinessChangedInfo(
        status.alive_count, status.not_alive_count, status.alive_count_change, status.not_alive_count_change
    )


# Event type -> status bit, name of the method that takes the status, translation. Incompatible types are never
# reported: Cyclone DDS takes topics of the same name with other types for unrelated ones.
_EVENTS: dict[IntEnum, tuple[int, str, Callable[[Any], Any]]] = {
    QoSPublisherEventType.RCL_PUBLISHER_OFFERED_DEADLINE_MISSED: (
        DDSStatus.OfferedDeadlineMissed,
        "get_offered_deadline_missed_status",
        _count,
    ),
    QoSPublisherEventType.RCL_PUBLISHER_LIVELINESS_LOST: (
        DDSStatus.LivelinessLost,
        "get_liveliness_lost_status",
        _count,
    ),
    QoSPublisherEventType.RCL_PUBLISHER_OFFERED_INCOMPATIBLE_QOS: (
        DDSStatus.OfferedIncompatibleQos,
        "get_offered_incompatible_qos_status",
        _incompatible,
    ),
    QoSPublisherEventType.RCL_PUBLISHER_INCOMPATIBLE_TYPE: (0, "", _count),
    QoSPublisherEventType.RCL_PUBLISHER_MATCHED: (
        DDSStatus.PublicationMatched,
        "get_publication_matched_status",
        _matched,
    ),
}
_SUBSCRIPTION_EVENTS: dict[IntEnum, tuple[int, str, Callable[[Any], Any]]] = {
    QoSSubscriptionEventType.RCL_SUBSCRIPTION_REQUESTED_DEADLINE_MISSED: (
        DDSStatus.RequestedDeadlineMissed,
        "get_requested_deadline_missed_status",
        _count,
    ),
    QoSSubscriptionEventType.RCL_SUBSCRIPTION_LIVELINESS_CHANGED: (
        DDSStatus.LivelinessChanged,
        "get_liveliness_changed_status",
        _liveliness,
    ),
    QoSSubscriptionEventType.RCL_SUBSCRIPTION_REQUESTED_INCOMPATIBLE_QOS: (
        DDSStatus.RequestedIncompatibleQos,
        "get_requested_incompatible_qos_status",
        _incompatible,
    ),
    QoSSubscriptionEventType.RCL_SUBSCRIPTION_MESSAGE_LOST: (DDSStatus.SampleLost, "get_sample_lost_status", _count),
    QoSSubscriptionEventType.RCL_SUBSCRIPTION_INCOMPATIBLE_TYPE: (0, "", _count),
    QoSSubscriptionEventType.RCL_SUBSCRIPTION_MATCHED: (
        DDSStatus.SubscriptionMatched,
        "get_subscription_matched_status",
        _matched,
    ),
}


class EventHandler(Waitable):
    """Calls back when an event of a publisher or subscription happens.

    Parameters
    ----------
    callback_group : CallbackGroup
        Group of the callback.
    callback : callable
        Takes the event's info.
    event_type : QoSPublisherEventType or QoSSubscriptionEventType
        Which event.
    parent_impl : Entity
        DDS writer or reader.

    Raises
    ------
    UnsupportedEventTypeError
        If the middleware has no such event.
    """

    def __init__(
        self, *, callback_group: CallbackGroup, callback: Callable[[Any], Any], event_type: IntEnum, parent_impl: Entity
    ) -> None:
        events = _SUBSCRIPTION_EVENTS if isinstance(event_type, QoSSubscriptionEventType) else _EVENTS
        if event_type not in events:
            raise UnsupportedEventTypeError(f"{event_type!r} is not supported by the middleware")
        super().__init__(callback_group)
        self.event_type = event_type
        self.callback = callback
        self._status, method, self._info = events[event_type]
        self._take_status = getattr(parent_impl, method) if method else None
        self.condition = parent_impl
        parent_impl.set_status_mask(parent_impl.get_status_mask() | self._status)
        # What happened before the mask was set raised no status, but was counted.
        self._pending = self._read()

    def is_ready(self) -> bool:
        """Return whether the event happened since the last take."""
        assert self.condition is not None
        return self._pending is not None or bool(self.condition.get_status_changes() & self._status)

    def _read(self) -> Any:
        if self._take_status is None:
            return None
        try:
            info = self._info(self._take_status())
        except DDSException:  # deleted in the meantime
            return None
        return info if any(value for name, value in vars(info).items() if name.endswith("_change")) else None

    def take_data(self) -> Any:
        """Take the event's info; None if nothing changed."""
        pending, self._pending = self._pending, None
        return pending if pending is not None else self._read()

    async def execute(self, taken_data: Any) -> None:
        """Call back."""
        if taken_data is not None:
            result = self.callback(taken_data)
            if inspect.isawaitable(result):
                await result

    def destroy(self) -> None:
        """Stop looking; the DDS entity belongs to the publisher or subscription."""
        self._pending = None


def _ignore(event: Any) -> None:
    pass


def _handlers(
    callbacks: list[tuple[Callable[[Any], Any] | None, IntEnum]], callback_group: CallbackGroup, entity: Entity
) -> list[EventHandler]:
    # A new entity has every status in its mask; one that nobody takes would end every wait at once.
    entity.set_status_mask(0)
    return [
        EventHandler(callback_group=callback_group, callback=callback, event_type=event_type, parent_impl=entity)
        for callback, event_type in callbacks
        if callback is not None
    ]


class SubscriptionEventCallbacks:
    """Callbacks for events of a subscription; each takes the event's info.

    Without `incompatible_qos` a warning is logged, unless `use_default_callbacks` is False. `incompatible_type` is
    accepted and never called: the middleware does not report it.
    """

    def __init__(
        self,
        *,
        deadline: Callable[[CountInfo], Any] | None = None,
        incompatible_qos: Callable[[IncompatibleQoSInfo], Any] | None = None,
        liveliness: Callable[[LivelinessChangedInfo], Any] | None = None,
        message_lost: Callable[[CountInfo], Any] | None = None,
        incompatible_type: Callable[[Any], Any] | None = None,
        matched: Callable[[MatchedInfo], Any] | None = None,
        use_default_callbacks: bool = True,
    ) -> None:
        self.deadline = deadline
        self.incompatible_qos = incompatible_qos
        self.liveliness = liveliness
        self.message_lost = message_lost
        self.incompatible_type = incompatible_type
        self.matched = matched
        self.use_default_callbacks = use_default_callbacks

    def create_event_handlers(
        self, callback_group: CallbackGroup, subscription: Entity, topic_name: str, logger_name: str = "rclpy"
    ) -> list[EventHandler]:
        """Make the handlers of a subscription's reader."""

        def warn(event: IncompatibleQoSInfo) -> None:
            get_logger(logger_name).warn(
                f"New publisher discovered on topic '{topic_name}', offering incompatible QoS. No messages will be "
                f"received from it. Last incompatible policy: {qos_policy_name_from_kind(event.last_policy_kind)}"
            )

        kinds = QoSSubscriptionEventType
        return _handlers(
            [
                (self.deadline, kinds.RCL_SUBSCRIPTION_REQUESTED_DEADLINE_MISSED),
                (
                    self.incompatible_qos or (warn if self.use_default_callbacks else None),
                    kinds.RCL_SUBSCRIPTION_REQUESTED_INCOMPATIBLE_QOS,
                ),
                (self.liveliness, kinds.RCL_SUBSCRIPTION_LIVELINESS_CHANGED),
                (self.message_lost, kinds.RCL_SUBSCRIPTION_MESSAGE_LOST),
                (
                    self.incompatible_type or (_ignore if self.use_default_callbacks else None),
                    kinds.RCL_SUBSCRIPTION_INCOMPATIBLE_TYPE,
                ),
                (self.matched, kinds.RCL_SUBSCRIPTION_MATCHED),
            ],
            callback_group,
            subscription,
        )


class PublisherEventCallbacks:
    """Callbacks for events of a publisher; each takes the event's info.

    Without `incompatible_qos` a warning is logged, unless `use_default_callbacks` is False. `incompatible_type` is
    accepted and never called: the middleware does not report it.
    """

    def __init__(
        self,
        *,
        deadline: Callable[[CountInfo], Any] | None = None,
        liveliness: Callable[[CountInfo], Any] | None = None,
        incompatible_qos: Callable[[IncompatibleQoSInfo], Any] | None = None,
        incompatible_type: Callable[[Any], Any] | None = None,
        matched: Callable[[MatchedInfo], Any] | None = None,
        use_default_callbacks: bool = True,
    ) -> None:
        self.deadline = deadline
        self.liveliness = liveliness
        self.incompatible_qos = incompatible_qos
        self.incompatible_type = incompatible_type
        self.matched = matched
        self.use_default_callbacks = use_default_callbacks

    def create_event_handlers(
        self, callback_group: CallbackGroup, publisher: Entity, topic_name: str, logger_name: str = "rclpy"
    ) -> list[EventHandler]:
        """Make the handlers of a publisher's writer."""

        def warn(event: IncompatibleQoSInfo) -> None:
            get_logger(logger_name).warn(
                f"New subscription discovered on topic '{topic_name}', requesting incompatible QoS. No messages will "
                f"be sent to it. Last incompatible policy: {qos_policy_name_from_kind(event.last_policy_kind)}"
            )

        kinds = QoSPublisherEventType
        return _handlers(
            [
                (self.deadline, kinds.RCL_PUBLISHER_OFFERED_DEADLINE_MISSED),
                (self.liveliness, kinds.RCL_PUBLISHER_LIVELINESS_LOST),
                (
                    self.incompatible_qos or (warn if self.use_default_callbacks else None),
                    kinds.RCL_PUBLISHER_OFFERED_INCOMPATIBLE_QOS,
                ),
                (
                    self.incompatible_type or (_ignore if self.use_default_callbacks else None),
                    kinds.RCL_PUBLISHER_INCOMPATIBLE_TYPE,
                ),
                (self.matched, kinds.RCL_PUBLISHER_MATCHED),
            ],
            callback_group,
            publisher,
        )
