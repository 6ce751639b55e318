"""Fixtures: the plant's node and a peer in a DDS domain of their own.

What stands for a reduced canister.
"""

from __future__ import annotations

import numpy as np
import pytest

from fsw_control.fence import Signature
from fsw_control.stop import Stop
from fsw_plant.canister import CanisterParameters
from fsw_plant.core import PlantCore
from fsw_plant.process import CanisterTables
from fsw_test_support.ros_graph import Spinner, domain_id
from fsw_test_support.waiting import PATIENCE_S

__all__ = ["domain_id"]
C_PER_KJ = 0.1  #: by which a block is warmer


class Graph(Spinner):
    """The plant's node, started with given parameters, and a peer that hears and answers it."""

    def __init__(self, domain):
        self.domain = domain
        self.plant = self.peer = None

    def start(self, *arguments, answer=None, connected=True, **parameters):
        """Start the plant with ROS arguments and parameters (``__`` for the dot), and wait for its first tick."""
        import rclpy

        from fsw_plant.plant_node import PlantNode

        patient = {"discovery_s": 0.0, "lockstep_timeout_s": PATIENCE_S, "lockstep_give_up_s": 0.0}
        overrides = patient | {
            name.replace("__", "."): value for name, value in parameters.items()
        }
        settings = [
            text for name, value in overrides.items() for text in ("-p", f"{name}:={value}")
        ]
        rclpy.init(args=["test", "--ros-args", *arguments, *settings], domain_id=self.domain)
        self.peer = Peer(rclpy.create_node("peer", use_global_arguments=False), answer)
        super().__init__()
        self.executor.add_node(self.peer.node)
        self.plant = PlantNode()
        self.executor.add_node(self.plant)
        if connected:
            self.until(
                lambda: all(
                    self.peer.got[name] for name in ("depth", "torque", "temperature", "truth")
                )
            )
        return self.peer

    def stop(self):
        """End all."""
        import rclpy

        for node in (self.plant, self.peer and self.peer.node):
            if node is not None:
                node.destroy_node()
        rclpy.try_shutdown()


class Peer:
    """Hears everything that the plant publishes.

    ``answer(number, stamp)`` is called when a tick is complete.
    """

    def __init__(self, node, answer):
        from diagnostic_msgs.msg import DiagnosticArray
        from rclpy.qos import QoSProfile, ReliabilityPolicy
        from rosgraph_msgs.msg import Clock
        from sensor_msgs.msg import Temperature

        from fsw_msgs.msg import PlantState, ShoulderDepth, SpindleTorque, WeldCommand

        self.node = node
        self.got = {
            name: []
            for name in ("depth", "torque", "temperature", "truth", "diagnostics", "clock")
        }
        self.answer, self.stop = answer, Stop()
        stream = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
        for name, kind, topic in (
            ("depth", ShoulderDepth, "fsw/depth"),
            ("torque", SpindleTorque, "fsw/spindle_torque"),
            ("truth", PlantState, "fsw/plant/truth"),
            ("diagnostics", DiagnosticArray, "/diagnostics"),
        ):
            node.create_subscription(kind, topic, self.got[name].append, stream)
        node.create_subscription(
            Clock,
            "/clock",
            self.got["clock"].append,
            QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT),
        )
        # The thermocouple is published last: when it is here, the tick is complete.
        node.create_subscription(Temperature, "fsw/thermocouple", self._on_temperature, stream)
        self.commands = node.create_publisher(WeldCommand, "fsw/command", stream)

    def _on_temperature(self, message):
        self.got["temperature"].append(message)
        if self.answer is not None:
            self.answer(len(self.got["temperature"]), message.header.stamp)

    def command(self, stamp, force_kn=78.4, speed_rpm=407.576, source="test", healthy=True):
        """Publish a command that answers the measurement of a stamp.

        ``stop`` is the copy of the stop register.
        """
        from fsw_control import Command
        from fsw_control.messages_ros import command_message, sign, stamp_ns

        message = command_message(Command(force_kn, speed_rpm), stamp_ns(stamp), source, healthy)
        sign(message, Signature(stop=self.stop))
        self.commands.publish(message)

    def stamps(self, name):
        """Stamps of what came on a topic, in ns."""
        headers = [m.clock if name == "clock" else m.header.stamp for m in self.got[name]]
        return [stamp.sec * 1_000_000_000 + stamp.nanosec for stamp in headers]

    def report(self, part):
        """Last diagnostics of one part of the plant, or None."""
        for array in reversed(self.got["diagnostics"]):
            for status in array.status:
                if status.name == f"fsw_plant: {part}":
                    return status
        return None


@pytest.fixture
def graph(domain_id):
    """A graph in a domain that no other test on this machine uses now."""
    graph = Graph(domain_id)
    yield graph
    graph.stop()


class Block(CanisterTables):
    """A canister that is a block without losses: one state, the heat in it [kJ].

    Notes how the tool moves.
    """

    def __init__(self):
        p, grid_c = CanisterParameters(), np.array([-73.0, 1500.0])
        tables = {
            "decay": np.zeros((1, 1)),
            "transport": np.zeros((1, 0)),
            "axial_mm": np.linspace(p.lowest_mm, p.highest_mm, 4),
            "source": np.ones((4, 1)),  # 1 kW makes 1 kJ/s
            "rim": np.full((4, 1), C_PER_KJ),
            "rest": np.zeros(4),
            "theta_k": grid_c - p.ambient_c,
            "grid_c": grid_c,
        }
        super().__init__(p, tables)
        self.moved = []

    def note(self, field):
        self.moved.append(
            (round(field.memory.traverse_mm_per_s, 9), round(field.memory.axial_mm, 9))
        )


@pytest.fixture
def block(monkeypatch):
    """A block in the place of the canister of all plants."""
    canister, heat_up, advance = Block(), PlantCore.equilibrium, PlantCore.advance

    def noted_start(core, *arguments):
        start = heat_up(core, *arguments)
        canister.note(core._heated)
        return start

    def noted(core, *arguments):
        words = advance(core, *arguments)
        canister.note(core.field)
        return words

    monkeypatch.setattr(PlantCore, "equilibrium", noted_start)
    monkeypatch.setattr(PlantCore, "advance", noted)
    monkeypatch.setattr("fsw_plant.core.reduced", lambda parameters, progress=None: canister)
    monkeypatch.setattr("fsw_plant.process.reduced", lambda parameters, progress=None: canister)
    return canister
