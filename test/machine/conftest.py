"""The whole chain at the emulated machine."""

import sys
from importlib import resources
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parent))

from machine_weld import GRAPH, MachineWeld

from fsw_control.free_domain import free_domain
from fsw_scenario.launcher import Launcher
from fsw_test_support import machine_server
from fsw_test_support.machine import Proxy, RunningMachine, free_port, write_machine_file
from fsw_test_support.waiting import PATIENCE_S

OTHER_UNITS = {
    "depth": "m",
    "torque": "kN m",
    "temperature": "K",
    **dict.fromkeys(("force_acting", "force_in_force", "force_setpoint"), "N"),
    **dict.fromkeys(("speed_acting", "speed_in_force", "speed_setpoint"), "rad/s"),
}


@pytest.fixture(scope="module")
def shipped_text():
    return (resources.files("fsw_machine") / "machine.yaml").read_text()


@pytest.fixture(scope="module")
def secured(tmp_path_factory, shipped_text):
    """Machine file parts with certificates, a user and other units."""
    folder = tmp_path_factory.mktemp("certificates")
    machine_server.make_certificates(folder)
    names = {
        "certificate": "client.der",
        "private_key": "client_key.pem",
        "server_certificate": "server.der",
    }
    (folder / "password").touch(0o600)
    (folder / "password").write_text("stir")
    security = {"policy": "Basic256Sha256"} | {
        key: str(folder / name) for key, name in names.items()
    }
    units = {f"nodes__{name}__unit": unit for name, unit in OTHER_UNITS.items()}
    return folder, {
        "security": security,
        "user": {"name": "fsw", "password_file": str(folder / "password")},
    } | units


@pytest.fixture
def weld(tmp_path, shipped_text, secured):
    """A weld with security and SI units, and a proxy between gateway and machine.

    No command in it is a bump.

    Each test has its own: what a test breaks ends in a safe stop, after which the copper cools.
    """
    keys, parts = secured
    port = free_port()
    machine = RunningMachine(
        write_machine_file(tmp_path / "server.yaml", port, shipped_text, **parts),
        keys / "server_key.pem",
    )
    proxy = Proxy(port)
    file = write_machine_file(tmp_path / "machine.yaml", proxy.port, shipped_text, **parts)
    with free_domain() as domain, Launcher(tmp_path / "log", domain, PATIENCE_S) as launcher:
        weld = MachineWeld(domain, launcher, machine, file)
        weld.proxy = proxy
        weld.start(*GRAPH)
        weld.runs()
        first = len(weld.taken())
        yield weld
        weld.runs(more=3)
        weld.assert_no_bump(first)
        weld.close()
        lives = {name for name, child in launcher.children.items() if child.running}
        codes = {name: code for name, code in launcher.stop().items() if name in lives}
        proxy.stop()
        machine.stop()
        assert set(codes.values()) == {0}, codes
