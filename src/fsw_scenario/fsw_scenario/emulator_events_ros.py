"""Disturbances and faults of a scenario that the emulated plant did not get at its start."""

from __future__ import annotations

from rclpy.node import Node
from rclpy.task import Future

from fsw_control.weld import TICK_S
from fsw_plant import PlantSchedule
from fsw_plant.events import Disturbance, PlantEvent
from fsw_plant.services_ros import SERVICES, event_request
from fsw_scenario.scenario import Scenario


def emulator_listens(node: Node) -> bool:
    """Whether the plant in a node's namespace is the emulator."""
    name = node.resolve_service_name(SERVICES[True][1])
    return any(service == name for service, _ in node.get_service_names_and_types())


class EmulatorEvents:
    """Requests each event from the emulated plant, a tick before it begins."""

    def __init__(self, node: Node, scenario: Scenario) -> None:
        self._node = node
        self._schedule = PlantSchedule.of(scenario.events)
        self._clients = {kind: node.create_client(*service) for kind, service in SERVICES.items()}

    def send_until(self, tick: int) -> None:
        """Request all events up to a tick."""
        for event in self._schedule.due(tick * TICK_S):
            self._send(event)

    def _send(self, event: PlantEvent) -> None:
        client = self._clients[isinstance(event, Disturbance)]
        if not client.service_is_ready():
            self._node.get_logger().error(
                f"{event} is left out: there is no emulated plant any more"
            )
            return

        def on_answer(future: Future) -> None:
            answer = future.result()
            if answer is not None and not answer.ok:
                self._node.get_logger().error(f"{event}: {answer.message}")

        client.call_async(event_request(event)).add_done_callback(on_answer)

    def destroy(self) -> None:
        """Leave the graph."""
        for client in self._clients.values():
            self._node.destroy_client(client)
