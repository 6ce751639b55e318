"""Machine files: what is taken, and one line for everything that is wrong."""

import math

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from fsw_control.schema.models import InputError
from fsw_control.sensors import DEPTH_CHANNELS
from fsw_machine.machine_file import WRITTEN, MachineFile, Nodes

SECURITY = {
    "policy": "Basic256Sha256",
    "certificate": "c.der",
    "private_key": "k.pem",
    "server_certificate": "s.der",
}


def changed(text, path, value=None, remove=False):
    """The text of a machine file with one entry (dotted) set or removed."""
    content = yaml.safe_load(text)
    *above, last = path.split(".")
    section = content
    for key in above:
        section = section[key]
    if remove:
        del section[last]
    else:
        section[last] = value
    return yaml.safe_dump(content)


def test_the_shipped_file_names_every_node(machine):
    required = [name for name, field in Nodes.model_fields.items() if field.is_required()]
    assert list(machine.nodes.given) == [*machine.nodes.read, *WRITTEN]
    assert {*machine.nodes.given} == {*required, "depth"}
    assert machine.security is None and machine.user is None


@pytest.mark.parametrize(
    ("name", "unit", "number", "inside"),
    [
        ("depth", "m", 0.00266, 2.66),
        ("depth", "um", 2660.0, 2.66),
        ("torque", "kN m", 0.98, 980.0),
        ("temperature", "K", 1089.55, 816.4),
        ("force_acting", "N", 78400.0, 78.4),
        ("speed_setpoint", "rad/s", 10 * math.pi, 300.0),
        ("speed_in_force", "1/s", 5.0, 300.0),
    ],
)
def test_units(shipped_text, name, unit, number, inside):
    spec = MachineFile.parse(changed(shipped_text, f"nodes.{name}.unit", unit)).nodes[name]
    assert spec.inside(number) == pytest.approx(inside)
    assert spec.number(inside) == pytest.approx(number)


@given(
    scale=st.floats(1e-3, 1e3) | st.floats(-1e3, -1e-3),
    offset=st.floats(-1e3, 1e3),
    number=st.floats(-1e5, 1e5),
)
def test_scale_and_offset_are_undone_when_written(scale, offset, number):
    content = {
        name: {"node": "i=1"} for name, field in Nodes.model_fields.items() if field.is_required()
    }
    content["depth"] = {"node": "i=1"}
    for name, unit in (("depth", "mm"), ("torque", "N m"), ("temperature", "K")):
        content[name]["unit"] = unit
    for name in ("acting", "in_force", "setpoint"):
        content[f"force_{name}"]["unit"], content[f"speed_{name}"]["unit"] = "kN", "rpm"
    content["temperature"] |= {"scale": scale, "offset": offset}
    text = yaml.safe_dump({"endpoint": "opc.tcp://plc:4840", "security": "none", "nodes": content})
    spec = MachineFile.parse(text).nodes["temperature"]
    assert spec.inside(number) == pytest.approx(scale * number + offset - 273.15, abs=1e-6)
    assert spec.number(spec.inside(number)) == pytest.approx(number, abs=1e-5 / abs(scale) + 1e-6)


WRONG = [
    ("nodes.depth.unit", None, "missing", ""),
    ("nodes.depth.unit", "kN", "literal_error", "'mm', 'm' or 'um'"),
    ("nodes.depth.unit", 5, "literal_error", "'mm', 'm' or 'um'"),
    ("nodes.depth.node", "Weld.Depth", "value_error", "node id"),
    ("nodes.depth.node", "ns=two;s=Depth", "value_error", "node id"),
    ("nodes.depth.scale", 0, "value_error", "be 0"),
    ("nodes.depth.scale", float("nan"), "finite_number", ""),
    ("nodes.depth.scale", True, "float_type", ""),
    ("nodes.depth.stale_after_s", -1.0, "greater_than", "than 0"),
    ("nodes.depth.untis", "mm", "extra_forbidden", "mean unit?"),
    ("nodes.heartbeat.unit", "s", "extra_forbidden", "known: node"),
    ("nodes.depht", {"node": "i=1"}, "extra_forbidden", "mean depth?"),
    ("nodes.torque", None, "missing", ""),
    ("nodes.torque", "i=5", "model_type", ""),
    ("nodes", [], "model_type", ""),
    ("security", "off", "model_type", ""),
    ("security", False, "model_type", ""),
    ("endpoint", "http://plc:4840", "value_error", "opc.tcp://host:port/path"),
    ("endpoint", "opc.tcp://plc", "value_error", "opc.tcp://host:port/path"),
    ("endpoint", "opc.tcp://weld:secret@plc:4840", "value_error", "without user"),
    ("user", {"name": "weld", "password_env": "P"}, "problem", "give security"),
]


