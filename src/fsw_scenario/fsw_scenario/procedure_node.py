"""Reports at once in the diagnostics when a running weld leaves its procedure; no commands."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import Any

from rcl_interfaces.msg import ParameterEvent
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python

from fsw_control import messages_ros as convert
from fsw_control.cause import Cause
from fsw_control.coded import Fact
from fsw_control.light_node_ros import LightNode
from fsw_control.node_main_ros import main_of
from fsw_control.parameters_ros import ParameterValues
from fsw_control.reports_ros import ERROR, OK, DiagnosticsPublisher, Report, log, told
from fsw_control.schema.yaml_text import load_yaml
from fsw_control.topics_ros import LATCHED, STREAM
from fsw_msgs.msg import SupervisorState, WeldReference
from fsw_recorder.parameter_snapshot_ros import ParameterSnapshots
from fsw_scenario.parameters import ProcedureParameters
from fsw_scenario.procedure import ProcedureWatch, load

_REPORT_S = 1.0
#: prefix of the names of controllers' nodes
_PREFIX = "fsw_"


class ProcedureNode(LightNode, Node):  # type: ignore[misc]  # rclpy has no types everywhere
    """Monitors set-points, the supervisor's state and controllers' parameters.

    Raises
    ------
    fsw_control.schema.models.InputError
        If the procedure cannot be used.
    """

    def __init__(self, **arguments: Any) -> None:
        super().__init__("fsw_procedure", **arguments)
        settings = ParameterValues(self, ProcedureParameters)
        self._procedure = load(settings["procedure"])
        self._watch = ProcedureWatch(self._procedure)
        self._told: dict[str, Fact] = {}
        self._tunings: dict[str, dict[str, Any]] = {}
        self._diagnostics = DiagnosticsPublisher(self)
        self._snapshots = ParameterSnapshots(self, self._on_parameters, self.is_of_this_weld)
        self.create_subscription(
            WeldReference, "fsw/supervisor/reference", self._on_reference, LATCHED
        )
        self.create_subscription(SupervisorState, "fsw/supervisor/state", self._on_state, LATCHED)
        self.create_subscription(ParameterEvent, "/parameter_events", self._on_event, STREAM)
        self.create_timer(_REPORT_S, self._report, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self.get_logger().info(
            f"welding by {self._procedure.id} revision {self._procedure.revision}"
        )

    def _on_reference(self, message: WeldReference) -> None:
        try:
            now = convert.reference(message)
        except ValueError:
            return  # the supervisor does not accept such set-points
        self._watch.set_points(now.depth_mm, now.temperature_c)
        self._tell()

    def _on_state(self, message: SupervisorState) -> None:
        self._watch.state(message.actual_controller, message.actual_mode, Cause(message.cause))
        self._tell()

    def is_of_this_weld(self, node: str) -> bool:
        """Whether a node, by its full name, belongs to this weld."""
        home, _, name = node.rpartition("/")
        return home == self.get_namespace().rstrip("/") and name.startswith(_PREFIX)

    def _on_parameters(self, node: str, text: str) -> None:
        self._take(node, load_yaml(text)[node]["ros__parameters"])

    def _on_event(self, message: ParameterEvent) -> None:
        changed = [*message.new_parameters, *message.changed_parameters]
        if message.node in self._tunings:
            self._take(
                message.node,
                {item.name: parameter_value_to_python(item.value) for item in changed},
            )

    def _take(self, node: str, values: Mapping[str, Any]) -> None:
        self._tunings[node] = self._tunings.get(node, {}) | dict(values)
        self._watch.tuning(node.rpartition("/")[2].removeprefix(_PREFIX), self._tunings[node])
        self._tell()

    def _tell(self) -> None:
        """Log and publish changes."""
        now, before = self._watch.deviations, self._told
        for name, fact in now.items():
            if before.get(name) != fact:
                log(self, ERROR, f"the weld leaves its procedure: {fact.words}")
        for name in before.keys() - now.keys():
            log(self, OK, f"the weld keeps its procedure again; over: {before[name].words}")
        if now != before:
            self._told = now
            self._publish()

    def _report(self) -> None:
        self._snapshots.look_for_nodes()
        self._publish()

    def _publish(self) -> None:
        identity = self._procedure.identity
        values: dict[str, object] = {
            "procedure": identity.id,
            "revision": identity.revision,
            "SHA-256": identity.sha256,
        }
        for name, fact in self._told.items():
            values |= told(name, fact)
        level = ERROR if self._told else OK
        self._diagnostics.publish([Report("deviations", level, self._watch.fact, values)])


main = main_of(ProcedureNode, "fsw_procedure", __doc__, ProcedureParameters)


if __name__ == "__main__":
    sys.exit(main())
