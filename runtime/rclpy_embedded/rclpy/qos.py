"""Quality of service: policies, profiles and their compatibility."""

import copy
import warnings
from enum import Enum, IntEnum
from typing import Any

from rclpy.constants import INT64_MAX
from rclpy.duration import Duration


class QoSPolicyKind(IntEnum):
    """Kinds of policies; the values are those of rmw's incompatible-QoS events."""

    INVALID = 1 << 0
    DURABILITY = 1 << 1
    DEADLINE = 1 << 2
    LIVELINESS = 1 << 3
    RELIABILITY = 1 << 4
    HISTORY = 1 << 5
    LIFESPAN = 1 << 6
    DEPTH = 1 << 7
    LIVELINESS_LEASE_DURATION = 1 << 8
    AVOID_ROS_NAMESPACE_CONVENTIONS = 1 << 9


def qos_policy_name_from_kind(policy_kind: QoSPolicyKind | int) -> str:
    return QoSPolicyKind(policy_kind).name


class InvalidQoSProfileException(Exception):  # noqa: N818 - the genuine name
    """Raised when a profile lacks what it needs."""

    def __init__(self, *args: Any) -> None:
        super().__init__("Invalid QoSProfile", *args)


class _ShortKeys(Enum):
    """Members by their names in lower case, for command lines."""

    @classmethod
    def short_keys(cls) -> list[str]:
        return [key.lower() for key in cls.__members__]

    @classmethod
    def get_from_short_key(cls, name: str) -> Any:
        """Return the value for a name in any case."""
        return cls[name.upper()].value


class QoSPolicyEnum(IntEnum, _ShortKeys):
    """Base of the policies; the values are those of ``rmw/types.h``."""

    @property
    def short_key(self) -> str:
        return self.name.lower()


class HistoryPolicy(QoSPolicyEnum):
    SYSTEM_DEFAULT = 0
    KEEP_LAST = 1
    KEEP_ALL = 2
    UNKNOWN = 3


class ReliabilityPolicy(QoSPolicyEnum):
    SYSTEM_DEFAULT = 0
    RELIABLE = 1
    BEST_EFFORT = 2
    UNKNOWN = 3
    BEST_AVAILABLE = 4


class DurabilityPolicy(QoSPolicyEnum):
    """Whether late joiners get earlier samples."""

    SYSTEM_DEFAULT = 0
    TRANSIENT_LOCAL = 1
    VOLATILE = 2
    UNKNOWN = 3
    BEST_AVAILABLE = 4


class LivelinessPolicy(QoSPolicyEnum):
    SYSTEM_DEFAULT = 0
    AUTOMATIC = 1
    MANUAL_BY_TOPIC = 3
    UNKNOWN = 4
    BEST_AVAILABLE = 5


QoSHistoryPolicy = HistoryPolicy
QoSReliabilityPolicy = ReliabilityPolicy
QoSDurabilityPolicy = DurabilityPolicy
QoSLivelinessPolicy = LivelinessPolicy

#: The strictest deadline and lease that match the endpoints known when an entity is created.
DeadlineBestAvailable = Duration(nanoseconds=INT64_MAX - 1)
LivelinessLeaseDurationeBestAvailable = Duration(nanoseconds=INT64_MAX - 1)


