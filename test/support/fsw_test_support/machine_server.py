"""A machine to test with.

An OPC UA server on top of the plant emulator, which keeps the contract of a PLC.

Ten times a second it measures, writes the values and then the cycle counter. It takes force and
speed when the heartbeat is written after them. It refuses what is out of its own limits, what it
has not permitted and what does not answer one of its last cycles. Without commands its watchdog
holds and then lowers the force.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import errno
import json
import logging
import signal
import sys
import time
from collections.abc import Sequence
from datetime import UTC, datetime
from importlib import resources
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit, urlunsplit

from asyncua import Server, ua
from asyncua.common.utils import ServiceError
from asyncua.crypto.permission_rules import User as Role
from asyncua.crypto.permission_rules import UserRole
from cryptography import x509

from fsw_control import Command, weld
from fsw_control.command_gate import refusal
from fsw_control.schema.models import InputError
from fsw_control.sensors import SENSORS
from fsw_control.units import NANOSECONDS
from fsw_machine.certificates import SecurityError, check_key, der, now, read_certificate
from fsw_machine.machine_file import WRITTEN, MachineFile
from fsw_machine.opcua_link import node_id, password
from fsw_plant import PlantConfig, PlantEmulator, PlantSchedule
from fsw_test_support.certificates import make

#: an operator's switch: whether commands are permitted; in the namespace of the machine file
SWITCH = "s=Weld.PermissiveSwitch"
#: the machine file that the gateway takes, too, where it is given none
MACHINE_FILE = Path(str(resources.files("fsw_machine") / "machine.yaml"))
SERVER_URI = "urn:fsw-control:machine-server"
CLIENT_URI = "urn:fsw-control:fsw_machine"
_TYPES = {
    "cycle": ua.VariantType.UInt32,
    "heartbeat": ua.VariantType.UInt32,
    "permissive": ua.VariantType.Boolean,
    "touch_off": ua.VariantType.UInt32,
}
#: cycles of which stamp and time of writing are known
_KEPT = 50


class MachineServer:
    """The emulated machine; nodes, units and security are those of a machine file.

    Parameters
    ----------
    machine : MachineFile
    plant : PlantEmulator
    server_key : Path, optional
        Private key of the file's server certificate; needed with security.
    endpoint : str, optional
        Instead of the file's.
    permissive : bool
        What the operator's switch says at the start.

    Attributes
    ----------
    latencies_s : dict of int to float
        For each counter value that a command answered, the time from writing it to the heartbeat.
    begun_s : list of float
        When each cycle's counter was written (steady clock).
    taken : list of (int, Command, Command)
        Commands taken, with the counter that they answer, and what was in force before.
    counter : int
        The cycle counter.
    permissive : bool
        Whether commands are permitted.
    clock_offset_ns : int
        Source timestamps less the local clock; to be set by tests.
    is_open : bool
        Whether it serves.
    """

    def __init__(
        self,
        machine: MachineFile,
        plant: PlantEmulator,
        server_key: Path | None = None,
        endpoint: str = "",
        permissive: bool = True,
    ) -> None:
        self._machine, self.plant, self._server_key = machine, plant, server_key
        self.endpoint = endpoint or machine.endpoint
        self.latencies_s: dict[int, float] = {}
        self.begun_s: list[float] = []
        self.taken: list[tuple[int, Command, Command]] = []
        self.clock_offset_ns = 0
        self.counter = 0
        self.is_open = False
        self.permissive = permissive
        self._wanted: dict[str, float] = {}
        self._largest_move = 1.0
        self._cycles: dict[int, tuple[int, float]] = {}
        self._server = Server(user_manager=_Users(machine))
        self._ids: dict[str, ua.NodeId] = {}
        self._setter: Any = None

    async def open(self) -> None:
        """Make the nodes and listen.

        Raises
        ------
        SecurityError, OSError
            When certificates cannot be used, or the port is taken.
        """
        server, machine = self._server, self._machine
        self._check_key()
        await server.init()
        server.set_endpoint(self.endpoint)
        await server.set_application_uri(SERVER_URI)
        await self._secure()
        server.set_identity_tokens(
            [ua.AnonymousIdentityToken if machine.user is None else ua.UserNameIdentityToken]
        )
        index = await server.register_namespace(machine.namespace) if machine.namespace else 0
        self._ids = {name: node_id(spec, index) for name, spec in machine.nodes.given.items()}
        self._ids["switch"] = ua.NodeId.from_string(f"ns={index};{SWITCH}")
        for name, identifier in self._ids.items():
            kind = _TYPES.get(
                name, ua.VariantType.Boolean if name == "switch" else ua.VariantType.Double
            )
            start = (
                self.permissive
                if name == "switch"
                else False
                if kind is ua.VariantType.Boolean
                else 0
            )
            node = await server.nodes.objects.add_variable(
                identifier, str(identifier.Identifier), start, kind
            )
            if name in (*WRITTEN, "switch"):
                await node.set_writable()
        self._setter = server.iserver.aspace.write_attribute_value
        server.iserver.aspace.write_attribute_value = self._on_write
        await self._measure()
        await server.start()
        self.is_open = True

    def _check_key(self) -> None:
        security, key = self._machine.security, self._server_key
        if security is None:
            if key is not None:
                raise SecurityError(
                    "--server-key: useless, because the machine file says security: none"
                )
            return
        if key is None:
            raise SecurityError("--server-key: needed, because the machine file asks for security")
        file = security.server_certificate
        certificate = read_certificate("security.server_certificate", file, now())
        check_key("--server-key", key, certificate, f"security.server_certificate {file}")

    async def _secure(self) -> None:
        security = self._machine.security
        if security is None:
            self._server.set_security_policy([ua.SecurityPolicyType.NoSecurity])
            return
        trusted = security.certificate.read_bytes()

        async def validate(certificate: x509.Certificate, _: ua.ApplicationDescription) -> None:
            if der(certificate) != trusted:
                raise ServiceError(ua.StatusCodes.BadCertificateUntrusted)
            if now() > certificate.not_valid_after_utc:
                raise ServiceError(ua.StatusCodes.BadCertificateTimeInvalid)

        await self._server.load_certificate(str(security.server_certificate))
        await self._server.load_private_key(str(self._server_key))
        self._server.iserver.certificate_validator = validate
        policy = ua.SecurityPolicyType[f"{security.policy}_SignAndEncrypt"]
        self._server.set_security_policy([policy])

    async def run(self) -> None:
        """Cycle until cancelled, on the steady clock and without drift; then close the server."""
        begin_s, cycle = time.monotonic(), 0
        try:
            while True:
                cycle += 1
                await asyncio.sleep(max(0.0, begin_s + cycle * weld.TICK_S - time.monotonic()))
                self.plant.step()
                await self._measure()
        finally:
            await self._server.stop()
            self.is_open = False

    async def _measure(self) -> None:
        """Measure, write the values, then the counter."""
        stamp_ns = time.time_ns() + self.clock_offset_ns
        reading = self.plant.measure()
        self.counter += 1
        for name, samples in reading.samples.items():
            if (stem := SENSORS[name].stem) not in self._ids:
                continue
            for (
                sample_ns,
                value,
            ) in samples:  # none while a sensor drops out: the node keeps its old timestamp
                await self._show(stem, value, stamp_ns - (reading.stamp_ns - sample_ns))
        await self._show("permissive", self.permissive, stamp_ns)
        acting, in_force = reading.drives, self.plant.applied
        core = self.plant.core
        for name, value in (
            ("touch_off", 1),
            ("travel", core.travel_mm),
            ("angle", core.angle_deg),
            ("force_acting", acting.force_kn),
            ("speed_acting", acting.speed_rpm),
            ("force_in_force", in_force.force_kn),
            ("speed_in_force", in_force.speed_rpm),
        ):
            if name in self._ids:
                await self._show(name, value, stamp_ns)
        await self._show("cycle", self.counter, stamp_ns)
        begun_s = time.monotonic()
        self.begun_s.append(begun_s)
        self._cycles[self.counter] = (reading.stamp_ns, begun_s)
        self._cycles.pop(self.counter - _KEPT, None)

    async def _show(self, name: str, inside: float, stamp_ns: int) -> None:
        """Write a value, given in the unit inside, in the unit of the file."""
        kind = _TYPES.get(name, ua.VariantType.Double)
        number = inside if name in _TYPES else self._machine.nodes[name].number(inside)
        stamp = datetime.fromtimestamp(stamp_ns / 1e9, UTC)
        value = ua.DataValue(
            ua.Variant(number, kind), SourceTimestamp=stamp, ServerTimestamp=stamp
        )
        await self._setter(self._ids[name], ua.AttributeIds.Value, value)

    # ---------------------------------------------------------------- what clients write

    async def _on_write(
        self, node: ua.NodeId, attribute: ua.AttributeIds, value: ua.DataValue
    ) -> ua.StatusCode:
        status: ua.StatusCode = await self._setter(node, attribute, value)
        name = next((name for name, known_id in self._ids.items() if known_id == node), "")
        if not status.is_good() or attribute != ua.AttributeIds.Value or value.Value is None:
            return status
        if name == "switch":
            self.permissive = bool(value.Value.Value)
        elif name in ("force_setpoint", "speed_setpoint"):
            return self._want(name, float(value.Value.Value))
        elif name == "heartbeat":
            return self._take(int(value.Value.Value))
        return status

    def _want(self, name: str, number: float) -> ua.StatusCode:
        """Note a set-point, unless it is out of the machine's own limits."""
        self._wanted.pop(name, None)
        inside = self._machine.nodes[name].inside(number)
        other = self.plant.applied
        requested = (
            Command(inside, other.speed_rpm)
            if name == "force_setpoint"
            else Command(other.force_kn, inside)
        )
        if refusal(requested, self.plant.config.limits) is not None:
            return ua.StatusCode(ua.StatusCodes.BadOutOfRange)
        self._wanted[name] = inside
        return ua.StatusCode()

    def _take(self, heartbeat: int) -> ua.StatusCode:
        """Take force and speed over, if both came and they answer one of the last cycles."""
        requested, self._wanted = self._wanted, {}
        known = self._cycles.get(heartbeat)
        if not self.permissive or len(requested) < 2 or known is None:
            return ua.StatusCode(ua.StatusCodes.BadInvalidState)
        stamp_ns, begun_s = known
        command = Command(requested["force_setpoint"], requested["speed_setpoint"])
        before = self.plant.applied
        if self.plant.apply(command, stamp_ns):
            return ua.StatusCode(ua.StatusCodes.BadInvalidState)
        self.latencies_s[heartbeat] = time.monotonic() - begun_s
        self.taken.append((heartbeat, command, before))
        self._note_move(command, before)
        return ua.StatusCode()

    def _note_move(self, command: Command, before: Command) -> None:
        """Print the largest move of the set-points so far, in moves of a tick, where it is more than one."""
        moves = moves_between(command, before)
        if moves > self._largest_move + 1e-6:
            self._largest_move = moves
            print(f"largest move so far: {moves:.3f}", flush=True)


