"""QoS profiles and their compatibility."""

import itertools

import pytest
from rclpy.duration import Duration
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    InvalidQoSProfileException,
    LivelinessPolicy,
    QoSCompatibility,
    QoSPolicyKind,
    QoSPresetProfiles,
    QoSProfile,
    ReliabilityPolicy,
    qos_check_compatible,
    qos_policy_name_from_kind,
    qos_profile_best_available,
    qos_profile_parameters,
    qos_profile_sensor_data,
    qos_profile_system_default,
)


def test_defaults_are_those_of_the_default_profile() -> None:
    assert QoSProfile(depth=10) == QoSPresetProfiles.DEFAULT.value
    assert str(QoSProfile(depth=1)) == (
        "QoSProfile(history=1, depth=1, reliability=1, durability=2, lifespan=0 nanoseconds, "
        "deadline=0 nanoseconds, liveliness=0, liveliness_lease_duration=0 nanoseconds, "
        "avoid_ros_namespace_conventions=False)"
    )


def test_presets() -> None:
    assert (qos_profile_sensor_data.depth, qos_profile_sensor_data.reliability) == (5, ReliabilityPolicy.BEST_EFFORT)
    assert qos_profile_parameters.depth == 1000
    assert qos_profile_system_default.to_dict() == {
        "history": 0,
        "depth": 0,
        "reliability": 0,
        "durability": 0,
        "lifespan": Duration(),
        "deadline": Duration(),
        "liveliness": 0,
        "liveliness_lease_duration": Duration(),
        "avoid_ros_namespace_conventions": False,
    }
    assert qos_profile_best_available.deadline.nanoseconds == 2**63 - 2
    assert QoSPresetProfiles.get_from_short_key("Sensor_Data") is qos_profile_sensor_data
    assert QoSPresetProfiles.short_keys()[:2] == ["unknown", "default"]


@pytest.mark.parametrize("kwargs", [{}, {"history": HistoryPolicy.KEEP_LAST}, {"history": 1}])
def test_history_or_depth_is_required(kwargs: dict[str, int]) -> None:
    with pytest.raises(InvalidQoSProfileException):
        QoSProfile(**kwargs)


@pytest.mark.parametrize(
    "kwargs",
    [
        {"depth": "1"},
        {"depth": 1, "reliable": True},
        {"depth": 1, "deadline": 1.0},
        {"depth": 1, "reliability": "reliable"},
        {"depth": 1, "avoid_ros_namespace_conventions": 0},
    ],
)
def test_wrong_arguments_are_refused(kwargs: dict[str, object]) -> None:
    with pytest.raises(AssertionError):
        QoSProfile(**kwargs)


def test_there_are_no_other_policies() -> None:
    with pytest.raises(AttributeError):
        QoSProfile(depth=1).reliabilty = ReliabilityPolicy.RELIABLE  # type: ignore[attr-defined]


def test_numbers_become_policies_and_unknown_numbers_are_refused() -> None:
    assert QoSProfile(depth=1, reliability=2).reliability is ReliabilityPolicy.BEST_EFFORT
    with pytest.raises(ValueError):
        QoSProfile(depth=1, liveliness=2)


def test_a_zero_depth_is_warned_about() -> None:
    with pytest.warns(UserWarning, match="A zero depth with KEEP_LAST"):
        QoSProfile(depth=0)


def test_policy_names() -> None:
    assert DurabilityPolicy.short_keys() == [
        "system_default",
        "transient_local",
        "volatile",
        "unknown",
        "best_available",
    ]
    assert LivelinessPolicy.get_from_short_key("Manual_by_Topic") == 3
    assert LivelinessPolicy.MANUAL_BY_TOPIC.short_key == "manual_by_topic"
    assert qos_policy_name_from_kind(QoSPolicyKind.DEADLINE) == "DEADLINE"


def test_compatibility_follows_the_request_offered_rules() -> None:
    reliabilities = (ReliabilityPolicy.BEST_EFFORT, ReliabilityPolicy.RELIABLE)
    durabilities = (DurabilityPolicy.VOLATILE, DurabilityPolicy.TRANSIENT_LOCAL)
    spans = (Duration(), Duration(seconds=1), Duration(seconds=2))
    kinds = (LivelinessPolicy.AUTOMATIC, LivelinessPolicy.MANUAL_BY_TOPIC)
    choices = list(itertools.product(range(2), range(2), range(3), range(2), range(3)))
    profiles = [
        QoSProfile(
            depth=1,
            reliability=reliabilities[r],
            durability=durabilities[d],
            deadline=spans[s],
            liveliness=kinds[k],
            liveliness_lease_duration=spans[lease],
        )
        for r, d, s, k, lease in choices
    ]

    def serves(offered: int, requested: int) -> bool:
        return requested == 0 or 0 < offered <= requested

    for (pub, offer), (sub, request) in itertools.product(zip(choices, profiles, strict=True), repeat=2):
        problems = [
            pub[0] < sub[0],
            pub[1] < sub[1],
            not serves(pub[2], sub[2]),
            pub[3] < sub[3],
            not serves(pub[4], sub[4]),
        ]
        verdict, reason = qos_check_compatible(offer, request)
        assert verdict == (QoSCompatibility.ERROR if any(problems) else QoSCompatibility.OK)
        assert reason.count("ERROR: ") == reason.count(";") == sum(problems)


def test_what_is_left_to_the_system_is_a_doubt() -> None:
    verdict, reason = qos_check_compatible(
        qos_profile_system_default, QoSProfile(depth=1, liveliness=LivelinessPolicy.AUTOMATIC)
    )
    assert verdict is QoSCompatibility.WARNING
    assert reason == "WARNING: Reliable subscription, but publisher is system_default;"
    verdict, reason = qos_check_compatible(qos_profile_system_default, qos_profile_system_default)
    assert verdict is QoSCompatibility.WARNING
    assert reason.count("WARNING: ") == 3
