"""The whole chain at the emulated machine, one for each file of tests."""

import sys
from importlib import resources
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parent))

from machine_weld import GRAPH, MachineWeld

from fsw_control import weld as weld_numbers
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
    names = {"certificate": "client.der", "private_key": "client_key.pem", "server_certificate": "server.der"}
    (folder / "password").touch(0o600)
    (folder / "password").write_text("stir")
    security = {"policy": "Basic256Sha256"} | {key: str(folder / name) for key, name in names.items()}
    units = {f"nodes__{name}__unit": unit for name, unit in OTHER_UNITS.items()}
    return folder, {"security": security, "user": {"name": "fsw", "password_file": str(folder / "password")}} | units


@pytest.fixture(scope="module")
def chain(tmp_path_factory, shipped_text, secured):
    """Everything, with security and SI units, and a proxy between gateway and machine."""
    folder = tmp_path_factory.mktemp("weld")
    keys, parts = secured
    port = free_port()
    machine = RunningMachine(
        write_machine_file(folder / "server.yaml", port, shipped_text, **parts), keys / "server_key.pem"
    )
    proxy = Proxy(port)
    file = write_machine_file(folder / "machine.yaml", proxy.port, shipped_text, **parts)
    with free_domain() as domain, Launcher(folder / "log", domain, PATIENCE_S) as launcher:
        weld = MachineWeld(domain, launcher, machine, file)
        weld.proxy = proxy
        weld.start(*GRAPH)
        yield weld
        weld.close()
        codes = launcher.stop()
        proxy.stop()
        machine.stop()
        assert set(codes.values()) == {0}, codes


@pytest.fixture
def weld(chain):
    """The chain with all parts running; afterwards no command has been a bump."""
    for name in GRAPH:
        if not chain.launcher.children[name].running:
            chain.start(name)
    chain.runs()
    chain.until(lambda: abs(chain.temperature_c() - weld_numbers.TEMPERATURE_C) < 40.0, "the process to settle")
    first = len(chain.taken())
    yield chain
    chain.runs(more=3)
    chain.assert_no_bump(first)
