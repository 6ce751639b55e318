"""What the controllers really send of their estimators: SI, with the unit in the name."""

import pytest

from fsw_control import Command, Measurement, Reference, weld
from fsw_control import messages_ros as convert
from fsw_decentral import DecentralController
from fsw_nmpc import NmpcController

_OF_CORE = {
    "force [N]": ("force_kn", 1e3),
    "power [W]": ("power_kw", 1e3),
    "depth [m]": ("depth_mm", 1e-3),
    "temperature [degC]": ("temperature_c", 1.0),
    "torque_scale": ("torque_scale", 1.0),
    "depth_rate [m/s]": ("depth_rate_mm_per_s", 1e-3),
    "temperature_rate [degC/s]": ("temperature_rate_c_per_s", 1.0),
    "depth_gain": ("depth_gain", 1.0),
    "force_deviation [N]": ("force_deviation_kn", 1e3),
    "power_deviation [W]": ("power_deviation_kw", 1e3),
    "torque_scale_deviation": ("torque_scale_deviation", 1.0),
    "depth_deviation [m]": ("depth_deviation_mm", 1e-3),
    "temperature_deviation [degC]": ("temperature_deviation_c", 1.0),
    "depth_rate_deviation [m/s]": ("depth_rate_deviation_mm_per_s", 1e-3),
    "temperature_rate_deviation [degC/s]": ("temperature_rate_deviation_c_per_s", 1.0),
    "depth_gain_deviation": ("depth_gain_deviation", 1.0),
    "copper_temperature [degC]": ("copper_temperature_c", 1.0),
    "attainable_depth [m]": ("attainable_depth_mm", 1e-3),
    "attainable_temperature [degC]": ("attainable_temperature_c", 1.0),
}


@pytest.mark.parametrize("make", [NmpcController, DecentralController])
def test_estimated_disturbances_go_out_in_si(make):
    controller = make()
    applied = Command(weld.FORCE_KN, weld.SPEED_RPM)
    controller.reset(applied)
    reference = Reference(weld.DEPTH_MM, weld.TEMPERATURE_C)
    for k in range(1, 80):  # until the power has moved
        measurement = Measurement(0.1 * k, weld.DEPTH_MM + 0.02, 1030.0, weld.TEMPERATURE_C + 2.0)
        proposal = controller.step(measurement, reference, applied, weld.TICK_S)
        applied = proposal.command
    core = proposal.diagnosis.disturbances
    message = convert.status_message(proposal, 1, controller.name, "", ())
    assert len(message.disturbance_names) == len(core)
    for name, value in zip(message.disturbance_names, message.disturbances, strict=True):
        core_name, factor = _OF_CORE[name]
        assert value == pytest.approx(core[core_name] * factor)
    if make is NmpcController:
        assert set(message.disturbance_names) == set(_OF_CORE)
        assert all(core.values()), "with zeros the units would not show"