class QoSProfile:
    """Quality of service of a publisher, subscription, client or service.

    History or depth is required, and KEEP_LAST needs a depth. The other policies are as in the default profile if they
    are not given; those of an enum can be given as numbers. A zero duration means unspecified.
    """

    history: HistoryPolicy = HistoryPolicy.KEEP_LAST
    depth: int = 10
    reliability: ReliabilityPolicy = ReliabilityPolicy.RELIABLE
    durability: DurabilityPolicy = DurabilityPolicy.VOLATILE
    lifespan: Duration = Duration()
    deadline: Duration = Duration()
    liveliness: LivelinessPolicy = LivelinessPolicy.SYSTEM_DEFAULT
    liveliness_lease_duration: Duration = Duration()
    avoid_ros_namespace_conventions: bool = False

    def __init__(self, **kwargs: Any) -> None:
        if not kwargs.keys() <= QoSProfile.__annotations__.keys():
            raise AssertionError(f"Invalid arguments passed to constructor: {kwargs.keys()!r}")
        if not kwargs.keys() & {"history", "depth"}:
            raise InvalidQoSProfileException("History and/or depth settings are required.")
        if kwargs.get("history") == HistoryPolicy.KEEP_LAST and "depth" not in kwargs:
            raise InvalidQoSProfileException("History set to KEEP_LAST without a depth setting.")
        # History first: the check of the depth looks at it.
        for name in sorted(kwargs, key=lambda name: name != "history"):
            setattr(self, name, kwargs[name])

    def __setattr__(self, name: str, value: Any) -> None:
        if name not in QoSProfile.__annotations__:
            raise AttributeError(f"there is no QoS policy '{name}'")
        kind = type(getattr(QoSProfile, name))
        is_enum = issubclass(kind, QoSPolicyEnum)
        if not isinstance(value, (kind, int) if is_enum else kind):
            raise AssertionError(f"QoS policy '{name}' must be of type {kind.__name__}, got {value!r}")
        if name == "depth" and value == 0 and self.history == HistoryPolicy.KEEP_LAST:
            warnings.warn(
                "A zero depth with KEEP_LAST doesn't make sense; no data could be stored. "
                "This will be interpreted as SYSTEM_DEFAULT",
                stacklevel=2,
            )
        super().__setattr__(name, kind(value) if is_enum else value)

    def get_c_qos_profile(self) -> "QoSProfile":
        """Return a copy; genuine rclpy returns what its C code takes."""
        return copy.copy(self)

    def to_dict(self) -> dict[str, Any]:
        return {name: getattr(self, name) for name in QoSProfile.__annotations__}

    __hash__ = None  # type: ignore[assignment]

    def __eq__(self, other: object) -> bool:
        return isinstance(other, QoSProfile) and self.to_dict() == other.to_dict()

    def __str__(self) -> str:
        return f"{type(self).__name__}({', '.join(f'{key}={value}' for key, value in self.to_dict().items())})"


qos_profile_unknown = QoSProfile(
    depth=0,
    history=HistoryPolicy.UNKNOWN,
    reliability=ReliabilityPolicy.UNKNOWN,
    durability=DurabilityPolicy.UNKNOWN,
    liveliness=LivelinessPolicy.UNKNOWN,
)
qos_profile_default = QoSProfile(depth=10)
#: The middleware's own defaults.
qos_profile_system_default = QoSProfile(
    depth=0,
    history=HistoryPolicy.SYSTEM_DEFAULT,
    reliability=ReliabilityPolicy.SYSTEM_DEFAULT,
    durability=DurabilityPolicy.SYSTEM_DEFAULT,
)
qos_profile_sensor_data = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
qos_profile_services_default = QoSProfile(depth=10)
qos_profile_parameters = QoSProfile(depth=1000)
qos_profile_parameter_events = QoSProfile(depth=1000)
#: Matches most of the endpoints present when the entity is created; not revised later.
qos_profile_best_available = QoSProfile(
    depth=10,
    reliability=ReliabilityPolicy.BEST_AVAILABLE,
    durability=DurabilityPolicy.BEST_AVAILABLE,
    deadline=DeadlineBestAvailable,
    liveliness=LivelinessPolicy.BEST_AVAILABLE,
    liveliness_lease_duration=LivelinessLeaseDurationeBestAvailable,
)
qos_profile_action_status_default = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
qos_profile_rosout_default = QoSProfile(
    depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL, lifespan=Duration(seconds=10)
)


