"""The OPC UA client: asyncio in its own thread, with a small interface to the node's thread."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError as FutureCancelledError
from dataclasses import dataclass
from typing import Any

from asyncua import Client, ua
from asyncua.crypto import security_policies

from fsw_control import weld
from fsw_control.common_parameters import DriveLimits
from fsw_machine import certificates
from fsw_machine.certificates import SecurityError
from fsw_machine.gateway import Order
from fsw_machine.machine_file import WRITTEN, MachineFile, NodeSpec, Security, User
from fsw_machine.node_check import (
    WHOLE,
    LinkError,
    check_clock,
    check_nodes,
    check_whole_numbers,
    epoch_ns,
    raw_value,
)
from fsw_machine.parameters import GatewayParameters, Reconnect
from fsw_machine.samples import CycleRead, CycleTracker

#: time limit of requests while connecting, when a server may be busy with keys [s]
_CONNECT_TIMEOUT_S = 5.0
#: how long a server keeps the session of a killed client; many servers have few sessions [ms]
_SESSION_MS = 20_000
#: time limit for closing the session [s]
_END_S = 1.0


#: beginnings of status codes that concern the user, and our own certificate
_USER = ("BadUser", "BadIdentityToken")
_OWN_CERTIFICATE = ("BadCertificate", "BadSecurityChecksFailed", "BadSecurityModeRejected")


@dataclass(frozen=True, slots=True)
class Connected:
    """A session exists; nodes and rights are checked."""


@dataclass(frozen=True, slots=True)
class Lost:
    """No connection: the reason, and the time to the next attempt [s]."""

    reason: str
    retry_s: float


@dataclass(frozen=True, slots=True)
class Stalled:
    """The cycle counter has not changed for this time."""

    age_s: float


@dataclass(frozen=True, slots=True)
class Written:
    """The server's answer to an order; ``failure`` is empty on success, ``took_s`` the delay."""

    order: Order
    failure: str
    took_s: float


Event = Connected | Lost | Stalled | Written | CycleRead


def back_off(settings: Reconnect) -> Iterator[float]:
    """Waiting times between attempts: exponential back-off up to a maximum."""
    wait_s = settings.first_s
    while True:
        yield wait_s
        wait_s = min(2.0 * wait_s, max(settings.first_s, settings.max_s))