def moves_between(first: Command, other: Command) -> float:
    """Distance of two commands, in largest moves of a tick."""
    force = abs(first.force_kn - other.force_kn) / weld.FORCE_STEP_KN
    return max(force, abs(first.speed_rpm - other.speed_rpm) / weld.SPEED_STEP_RPM)


class _Users:
    """Lets in the user of the machine file, or, without one, everybody."""

    def __init__(self, machine: MachineFile) -> None:
        self._name = "" if machine.user is None else machine.user.name
        self._password = "" if machine.user is None else password(machine.user)

    def get_user(
        self, server: Any, username: str | None = None, password: str | None = None, **_: Any
    ) -> Role | None:
        """The role of who logs in; None: refused."""
        if self._name and (username != self._name or password != self._password):
            return None
        return Role(role=UserRole.User)


def make_certificates(folder: Path, hosts: Sequence[str] = ("localhost", "127.0.0.1")) -> str:
    """Make test certificates of both sides; returns the lines for the machine file."""
    make(folder, "client", CLIENT_URI, hosts)
    make(folder, "server", SERVER_URI, hosts)
    names = {
        "certificate": "client.der",
        "private_key": "client_key.pem",
        "server_certificate": "server.der",
    }
    lines = [f"  {key}: {(folder / name).resolve()}" for key, name in names.items()]
    return "\n".join(["security:", "  policy: Basic256Sha256", *lines])


