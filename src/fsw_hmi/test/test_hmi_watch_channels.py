"""Health of the depth's channels, as messages have it."""

from fsw_control.depth_channels import ChannelHealth
from fsw_control.sensors import DEPTH_CHANNELS
from fsw_hmi.watch_ros import channels_of
from fsw_msgs.msg import ShoulderDepth


def test_health_by_sensor():
    message = ShoulderDepth(channel_health=[0, 5, 200, 0])
    first, second, third, _ = channels_of(message).values()
    assert tuple(channels_of(message)) == tuple(DEPTH_CHANNELS)
    assert (first, second) == (ChannelHealth.GOOD, ChannelHealth.SLIP)
    assert third is ChannelHealth.UNKNOWN  # of a later version


def test_depth_of_one_sensor_has_no_channels():
    assert channels_of(ShoulderDepth(depth=0.00266)) == {}


def test_a_channel_that_the_machine_does_not_have_is_none():
    message = ShoulderDepth(channel_health=[0, 0, int(ChannelHealth.UNKNOWN), 0])
    assert tuple(channels_of(message)) == ("depth_laser", "depth_lvdt_lead", "depth_axial")