class MachineLink:
    """Connects, reads every cycle, writes orders, and reconnects, until it is stopped.

    ``deliver`` gets every event, in the link's thread.
    """

    def __init__(
        self, machine: MachineFile, settings: GatewayParameters, deliver: Callable[[Event], None]
    ) -> None:
        self._machine, self.settings, self._deliver = machine, settings, deliver
        self.tracker = CycleTracker(weld.TICK_S)
        self._client: Client | None = None
        self._kinds: dict[str, ua.VariantType] = {}
        self._nodes: dict[str, ua.NodeId] = {}
        self._loop = asyncio.new_event_loop()
        self._task: asyncio.Task[None] | None = None
        self._writes: set[asyncio.Task[None]] = set()
        self._thread = threading.Thread(target=self._run_loop, name="opcua", daemon=True)
        for name in ("asyncua", "asyncio"):
            # failures are reported here, in one line
            logging.getLogger(name).setLevel(logging.CRITICAL + 1)

    def start(self) -> None:
        """Start connecting."""
        self._thread.start()

    def stop(self) -> None:
        """Close the session and end the thread."""
        with contextlib.suppress(RuntimeError):
            self._loop.call_soon_threadsafe(self._cancel)
        self._thread.join(3.0 * _END_S)

    def write(self, order: Order) -> None:
        """Write an order; a ``Written`` follows, unless the connection is lost."""
        with contextlib.suppress(RuntimeError, FutureCancelledError):  # the loop has ended
            self._loop.call_soon_threadsafe(self._begin_write, order)

    def check(self, limits: DriveLimits) -> None:
        """Raise a `LinkError` if a connected node cannot hold every value within these limits."""
        check_whole_numbers(self._machine, self._kinds, limits)

    # ---------------------------------------------------------------- in the thread

    def _run_loop(self) -> None:
        asyncio.set_event_loop(self._loop)
        try:
            self._task = self._loop.create_task(self._run())
            with contextlib.suppress(asyncio.CancelledError):
                self._loop.run_until_complete(self._task)
        finally:
            self._loop.close()

    def _cancel(self) -> None:
        if self._task is not None:
            self._task.cancel()

    async def _run(self) -> None:
        waits_s = back_off(self.settings.reconnect)
        while True:
            try:
                await self._connect()
                waits_s = back_off(self.settings.reconnect)
                self._deliver(Connected())
                await self._follow()
            except Exception as error:
                wait_s = next(waits_s)
                self._deliver(Lost(words(error, self._machine), wait_s))
                await self._disconnect()
                await asyncio.sleep(wait_s)
            finally:
                await self._disconnect()

    async def _connect(self) -> None:
        machine = self._machine
        client = Client(machine.endpoint, timeout=_CONNECT_TIMEOUT_S, watchdog_intervall=3600.0)
        client.name = client.description = "fsw_machine"
        client.session_timeout = _SESSION_MS
        if machine.security is not None:
            await secure(client, machine, machine.security)
        if machine.user is not None:
            client.set_user(machine.user.name)
            client.set_password(password(machine.user))
        self._client = client
        try:
            await client.connect()
        except AssertionError:
            # asyncua fails on servers that refuse the secure channel with a ServiceFault
            text = f"endpoint {machine.endpoint} refuses the secure channel"
            if (security := machine.security) is not None:
                text += "; most likely our security.certificate "
                text += f"{security.certificate} is not in its trust list"
            raise LinkError(text) from None
        index = 0
        if machine.namespace:
            uris = await client.get_namespace_array()
            if machine.namespace not in uris:
                text = f"{machine.namespace}; it has {', '.join(uris)}"
                raise LinkError(f"namespace: the server has no {text}")
            index = uris.index(machine.namespace)
        self._nodes = {name: node_id(spec, index) for name, spec in machine.nodes.given.items()}
        self._kinds = await check_nodes(client, machine, self._nodes, self.settings.limits)
        self.tracker.values = WHOLE[self._kinds["heartbeat"]]

    async def _disconnect(self) -> None:
        client, self._client = self._client, None
        for write in self._writes:
            write.cancel()
        if client is None:
            return
        # Do not wait long for an answer: the cable may be unplugged.
        with contextlib.suppress(Exception):
            await asyncio.wait_for(asyncio.shield(client.disconnect()), _END_S)
        protocol = client.uaclient.protocol
        if protocol is not None and protocol.transport is not None:
            # aborted, so that nothing sent into a broken connection is delivered later
            protocol.transport.abort()

    # ---------------------------------------------------------------- reading

    async def _follow(self) -> None:
        """Read once per cycle until that fails."""
        names = self._machine.nodes.read
        nodes = [ua.ReadValueId(self._nodes[name], ua.AttributeIds.Value) for name in names]
        request = ua.ReadParameters(
            TimestampsToReturn=ua.TimestampsToReturn.Source, NodesToRead=nodes
        )
        changed_s = reported_s = time.monotonic()
        checked = self.settings.clock.stamps == "received"
        while True:
            assert self._client is not None
            timeout_s = self.settings.request_timeout_s
            answers = await asyncio.wait_for(self._client.uaclient.read(request), timeout_s)
            read_s = time.monotonic()
            counter = answers[0].Value.Value if answers[0].Value is not None else None
            # without a valid counter nothing is published or written; a bool is none
            whole = type(counter) is int and answers[0].StatusCode.is_good()
            steps = self.tracker.see(int(counter or 0), read_s) if whole else None
            if steps is not None:
                if answers[0].SourceTimestamp is None:
                    text = "without a source timestamp; the server must send one with each value"
                    raise LinkError(f"nodes.cycle: {text}")
                changed_s = reported_s = read_s
                values = dict(zip(names, map(raw_value, answers), strict=True))
                source_ns = epoch_ns(answers[0].SourceTimestamp)
                if not checked:  # later clock steps are tolerated, see Stamps
                    check_clock(source_ns)
                    checked = True
                times = source_ns, read_s, time.time_ns()
                self._deliver(CycleRead(int(counter or 0), values, *times, steps))
            elif read_s - reported_s > self.settings.cycle_timeout_s:
                reported_s = read_s
                self._deliver(Stalled(read_s - changed_s))
            await asyncio.sleep(max(0.0, self.tracker.next_poll_s(read_s) - time.monotonic()))

    # ---------------------------------------------------------------- writing

    def _begin_write(self, order: Order) -> None:
        task = self._loop.create_task(self._write(order))
        self._writes.add(task)
        task.add_done_callback(self._writes.discard)

    async def _write(self, order: Order) -> None:
        """Write set-points and heartbeat in one request, the heartbeat last."""
        client, begin_s = self._client, time.monotonic()
        if client is None or begin_s - order.accepted_s > weld.TICK_S:
            self._deliver(Written(order, "it could not be sent within its cycle", 0.0))
            return
        try:
            numbers = (order.force, order.speed, order.heartbeat)
            values = [
                ua.DataValue(_variant(number, self._kinds[name]))
                for name, number in zip(WRITTEN, numbers, strict=True)
            ]
            request = ua.WriteParameters(
                NodesToWrite=[
                    ua.WriteValue(self._nodes[name], ua.AttributeIds.Value, Value=value)
                    for name, value in zip(WRITTEN, values, strict=True)
                ]
            )
            timeout_s = self.settings.request_timeout_s
            results = await asyncio.wait_for(client.uaclient.write(request), timeout_s)
            refused = [
                f"{name}: {result.name}"
                for name, result in zip(WRITTEN, results, strict=True)
                if not result.is_good()
            ]
            failure = f"refused by the machine: {', '.join(refused)}" if refused else ""
        except asyncio.CancelledError:
            raise
        except Exception as error:
            failure = words(error, self._machine)
        self._deliver(Written(order, failure, time.monotonic() - begin_s))