def parser() -> argparse.ArgumentParser:
    """Command line of the test machine."""
    made = argparse.ArgumentParser(
        prog="run_machine_server.py", description=(__doc__ or "").partition("\n")[0]
    )
    made.add_argument(
        "--machine-file",
        type=Path,
        metavar="FILE",
        help="nodes, units, security; default: machine.yaml",
    )
    made.add_argument(
        "--port", type=int, help="instead of the port of the machine file's endpoint"
    )
    made.add_argument(
        "--server-key",
        type=Path,
        metavar="FILE",
        help="key of the server certificate, with security",
    )
    made.add_argument(
        "--scenario",
        default="",
        metavar="FILE",
        help="timed disturbances and faults of the emulated plant",
    )
    made.add_argument("--seed", type=int, default=1, help="of the sensor noise")
    made.add_argument(
        "--not-permissive",
        action="store_true",
        help=f"start with the operator's switch ({SWITCH}) off",
    )
    made.add_argument(
        "--clock-step-s",
        type=float,
        default=0.0,
        metavar="S",
        help="at SIGUSR1 the clock of the stamps steps by this, and back",
    )
    made.add_argument(
        "--report",
        type=Path,
        metavar="FILE",
        help="at the end, write begin and latency of each cycle as JSON",
    )
    made.add_argument(
        "--make-certificates", type=Path, metavar="DIR", help="make test certificates, and end"
    )
    return made