class QoSPresetProfiles(_ShortKeys):
    UNKNOWN = qos_profile_unknown
    DEFAULT = qos_profile_default
    SYSTEM_DEFAULT = qos_profile_system_default
    SENSOR_DATA = qos_profile_sensor_data
    SERVICES_DEFAULT = qos_profile_services_default
    PARAMETERS = qos_profile_parameters
    PARAMETER_EVENTS = qos_profile_parameter_events
    ACTION_STATUS_DEFAULT = qos_profile_action_status_default
    BEST_AVAILABLE = qos_profile_best_available


class QoSCompatibility(IntEnum):
    """Verdict on a pair of profiles."""

    OK = 0
    WARNING = 1
    ERROR = 2


#: What an offer of the first value cannot serve: a request for the second one.
WEAK_AND_STRICT = {
    "reliability": (ReliabilityPolicy.BEST_EFFORT, ReliabilityPolicy.RELIABLE),
    "durability": (DurabilityPolicy.VOLATILE, DurabilityPolicy.TRANSIENT_LOCAL),
    "liveliness": (LivelinessPolicy.AUTOMATIC, LivelinessPolicy.MANUAL_BY_TOPIC),
}
#: The words of rmw for the policies that a subscription requests and a publisher offers. If they do not match, and if
#: only the offer or only the request is known; for durations if there is none offered, and if it is too long.
_MISMATCHES = {
    "reliability": (
        "Best effort publisher and reliable subscription",
        "Best effort publisher, but subscription is",
        "Reliable subscription, but publisher is",
    ),
    "durability": (
        "Volatile publisher and transient local subscription",
        "Volatile publisher, but subscription is",
        "Transient local subscription, but publisher is",
    ),
    "deadline": (
        "Subscription has a deadline, but publisher does not",
        "Subscription deadline is less than publisher deadline",
    ),
    "liveliness": (
        "Publisher's liveliness is automatic and subscription's is manual by topic",
        "Publisher's liveliness is automatic, but subscription's is",
        "Subscription's liveliness is manual by topic, but publisher's is",
    ),
    "liveliness_lease_duration": (
        "Subscription has a liveliness lease duration, but publisher does not",
        "Subscription liveliness lease duration is less than publisher",
    ),
}
REQUESTED_POLICIES = tuple(_MISMATCHES)


def qos_check_compatible(publisher_qos: QoSProfile, subscription_qos: QoSProfile) -> tuple[QoSCompatibility, str]:
    """Return whether a publisher's profile serves a subscription's, by the request-offered rules of DDS."""
    errors, doubts = [], []
    for name, texts in _MISMATCHES.items():
        offered, requested = getattr(publisher_qos, name), getattr(subscription_qos, name)
        if isinstance(offered, Duration):
            # Zero means unspecified.
            if requested.nanoseconds and not 0 < offered.nanoseconds <= requested.nanoseconds:
                errors.append(texts[1] if offered.nanoseconds else texts[0])
            continue
        weak, strict = WEAK_AND_STRICT[name]
        is_offer_open, is_request_open = (
            value.short_key in ("system_default", "unknown") for value in (offered, requested)
        )
        if (offered, requested) == (weak, strict):
            errors.append(texts[0])
        elif is_offer_open and is_request_open:
            # So it is spelt in rmw.
            policy = name.replace("durability", "durabilty")
            doubts.append(f"Publisher {policy} is {offered.short_key} and subscription {name} is {requested.short_key}")
        elif is_offer_open and requested == strict:
            doubts.append(f"{texts[2]} {offered.short_key}")
        elif is_request_open and offered == weak:
            doubts.append(f"{texts[1]} {requested.short_key}")
    if errors:
        return QoSCompatibility.ERROR, "".join(f"ERROR: {text};" for text in errors)
    if doubts:
        return QoSCompatibility.WARNING, "".join(f"WARNING: {text};" for text in doubts)
    return QoSCompatibility.OK, ""
