"""The table of the sensors."""

import pytest

from fsw_control import messages_ros as convert
from fsw_control.common_parameters import ControllerParameters
from fsw_control.contract import Measurement
from fsw_control.depth_channels import CHANNELS, ChannelHealth
from fsw_control.parameters import describe
from fsw_control.sensors import DEPTH, DEPTH_CHANNELS, OPTIONAL, REQUIRED, SENSORS
from fsw_msgs.msg import ShoulderDepth


def test_a_measurement_has_the_required_sensors_in_their_order():
    assert Measurement._fields[1 : 1 + len(REQUIRED)] == tuple(
        SENSORS[name].signal for name in REQUIRED
    )
    assert (*REQUIRED, *OPTIONAL) == tuple(SENSORS)


@pytest.mark.parametrize("name", SENSORS)
def test_a_row_fits_its_message_and_contains_no_contradiction(name):
    row = SENSORS[name]
    middle = 0.5 * (row.minimum + row.maximum)
    assert convert.sensor_value(name, convert.sensor_message(name, middle, 1)) == pytest.approx(
        middle
    )
    assert row.quantity.plausible.low <= row.minimum < row.maximum <= row.quantity.plausible.high
    assert (
        0.0 < row.noise <= row.quantity.noise.high
        and row.resolution <= row.quantity.resolution.high
    )
    assert (row.max_jump is None) <= (not row.required)


@pytest.mark.parametrize("field", ["topic", "signal"])
def test_names_are_unique(field):
    assert len({getattr(row, field) for row in SENSORS.values()}) == len(SENSORS)


def test_depth_channels_are_those_of_the_fusion_and_health_is_that_of_the_message():
    assert list(DEPTH_CHANNELS.values()) == list(CHANNELS)
    assert all(SENSORS[name].quantity is DEPTH for name in DEPTH_CHANNELS)
    for health in ChannelHealth:
        assert getattr(ShoulderDepth, health.name) == health


def test_every_sensor_has_parameters_of_its_own():
    specs = describe(ControllerParameters)
    for name, row in SENSORS.items():
        assert specs[f"validity.{name}.noise"].default == row.noise
        assert specs[f"validity.{name}.minimum"].unit == row.quantity.unit
    assert specs["validity.torque.noise"].range == (0.0, 500.0)