async def serve(arguments: argparse.Namespace) -> None:
    """Run the machine until SIGINT or SIGTERM."""
    file = arguments.machine_file or MACHINE_FILE
    machine = MachineFile.load(file)
    parts = urlsplit(machine.endpoint)
    endpoint = urlunsplit(
        parts._replace(netloc=f"{parts.hostname}:{arguments.port or parts.port}")
    )
    config = PlantConfig.from_values({"seed": arguments.seed})
    plant = PlantEmulator(config, PlantSchedule.from_text_or_file(arguments.scenario))
    server = MachineServer(
        machine, plant, arguments.server_key, endpoint, not arguments.not_permissive
    )
    await server.open()
    print(
        f"machine serves {endpoint}, "
        f"{'plain' if machine.security is None else machine.security.policy}",
        flush=True,
    )
    task = asyncio.ensure_future(server.run())

    def step_clock() -> None:
        server.clock_offset_ns = (
            0 if server.clock_offset_ns else round(arguments.clock_step_s * NANOSECONDS)
        )

    asyncio.get_running_loop().add_signal_handler(signal.SIGUSR1, step_clock)
    for number in (signal.SIGINT, signal.SIGTERM):
        asyncio.get_running_loop().add_signal_handler(number, task.cancel)
    with contextlib.suppress(asyncio.CancelledError):
        await task
    if arguments.report:
        figures = {
            "begun_s": server.begun_s,
            "latencies_s": [server.latencies_s.get(k + 1) for k in range(server.counter)],
        }
        arguments.report.write_text(json.dumps(figures), encoding="utf-8")


def main() -> int:
    """Run the test machine, or make certificates; returns the exit code."""
    logging.getLogger("asyncua").setLevel(logging.CRITICAL + 1)
    arguments = parser().parse_args()
    try:
        if arguments.make_certificates:
            print(make_certificates(arguments.make_certificates))
        else:
            asyncio.run(serve(arguments))
    except (InputError, SecurityError, OSError) as error:
        busy = isinstance(error, OSError) and error.errno == errno.EADDRINUSE
        hint = "; end the other server, or choose another --port" if busy else ""
        print(f"run_machine_server.py: {error}{hint}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
