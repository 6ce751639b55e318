"""Parameters of the nodes as `ros2 param list`, `describe`, `get` and `set` see them."""

import sys
import unittest
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parent))

from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParameters
from rclpy.parameter import Parameter
from weld_under_test import Observer, WeldUnderTest, exit_codes, post_shutdown_test

from fsw_control import parameters

WELD = WeldUnderTest("{name: parameters, duration_s: 600.0}", ("decentral",))
FILES = {
    "fsw_plant": [("fsw_plant", "plant.yaml")],
    "fsw_decentral": [("fsw_control", "controller.yaml"), ("fsw_decentral", "decentral.yaml")],
    "fsw_supervisor": [("fsw_supervisor", "supervisor.yaml")],
    "fsw_scenario": [("fsw_scenario", "player.yaml")],
}


@pytest.mark.launch_test
def generate_test_description():
    return WELD.launch_description()


def specs_of(node):
    return {name: spec for file in FILES[node] for name, spec in parameters.load(*file).items()}


def set_one(eye, node, name, value):
    request = SetParameters.Request(parameters=[Parameter(name, value=value).to_parameter_msg()])
    return eye.call(SetParameters, f"/{node}/set_parameters", request).results[0]


def get_one(eye, node, name):
    request = GetParameters.Request(names=[name])
    return eye.call(GetParameters, f"/{node}/get_parameters", request).values[0]


class TestParameters(unittest.TestCase):
    def test_every_parameter_is_listed(self, domain):
        with Observer(domain) as eye:
            for node in FILES:
                listed = eye.call(ListParameters, f"/{node}/list_parameters", ListParameters.Request()).result.names
                self.assertEqual(set(specs_of(node)) - set(listed), set(), node)

    def test_ranges_and_descriptions_are_shown(self, domain):
        with Observer(domain) as eye:
            for node in FILES:
                specs = specs_of(node)
                request = DescribeParameters.Request(names=list(specs))
                shown = eye.call(DescribeParameters, f"/{node}/describe_parameters", request).descriptors
                for spec, descriptor in zip(specs.values(), shown, strict=True):
                    self.assertIn(spec.description, descriptor.description)
                    self.assertEqual(descriptor.read_only, spec.read_only, spec.name)
                    ranges = [*descriptor.floating_point_range, *descriptor.integer_range]
                    self.assertEqual([(r.from_value, r.to_value) for r in ranges], [spec.range] if spec.range else [])

    def test_value_in_range_is_taken(self, domain):
        with Observer(domain) as eye:
            result = set_one(eye, "fsw_plant", "sensors.depth_noise_mm", 0.003)
            self.assertTrue(result.successful, result.reason)
            self.assertEqual(get_one(eye, "fsw_plant", "sensors.depth_noise_mm").double_value, 0.003)

    def test_bad_values_are_refused_with_a_reason(self, domain):
        bad = (
            ("fsw_plant", "sensors.depth_noise_mm", -1.0, "double_value"),  # out of range
            ("fsw_plant", "noise", 3, "bool_value"),  # of another type
            ("fsw_plant", "clock", "simulated", "string_value"),  # read-only
            ("fsw_decentral", "tuning", "brave", "string_value"),  # none of the options
            ("fsw_supervisor", "deadline_s", 7.0, "double_value"),  # out of range
        )
        with Observer(domain) as eye:
            for node, name, value, field in bad:
                before = getattr(get_one(eye, node, name), field)
                result = set_one(eye, node, name, value)
                self.assertFalse(result.successful, f"{node} {name} took {value}")
                self.assertNotEqual(result.reason, "")
                self.assertEqual(getattr(get_one(eye, node, name), field), before)


@post_shutdown_test()
class TestAfterShutdown(unittest.TestCase):
    def test_all_have_ended_cleanly(self, proc_info):
        codes = exit_codes(proc_info)
        codes.pop("scenario")
        self.assertEqual(codes, dict.fromkeys(("plant", "decentral", "supervisor"), 0))
