"""What tests of the gateway share.

The machine file that is shipped, and reads of a machine that is well.
"""

from __future__ import annotations

from importlib import resources

import pytest
import yaml

from fsw_control.parameters import defaults
from fsw_control.sensors import DEPTH_CHANNELS
from fsw_control.units import NANOSECONDS
from fsw_machine.machine_file import MachineFile
from fsw_machine.parameters import GatewayParameters
from fsw_machine.samples import CycleRead, RawValue
from fsw_test_support.ros_graph import domain_id

__all__ = ["domain_id"]

START_NS = 1_700_000_000 * NANOSECONDS
TICK_NS = NANOSECONDS // 10
GOOD = {
    "permissive": True,
    "depth": 2.66,
    "torque": 980.0,
    "temperature": 816.4,
    "force_acting": 78.4,
    "speed_acting": 407.5,
    "force_in_force": 78.4,
    "speed_in_force": 407.5,
}


@pytest.fixture(scope="session")
def shipped_text():
    return (resources.files("fsw_machine") / "machine.yaml").read_text()


@pytest.fixture(scope="session")
def machine(shipped_text):
    return MachineFile.parse(shipped_text)


@pytest.fixture(scope="session")
def several_sensors(shipped_text):
    """A machine file with several sensors of the depth."""
    content = yaml.safe_load(shipped_text)
    del content["nodes"]["depth"]
    content["nodes"] |= {
        **{name: {"node": f"s=Weld.{name}", "unit": "mm"} for name in DEPTH_CHANNELS},
        "touch_off": {"node": "s=Weld.TouchOffs"},
        "travel": {"node": "s=Weld.Travel", "unit": "mm"},
    }
    return yaml.safe_dump(content | {"depth_fusion": {}})


@pytest.fixture
def parameters():
    return defaults(GatewayParameters)


@pytest.fixture(scope="session")
def read_of():
    """Makes the read of a cycle, on time and good but for what is given as values (or as whole RawValues)."""

    def make(counter, *, at_s=None, steps=1, source_ns=None, **changed):
        source_ns = START_NS + counter * TICK_NS if source_ns is None else source_ns
        values = {
            name: value if isinstance(value, RawValue) else RawValue(value, source_ns=source_ns)
            for name, value in (GOOD | changed).items()
        }
        return CycleRead(
            counter, values, source_ns, counter * 0.1 if at_s is None else at_s, source_ns, steps
        )

    return make