@pytest.mark.parametrize(("path", "value", "kind", "fact"), WRONG)
def test_invalid_machine_file_error_is_one_line(shipped_text, path, value, kind, fact):
    with pytest.raises(InputError) as caught:
        MachineFile.parse(changed(shipped_text, path, value, remove=value is None))
    assert caught.value.problems == ((path, kind),)
    text = str(caught.value)
    assert text.startswith("machine.yaml: ") and fact in text and "\n" not in text


def test_the_depth_is_one_node_or_fused_of_several(shipped_text, several_sensors):
    assert MachineFile.parse(several_sensors).depth_sensors == tuple(DEPTH_CHANNELS)
    for text, path, value, place in (
        (shipped_text, "nodes.depth", None, "nodes"),
        (several_sensors, "depth_fusion", None, "nodes"),
        (several_sensors, "nodes.touch_off", None, "nodes"),
        (several_sensors, "nodes.depth", {"node": "i=1", "unit": "mm"}, "nodes.depth"),
        (shipped_text, "depth_fusion", {}, "nodes.depth"),
    ):
        with pytest.raises(InputError) as caught:
            MachineFile.parse(changed(text, path, value, remove=value is None))
        assert caught.value.problems == ((place, "problem"),)


@pytest.mark.parametrize(
    ("value", "path", "kind", "fact"),
    [
        (None, "", "value_error", "'security: none'"),
        (
            SECURITY | {"policy": "Basic128"},
            "security.policy",
            "literal_error",
            "Basic256Sha256",
        ),
        (SECURITY | {"private_key": ""}, "security.private_key", "value_error", "a file"),
    ],
)
def test_security_is_given_as_a_whole_or_as_none(shipped_text, value, path, kind, fact):
    with pytest.raises(InputError) as caught:
        MachineFile.parse(changed(shipped_text, "security", value, remove=value is None))
    assert caught.value.problems == ((path, kind),) and fact in str(caught.value)


@pytest.mark.parametrize(
    ("user", "words"),
    [
        (
            {"name": "weld", "password": "secret"},
            "password_",
        ),
        ({"name": "weld"}, "password_file or password_env"),
        ({"name": "weld", "password_env": "P", "password_file": "p"}, "user needs"),
    ],
)
def test_passwords_are_elsewhere(shipped_text, user, words):
    text = changed(changed(shipped_text, "security", SECURITY), "user", user)
    with pytest.raises(InputError, match=words):
        MachineFile.parse(text)


@pytest.mark.parametrize("text", ["", "5", "nodes: [", "\0", "[]"])
def test_unreadable_machine_file_is_rejected(text):
    with pytest.raises(InputError) as caught:
        MachineFile.parse(text)
    assert "\n" not in str(caught.value)


def test_a_file_that_cannot_be_read(tmp_path):
    with pytest.raises(InputError, match="cannot read"):
        MachineFile.load(tmp_path / "none.yaml")


def test_paths_are_relative_to_the_file(shipped_text, tmp_path):
    content = yaml.safe_load(changed(shipped_text, "security", SECURITY))
    content["user"] = {"name": "weld", "password_file": "secret"}
    (tmp_path / "m.yaml").write_text(yaml.safe_dump(content))
    loaded = MachineFile.load(tmp_path / "m.yaml")
    assert loaded.security.certificate == tmp_path / "c.der"
    assert loaded.user.password_file == tmp_path / "secret"
