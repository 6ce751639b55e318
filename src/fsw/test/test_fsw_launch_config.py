"""The parameter file and the layouts fit the nodes and the messages."""

import json
import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest
import yaml

from fsw_control import parameters
from fsw_control.common_parameters import hosted
from fsw_control.diagnostic_names import qualified
from fsw_decentral.parameters import DecentralParameters
from fsw_hmi.parameters import HmiParameters
from fsw_machine.parameters import GatewayParameters
from fsw_nmpc.parameters import NmpcParameters
from fsw_plant.parameters import PlantParameters
from fsw_recorder.parameters import RecorderParameters
from fsw_supervisor.parameters import SupervisorParameters

CONFIG = Path(__file__).resolve().parents[1] / "config"
FILES = {
    "fsw_plant": PlantParameters,
    "fsw_machine": GatewayParameters,
    "fsw_decentral": hosted(DecentralParameters),
    "fsw_nmpc": hosted(NmpcParameters),
    "fsw_supervisor": SupervisorParameters,
    "fsw_recorder": RecorderParameters,
    "fsw_hmi": HmiParameters,
}
SECTIONS = yaml.safe_load((CONFIG / "weld.yaml").read_text(encoding="utf-8"))
#: what an operator wants to see: field by topic
SHOWN = {
    "/fsw/depth": "depth",
    "/fsw/thermocouple": "temperature",
    "/fsw/spindle_torque": "torque",
    "/fsw/reference": "depth",
    "/fsw/command": "axial_force",
    "/fsw/supervisor/state": "actual_controller",
    "/fsw/nmpc/status": "solve_time",
}


def flat(values, prefix=""):
    for name, value in values.items():
        if isinstance(value, dict):
            yield from flat(value, f"{prefix}{name}.")
        else:
            yield prefix + name, value


@pytest.mark.parametrize("section", SECTIONS)
def test_parameter_file_has_the_defaults_of_the_nodes(section):
    node = section.removeprefix("/**/")
    model = FILES[node]
    values = dict(flat(SECTIONS[section]["ros__parameters"]))
    assert parameters.validate(model, values) == parameters.defaults(model)


def message_fields(topic):
    """Names of the fields of a topic's message, with those of nested messages."""
    import importlib

    kinds = {
        "/fsw/depth": "ShoulderDepth",
        "/fsw/spindle_torque": "SpindleTorque",
        "/fsw/reference": "WeldReference",
    }
    kinds |= {"/fsw/command": "WeldCommand", "/fsw/supervisor/state": "SupervisorState"}
    kinds |= {"/fsw/plant/truth": "PlantState"}
    last = topic.rpartition("/")[2]
    kind = kinds.get(topic) or {"status": "ControllerStatus", "proposal": "WeldCommand"}.get(last)
    module, kind = (
        ("sensor_msgs.msg", "Temperature")
        if topic == "/fsw/thermocouple"
        else ("fsw_msgs.msg", kind)
    )
    return set(getattr(importlib.import_module(module), kind).get_fields_and_field_types())


def assert_shows(paths):
    """Every path names a field that is there, and all that an operator wants are among them."""
    shown = {}
    for path in paths:
        topic, _, field = path.partition("|")
        assert re.split(r"[./]", field)[0] in message_fields(topic), path
        shown.setdefault(topic, set()).add(field)
    for topic, field in SHOWN.items():
        assert field in shown.get(topic, ()), (topic, field)


def test_plotjuggler_layout_shows_fields_that_exist():
    root = ElementTree.parse(CONFIG / "plotjuggler_weld.xml").getroot()
    curves = [curve.get("name") for curve in root.iter("curve")]
    assert all(curves)
    paths = [
        re.sub(
            r"^(/fsw/(?:depth|thermocouple|spindle_torque|reference|command|\w+/\w+))/", r"\1|", c
        )
        for c in curves
    ]
    # PlotJuggler draws numbers; who is in command is a text there, shown by each controller's flag
    # instead
    assert_shows([*paths, "/fsw/supervisor/state|actual_controller"])
    assert {"/fsw/decentral/status|selected", "/fsw/nmpc/status|selected"} <= set(paths)
    docked = {area.get("name") for area in root.iter("DockArea")}
    assert len(docked) >= 6


def test_foxglove_layout_shows_fields_that_exist():
    layout = json.loads((CONFIG / "foxglove_weld.json").read_text(encoding="utf-8"))
    panels = layout["configById"]
    paths = [path["value"] for panel in panels.values() for path in panel.get("paths", [])]
    assert_shows([re.sub(r"^((?:/\w+)+)\.", r"\1|", path) for path in paths])

    def leaves(node):
        return (
            [node] if isinstance(node, str) else [*leaves(node["first"]), *leaves(node["second"])]
        )

    assert sorted(leaves(layout["layout"])) == sorted(panels)


def analyzers(values):
    for value in values.values():
        if isinstance(value, dict):
            if "contains" in value:
                yield value["path"], value["contains"]
            yield from analyzers(value.get("analyzers", value))


def test_every_report_has_one_analyzer_in_any_namespace():
    content = yaml.safe_load((CONFIG / "diagnostic_analyzers.yaml").read_text(encoding="utf-8"))
    by_name = dict(analyzers(content["/**"]["ros__parameters"]))
    reporting = [*(node for node in FILES if node != "fsw_hmi"), "fsw_monitor"]
    for namespace in ("/", "/cell1"):
        for node in reporting:
            name = f"{qualified(namespace, node)}: part"
            assert sum(text in name for texts in by_name.values() for text in texts) == 1, name
    assert sum(map(len, by_name.values())) == len(reporting)
