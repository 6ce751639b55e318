"""The node that tells when a running weld leaves its procedure, in a graph."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import rclpy
import yaml
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from rclpy.parameter import Parameter

from fsw_control.cause import Cause
from fsw_control.topics_ros import LATCHED, STREAM
from fsw_msgs.msg import SupervisorState, WeldReference
from fsw_scenario.procedure_node import ProcedureNode, main
from fsw_test_support.judged_weld import short_procedure
from fsw_test_support.ros_graph import Spinner, domain_id

__all__ = ["domain_id"]

pytestmark = pytest.mark.slow


class Cell(Spinner):
    """The node, a controller with parameters, and what the supervisor would publish."""

    def __init__(self, domain: int, procedure: Path) -> None:
        self.context = rclpy.Context()
        rclpy.init(args=[], context=self.context, domain_id=domain)
        super().__init__(self.context)
        override = [Parameter("procedure", value=str(procedure))]
        self.node = ProcedureNode(context=self.context, parameter_overrides=override)
        self.controller = Node("fsw_decentral", context=self.context)
        self.controller.declare_parameter("gain", 2.0)
        self.states = self.controller.create_publisher(
            SupervisorState, "fsw/supervisor/state", LATCHED
        )
        self.references = self.controller.create_publisher(
            WeldReference, "fsw/supervisor/reference", LATCHED
        )
        self.values: dict[str, str] = {}
        self.controller.create_subscription(
            DiagnosticArray, "/diagnostics", self._on_diagnostics, STREAM
        )
        for each_node in (self.node, self.controller):
            self.executor.add_node(each_node)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        line = next(
            status for status in message.status if status.name == "fsw_procedure: deviations"
        )
        self.values = {pair.key: pair.value for pair in line.values}

    def close(self) -> None:
        for each_node in (self.node, self.controller):
            each_node.destroy_node()
        rclpy.shutdown(context=self.context)

    def told(self, **values: str) -> None:
        """Wait for these values of the entry."""
        self.until(lambda: values.items() <= self.values.items(), str(values))


def test_deviations_are_published(domain_id: int, tmp_path: Path) -> None:
    controllers = [{"name": "decentral", "parameters_sha256": "0" * 64}, {"name": "nmpc"}]
    file = tmp_path / "procedure.yaml"
    values = short_procedure(controllers=controllers).model_dump(mode="json", exclude_none=True)
    file.write_text(yaml.safe_dump(values), encoding="utf-8")
    cell = Cell(domain_id, file)
    try:
        cell.told(tuning_decentral="tuning")  # the tuning is not the one that is permitted
        cell.references.publish(WeldReference(depth=0.0035, temperature=816.4))
        cell.told(set_point_depth_mm="set_point", **{"set_point_depth_mm: value": "3.5"})
        cell.references.publish(WeldReference(depth=0.0026, temperature=816.4))
        cell.until(lambda: "set_point_depth_mm" not in cell.values, "the set-point to be back")
        cell.states.publish(
            SupervisorState(actual_controller="decentral", actual_mode="auto", cause=Cause.READY)
        )
        cell.states.publish(
            SupervisorState(
                actual_controller="mine", actual_mode="manual", cause=Cause.OPERATOR_MANUAL
            )
        )
        cell.told(**{"controller: controller": "mine", "mode: mode": "manual"})
        cell.told(**{"code": "leaves", "code: names": "controller, mode, tuning_decentral"})
        sha256 = "tuning_decentral: sha256"
        before = cell.values[sha256]
        cell.controller.set_parameters([Parameter("gain", value=3.0)])
        cell.until(lambda: cell.values.get(sha256, before) != before, "the changed tuning")
        nodes = ("/fsw_decentral", "/cell2/fsw_decentral", "/fsw/decentral", "/decentral")
        assert [node for node in nodes if cell.node.is_of_this_weld(node)] == ["/fsw_decentral"]
    finally:
        cell.close()


def test_unusable_procedure_is_one_line(
    domain_id: int, tmp_path: Path, capsys: pytest.CaptureFixture[Any]
) -> None:
    (tmp_path / "bad.yaml").write_text("format: fsw_weld_procedure\n")
    assert main(["procedure", "--ros-args", "-p", f"procedure:={tmp_path / 'bad.yaml'}"]) == 2
    error = capsys.readouterr().err
    assert "bad.yaml: lacks " in error and "lacks version" in error and error.count("\n") == 1
