"""Machine files: what is taken, and one line for everything that is wrong."""

import math

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from fsw_machine.machine_file import WRITTEN, MachineFile, Nodes
from fsw_schema.models import InputError

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
    assert list(machine.nodes.given) == required == [*machine.nodes.read, *WRITTEN]
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
    ("nodes.depth.unit", None, "nodes.depth lacks unit"),
    ("nodes.depth.unit", "kN", "nodes.depth.unit is 'kN'; one of mm, m or um"),
    ("nodes.depth.unit", 5, "nodes.depth.unit is 5; one of mm"),
    ("nodes.depth.node", "Weld.Depth", "nodes.depth.node is 'Weld.Depth', not a node id"),
    ("nodes.depth.node", "ns=two;s=Depth", "not a node id"),
    ("nodes.depth.scale", 0, "nodes.depth.scale must not be 0"),
    ("nodes.depth.scale", float("nan"), "nodes.depth.scale is nan, not a finite number"),
    ("nodes.depth.scale", True, "nodes.depth.scale is True, not a number"),
    (
        "nodes.depth.stale_after_s",
        -1.0,
        "nodes.depth.stale_after_s is -1.0: must be greater than 0",
    ),
    ("nodes.depth.untis", "mm", "nodes.depth.untis is an unknown key; did you mean unit?"),
    ("nodes.heartbeat.unit", "s", "nodes.heartbeat.unit is an unknown key; known: node"),
    ("nodes.depht", {"node": "i=1"}, "nodes.depht is an unknown key; did you mean depth?"),
    ("nodes.torque", None, "nodes lacks torque"),
    ("nodes.torque", "i=5", "nodes.torque is 'i=5', not a mapping"),
    ("nodes", [], "nodes is [], not a mapping"),
    ("security", None, "lacks security; for a plain connection write 'security: none'"),
    ("security", "off", "security is 'off', not a mapping"),
    ("security", False, "security is False, not a mapping"),
    (
        "security",
        SECURITY | {"policy": "Basic128"},
        "security.policy is 'Basic128'; one of Basic256Sha256",
    ),
    (
        "security",
        {**SECURITY, "private_key": ""},
        "security.private_key is '', not the name of a file",
    ),
    ("endpoint", "http://plc:4840", "endpoint is not an endpoint; write opc.tcp://host:port/path"),
    ("endpoint", "opc.tcp://plc", "endpoint is not an endpoint"),
    ("endpoint", "opc.tcp://weld:secret@plc:4840", "endpoint is not an endpoint"),
    ("user", {"name": "weld", "password_env": "P"}, "user would send its password unencrypted"),
]


@pytest.mark.parametrize(("path", "value", "words"), WRONG)
def test_one_line_for_what_is_wrong(shipped_text, path, value, words):
    with pytest.raises(InputError) as caught:
        MachineFile.parse(changed(shipped_text, path, value, remove=value is None))
    assert words in str(caught.value)
    assert str(caught.value).startswith("machine.yaml: ") and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("user", "words"),
    [
        (
            {"name": "weld", "password": "secret"},
            "user.password is an unknown key; did you mean password_",
        ),
        ({"name": "weld"}, "user needs either password_file or password_env"),
        ({"name": "weld", "password_env": "P", "password_file": "p"}, "user needs either"),
    ],
)
def test_passwords_are_elsewhere(shipped_text, user, words):
    text = changed(changed(shipped_text, "security", SECURITY), "user", user)
    with pytest.raises(InputError, match=words):
        MachineFile.parse(text)


@pytest.mark.parametrize("text", ["", "5", "nodes: [", "\0", "[]"])
def test_what_is_no_machine_file(text):
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
