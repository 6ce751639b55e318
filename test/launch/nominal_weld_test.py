"""A nominal weld: what comes on the topics, parameters as `ros2 param` sees them, how the processes end, the bag."""

import sys
import unittest
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parent))

from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParameters
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import Temperature
from weld_under_test import (
    TICK_NS,
    Observer,
    WeldUnderTest,
    exit_codes,
    post_shutdown_test,
    stamp_ns,
)

from fsw_analysis.signals import load_weld
from fsw_control import parameters
from fsw_control.common_parameters import hosted
from fsw_decentral.parameters import DecentralParameters
from fsw_msgs.msg import PlantState, ShoulderDepth, SpindleTorque, WeldCommand, WeldReference
from fsw_plant.parameters import PlantParameters
from fsw_scenario.parameters import PlayerParameters
from fsw_supervisor.parameters import SupervisorParameters

WELD = WeldUnderTest(
    "{name: nominal, duration_s: 600.0, plant: {seed: 5}}", ("decentral",), record=True
)
TICKS = 30
FILES = {
    "fsw_plant": PlantParameters,
    "fsw_decentral": hosted(DecentralParameters),
    "fsw_supervisor": SupervisorParameters,
    "fsw_scenario": PlayerParameters,
}


@pytest.mark.launch_test
def generate_test_description():
    return WELD.launch_description()


class TestWeld(unittest.TestCase):
    def test_sensors_tick_at_10_hz_with_one_stamp(self, domain):
        with Observer(domain) as eye:
            topics = {
                "fsw/depth": eye.listen(ShoulderDepth, "fsw/depth"),
                "fsw/spindle_torque": eye.listen(SpindleTorque, "fsw/spindle_torque"),
                "fsw/thermocouple": eye.listen(Temperature, "fsw/thermocouple"),
            }

            def steady():
                """The same stamps of all sensors, 100 ms apart.

                A busy machine may skip a tick now and then.
                """
                shared = set.intersection(
                    *(set(map(stamp_ns, messages)) for messages in topics.values())
                )
                latest = sorted(shared)[-TICKS:]
                return (
                    len(latest) == TICKS and latest[-1] - latest[0] < 1.05 * (TICKS - 1) * TICK_NS
                )

            eye.until(steady, f"{TICKS} ticks in succession")
        for messages in topics.values():
            stamps = [stamp_ns(message) for message in messages]
            self.assertEqual(stamps, sorted(set(stamps)), "one sample per tick")

    def test_every_tick_is_answered_once_by_the_selected_controller(self, domain):
        with Observer(domain) as eye:
            commands = eye.listen(WeldCommand, "fsw/command")
            depths = eye.listen(ShoulderDepth, "fsw/depth")

            def answered():
                """A busy machine may lose ticks, but not for ever."""
                sources = {stamp_ns(command): command.source for command in commands}
                ticks = [ns for ns in map(stamp_ns, depths) if ns <= max(sources, default=0)][
                    -TICKS:
                ]
                return len(ticks) == TICKS and {sources.get(ns) for ns in ticks} == {"decentral"}

            eye.until(answered, f"{TICKS} ticks in succession answered by the controller")
        stamps = [stamp_ns(command) for command in commands]
        self.assertEqual(len(stamps), len(set(stamps)), "one command per tick")

    def test_outputs_are_near_their_references(self, domain):
        latched = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        with Observer(domain) as eye:
            truths = eye.listen(PlantState, "fsw/plant/truth")
            references = eye.listen(WeldReference, "fsw/reference", latched)
            eye.until(lambda: references and len(truths) > TICKS, f"{TICKS} ticks and a reference")
        for truth in truths:
            self.assertAlmostEqual(truth.depth, references[-1].depth, delta=5e-5)
            self.assertAlmostEqual(truth.temperature, references[-1].temperature, delta=3.0)

    def test_all_parts_are_in_the_graph(self, domain):
        expected = {"fsw_plant", "fsw_decentral", "fsw_supervisor", "fsw_recorder", "fsw_scenario"}
        with Observer(domain) as eye:
            eye.until(lambda: expected <= set(eye.node.get_node_names()), f"nodes {expected}")


def specs_of(node):
    return parameters.describe(FILES[node])


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
                listed = eye.call(
                    ListParameters, f"/{node}/list_parameters", ListParameters.Request()
                ).result.names
                self.assertEqual(set(specs_of(node)) - set(listed), set(), node)

    def test_ranges_and_descriptions_are_shown(self, domain):
        with Observer(domain) as eye:
            for node in FILES:
                specs = specs_of(node)
                request = DescribeParameters.Request(names=list(specs))
                shown = eye.call(
                    DescribeParameters, f"/{node}/describe_parameters", request
                ).descriptors
                for spec, descriptor in zip(specs.values(), shown, strict=True):
                    self.assertIn(spec.description, descriptor.description)
                    self.assertEqual(descriptor.read_only, spec.read_only, spec.name)
                    ranges = [*descriptor.floating_point_range, *descriptor.integer_range]
                    self.assertEqual(
                        [(r.from_value, r.to_value) for r in ranges],
                        [spec.range] if spec.range else [],
                    )

    def test_value_in_range_is_taken(self, domain):
        with Observer(domain) as eye:
            result = set_one(eye, "fsw_plant", "sensors.depth_noise_mm", 0.003)
            self.assertTrue(result.successful, result.reason)
            self.assertEqual(
                get_one(eye, "fsw_plant", "sensors.depth_noise_mm").double_value, 0.003
            )

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
        self.assertEqual(
            codes, dict.fromkeys(("recorder", "plant", "decentral", "supervisor", "scenario"), 0)
        )

    def test_bag_is_complete(self, bag):
        weld = load_weld(bag)
        self.assertEqual(weld.problems, [])
        self.assertGreater(len(weld.stamp_ns), TICKS)
        # at the very end the supervisor holds if the controller leaves first
        self.assertGreater(sum(source == "decentral" for source in weld.command_source), TICKS)
        self.assertIn("scenario.yaml", weld.attachments)