async def secure(client: Client, machine: MachineFile, security: Security) -> None:
    """Check the certificates and the server's endpoints, and set the client's security.

    asyncua itself accepts expired certificates and compares the server's late, so both checks are
    made here first.
    """
    client.application_uri, pinned = certificates.check(security, certificates.now())
    kind = getattr(security_policies, f"SecurityPolicy{security.policy}")
    endpoints = await client.connect_and_get_server_endpoints()
    offered = [end for end in endpoints if end.SecurityPolicyUri == kind.URI]
    offered = [end for end in offered if end.SecurityMode == ua.MessageSecurityMode.SignAndEncrypt]
    if not offered:
        kinds = {(str(end.SecurityPolicyUri), end.SecurityMode.name) for end in endpoints}
        names = [f"{uri.rpartition('#')[2]}/{mode}" for uri, mode in sorted(kinds)]
        raise SecurityError(
            f"security.policy: {machine.endpoint} does not offer "
            f"{security.policy}/SignAndEncrypt; "
            f"it offers {', '.join(names)}"
        )
    if not (offered[0].ServerCertificate or b"").startswith(certificates.der(pinned)):
        raise SecurityError(
            "security.server_certificate: the server's certificate is not "
            f"{security.server_certificate} (SHA-1 {certificates.thumbprint(pinned)}); "
            "if it is known to have a new one, copy that into the file"
        )
    own = str(security.certificate), str(security.private_key)
    await client.set_security(kind, *own, server_certificate=str(security.server_certificate))


def password(user: User) -> str:
    """Read the user's password from its file or environment variable."""
    if user.password_file is None:
        text = os.environ.get(user.password_env, "")
        if not text:
            text = f"the environment variable {user.password_env} is not set"
            raise SecurityError(f"user.password_env: {text}")
        return text
    try:
        text = certificates.secret("user.password_file", user.password_file).decode().strip()
    except UnicodeDecodeError:
        text = f"{user.password_file} is not UTF-8 text"
        raise SecurityError(f"user.password_file: {text}") from None
    if not text:
        raise SecurityError(f"user.password_file: {user.password_file} is empty")
    return text


def node_id(spec: NodeSpec, namespace: int) -> ua.NodeId:
    """The node's id, in the given namespace if it names none."""
    text = spec.node if spec.node.startswith("ns=") else f"ns={namespace};{spec.node}"
    return ua.NodeId.from_string(text)


def _variant(number: float, kind: ua.VariantType) -> Any:
    """A number in its node's type; the heartbeat wraps around like the cycle counter."""
    return ua.Variant(round(number) if kind in WHOLE else float(number), kind)


def words(error: BaseException, machine: MachineFile) -> str:
    """Text of an error of the connection, in one line."""
    url = f"endpoint {machine.endpoint}"
    if isinstance(error, LinkError | SecurityError):
        return str(error)
    if isinstance(error, ua.UaStatusCodeError):
        is_known = type(error) is not ua.UaStatusCodeError
        name = type(error).__name__ if is_known else f"status {error.code:#010x}"
        if name.startswith(_USER):
            if machine.user is None:
                return f"user: {url} requires a user ({name}); give user.name and its password"
            source = machine.user.password_file or f"the variable {machine.user.password_env}"
            user = repr(machine.user.name)
            return f"user: {url} rejects {user} with the password in {source} ({name})"
        if name.startswith(_OWN_CERTIFICATE) and machine.security is not None:
            text = f"{url} does not accept our security.certificate {machine.security.certificate}"
            return f"{text} ({name}); put it into the server's trust list"
        if name in ("BadSecurityPolicyRejected", "BadSecurityModeInsufficient"):
            return f"security: {url} rejects it ({name}); check the server's configuration"
        return f"{url}: {name}"
    if machine.security is None and "No matching endpoints" in str(error):
        return f"security: {url} requires security; give policy, certificate, ..."
    if isinstance(error, TimeoutError):
        return f"{url}: no answer in time"
    if isinstance(error, OSError):
        return f"{url}: no connection ({error.strerror or error or type(error).__name__})"
    return f"{url}: {type(error).__name__}: {' '.join(str(error).split())[:200]}"
