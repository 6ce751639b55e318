"""Several welds in one domain: each page shows the faults of its own."""

import pytest
import rclpy

from fsw_control.reports_ros import ERROR, OK, DiagnosticsPublisher, Report
from fsw_hmi.watch_ros import Watch
from fsw_test_support.ros_graph import Spinner

pytestmark = pytest.mark.slow
FINE = Report("process", OK, "all valid", {"thermocouple state": "good"})
FAULT = Report("process", ERROR, "interlock", {"thermocouple state": "not finite"})
WELDS = {"": FINE, "/cell1": FINE, "/cell2": FAULT}


def test_each_page_shows_the_fault_of_its_own_weld_alone(domain_id):
    rclpy.init(args=[], domain_id=domain_id)
    graph = Spinner()
    supervisors = {cell: rclpy.create_node("fsw_supervisor", namespace=cell) for cell in WELDS}
    pages = {cell: rclpy.create_node("fsw_hmi", namespace=cell) for cell in WELDS}
    nodes = (*supervisors.values(), *pages.values())
    try:
        for node in nodes:
            graph.executor.add_node(node)
        publishers = {cell: DiagnosticsPublisher(node) for cell, node in supervisors.items()}
        watches = {cell: Watch(node, *[lambda *_: None] * 2) for cell, node in pages.items()}

        def have_reports():
            for cell, line in WELDS.items():
                publishers[cell].publish([line])
            for _ in range(len(WELDS) ** 2):  # a message for each page from each weld
                graph.spin()
            return all(watch.now.sensor_states for watch in watches.values())

        graph.until(have_reports, "the pages")
        for cell, watch in watches.items():
            shown = watch.parts()
            assert {node: [*parts] for node, parts in shown.items()} == {
                "fsw_supervisor": ["process"]
            }
            assert shown["fsw_supervisor"]["process"].text == WELDS[cell].words
            assert (
                watch.now.sensor_states["thermocouple"] == WELDS[cell].values["thermocouple state"]
            )
    finally:
        for node in nodes:
            node.destroy_node()
        rclpy.shutdown()
