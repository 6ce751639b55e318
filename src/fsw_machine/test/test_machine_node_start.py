"""The gateway's node.

Its start where its library is not installed, and limits that its machine cannot take.
"""

import subprocess
import sys

import pytest
import rclpy
from rclpy.parameter import Parameter

pytestmark = pytest.mark.slow


def test_missing_library_error_is_one_line_with_a_remedy():
    pytest.importorskip("cryptography")  # which is imported first
    code = "import sys; sys.modules['asyncua'] = None; import fsw_machine.machine_node"
    ended = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False
    )
    assert ended.returncode == 2 and ended.stderr.startswith("fsw_machine: ")
    assert "asyncua is missing: " in ended.stderr and ended.stderr.count("\n") == 1


def test_limits_that_a_node_of_the_machine_cannot_hold_are_refused(domain_id, shipped_text):
    ua = pytest.importorskip("asyncua.ua")
    from fsw_machine.machine_file import MachineFile
    from fsw_machine.machine_node import MachineNode
    from fsw_machine.opcua_link import MachineLink
    from fsw_machine.parameters import GatewayParameters

    rclpy.init(args=["test", "--ros-args", "-p", "autostart:=false"], domain_id=domain_id)
    node = MachineNode()
    try:
        text = shipped_text.replace("ForceSetpoint, unit: kN", "ForceSetpoint, unit: N, scale: 2")
        node._link = MachineLink(MachineFile.parse(text), GatewayParameters(), print)
        node._link._kinds = {
            "force_setpoint": ua.VariantType.UInt16
        }  # as connecting leaves it: up to 131 kN
        assert node._why_not(node._settings.values | {"limits.force_max_kn": 130.0}) is None
        refused = node.set_parameters([Parameter("limits.force_max_kn", value=140.0)])[0]
        assert not refused.successful
        assert "nodes.force_setpoint" in refused.reason
    finally:
        node._link = None  # it was never started
        node.destroy_node()
        rclpy.shutdown()
