"""The OPC UA client against the test machine.

Reads, writes, security, and one line for everything that is wrong.
"""

import queue
import socket
import time
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime, timedelta
from itertools import islice

import pytest
from asyncua.common.utils import Buffer
from asyncua.ua.ua_binary import variant_from_binary, variant_to_binary

from fsw_control import Command
from fsw_machine import certificates
from fsw_machine.certificates import SecurityError
from fsw_machine.gateway import Gateway
from fsw_machine.machine_file import MachineFile, User
from fsw_machine.node_check import WHOLE
from fsw_machine.opcua_link import (
    Connected,
    Lost,
    MachineLink,
    Stalled,
    Written,
    _variant,
    back_off,
    password,
)
from fsw_machine.parameters import Clock, GatewayParameters, Reconnect
from fsw_machine.samples import CycleRead, CycleTracker
from fsw_test_support import machine_server
from fsw_test_support.certificates import make
from fsw_test_support.machine import Proxy, RunningMachine, free_port, write_machine_file
from fsw_test_support.machine_server import CLIENT_URI, SERVER_URI
from fsw_test_support.waiting import PATIENCE_S, wait_until

SETTINGS = GatewayParameters(
    request_timeout_s=10.0, cycle_timeout_s=0.3, reconnect=Reconnect(first_s=0.1, max_s=0.2)
)


class Linked:
    """A link and what it delivers."""

    def __init__(self, file, settings):
        self.machine = MachineFile.load(file)
        self.events = queue.Queue()
        self.link = MachineLink(self.machine, settings, self.events.put)
        self.link.start()

    def next(self, kind):
        """The next event of a kind."""
        while not isinstance(event := self.events.get(timeout=PATIENCE_S), kind):
            pass
        return event


@pytest.fixture
def connect():
    """Makes links that end with the test."""
    made = []

    def make(file, **changes):
        made.append(Linked(file, SETTINGS.changed(**changes)))
        return made[-1]

    yield make
    for link in made:
        link.link.stop()


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("machine")


@pytest.fixture(scope="module")
def plain(folder, shipped_text):
    """A machine without security; returns it and its port."""
    port = free_port()
    running = RunningMachine(write_machine_file(folder / "plain.yaml", port, shipped_text))
    yield running, port
    running.stop()


@pytest.fixture(scope="module")
def secured(folder, shipped_text):
    """A machine with security and a user; returns it, its port and its file's additions."""
    hosts = ["localhost", "127.0.0.1"]
    made = {name: make(folder, name, CLIENT_URI, hosts) for name in ("client", "other")}
    start = datetime.now(UTC) - timedelta(days=9)
    made["expired"] = make(folder, "expired", CLIENT_URI, hosts, days=3, start=start)
    made["server"] = make(folder, "server", SERVER_URI, hosts)
    for name, text in (("password", "stir\n"), ("wrong", "weld\n")):
        (folder / name).touch(0o600)
        (folder / name).write_text(text)
    security = {
        "policy": "Basic256Sha256",
        "certificate": str(made["client"][0]),
        "private_key": str(made["client"][1]),
        "server_certificate": str(made["server"][0]),
    }
    user = {"name": "fsw", "password_file": "password"}
    port = free_port()
    file = write_machine_file(
        folder / "secured.yaml", port, shipped_text, security=security, user=user
    )
    running = RunningMachine(file, made["server"][1])
    yield running, port, {"security": security, "user": user}
    running.stop()


def told(connect, folder, port, text, **changes):
    """What the link says of a machine file that does not fit."""
    return (
        connect(write_machine_file(folder / "changed.yaml", port, text, **changes))
        .next(Lost)
        .reason
    )


@pytest.mark.slow
def test_every_cycle_is_read_once_and_an_order_is_taken(
    connect, plain, folder, shipped_text, parameters
):
    running, port = plain
    linked = connect(write_machine_file(folder / "good.yaml", port, shipped_text))
    linked.next(Connected)
    gateway = Gateway(linked.machine, parameters)
    gateway.on_connected()
    reads = [linked.next(CycleRead) for _ in range(8)]
    counters = [read.counter for read in reads]
    assert counters == sorted(set(counters))
    out = gateway.on_read(reads[-1])
    assert 2.5 < out.values["depth"] < 2.8 and gateway.samples["depth"].fault == ""
    order = gateway.on_command(out.drives, out.stamp_ns, "test", True, reads[-1].read_s)
    linked.link.write(order)
    answer = linked.next(Written)
    assert answer.failure == "" and answer.order is order
    assert running.server.taken[-1][0] == reads[-1].counter


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changes", "entry", "fact"),
    [
        ({"nodes__depth__node": "s=Weld.Dept"}, "nodes.depth", "node s=Weld.Dept"),
        ({"nodes__depth__node": "s=Weld.Permissive"}, "nodes.depth", "type Boolean,"),
        ({"nodes__permissive__node": "s=Weld.Depth"}, "nodes.permissive", "type Double,"),
        ({"nodes__cycle__node": "s=Weld.Depth"}, "nodes.cycle", "type Double,"),
        ({"nodes__depth__node": "ns=0;i=85"}, "nodes.depth", "no value"),
        ({"nodes__depth__node": "ns=0;i=2255"}, "nodes.depth", "ns=0;i=2255 is"),
        (
            {"nodes__cycle__node": "ns=0;i=2267"},  # ServiceLevel
            "nodes.heartbeat",
            "nodes.cycle, Byte",
        ),
        ({"nodes__heartbeat__node": "s=Weld.Cycle"}, "nodes.heartbeat", "be written"),
        ({"namespace": "urn:other"}, "namespace", "no urn:other"),
    ],
)
def test_nodes_that_do_not_fit(connect, plain, folder, shipped_text, changes, entry, fact):
    reason = told(connect, folder, plain[1], shipped_text, **changes)
    assert reason.startswith(f"{entry}: ") and fact in reason


@pytest.mark.slow
def test_clock_at_1601_is_reported_or_irrelevant(connect, plain, folder, shipped_text):
    running, port = plain
    since = datetime(1970, 1, 1) - datetime(1601, 6, 1)
    running.do(
        lambda server: setattr(
            server, "clock_offset_ns", -time.time_ns() - round(since.total_seconds() * 1e9)
        )
    )
    before = running.server.counter
    wait_until(lambda: running.server.counter > before + 1, "a cycle with this clock")
    try:
        assert "year 1601" in told(connect, folder, port, shipped_text)
        connect(
            write_machine_file(folder / "old.yaml", port, shipped_text),
            clock=Clock(stamps="received"),
        ).next(CycleRead)
    finally:
        running.do(lambda server: setattr(server, "clock_offset_ns", 0))


@pytest.mark.slow
def test_no_server(connect, folder, shipped_text):
    linked = connect(write_machine_file(folder / "none.yaml", free_port(), shipped_text))
    waits = [linked.next(Lost) for _ in range(3)]
    assert "no connection" in waits[0].reason
    assert [wait.retry_s for wait in waits] == [0.1, 0.2, 0.2]


@pytest.mark.slow
def test_with_certificates_and_password(connect, secured, folder, shipped_text):
    _, port, additions = secured
    linked = connect(write_machine_file(folder / "good.yaml", port, shipped_text, **additions))
    linked.next(Connected)
    linked.next(CycleRead)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (
            {"security__server_certificate": "other.der"},
            "security.server_certificate: the server's certificate is not",
        ),
        (
            {"security__certificate": "other.der", "security__private_key": "other_key.pem"},
            "security.certificate",
        ),
        (
            {"security__certificate": "expired.der", "security__private_key": "expired_key.pem"},
            "expired on",
        ),
        ({"security__private_key": "other_key.pem"}, "security.private_key: "),
        ({"security__policy": "Aes256Sha256RsaPss"}, "security.policy: "),
        ({"user__password_file": "wrong"}, "user: "),
        ({"user__password_file": "none"}, "user.password_file: "),
    ],
)
def test_security_that_does_not_fit(connect, secured, folder, shipped_text, changes, words):
    _, port, additions = secured
    content = {"security": dict(additions["security"]), "user": dict(additions["user"])}
    for name, value in changes.items():
        section, key = name.split("__")
        content[section][key] = value
    reason = told(connect, folder, port, shipped_text, **content)
    assert words in reason and "\n" not in reason
    assert not {"stir", "weld"} & set(reason.split())


@pytest.mark.slow
def test_a_secured_server_does_not_let_in_a_plain_client(connect, secured, folder, shipped_text):
    assert told(connect, folder, secured[1], shipped_text).startswith("security: ")


@pytest.mark.requirement("S14")
@pytest.mark.slow
def test_a_stalled_and_a_cut_connection_are_lost_and_found_again(
    connect, plain, folder, shipped_text
):
    proxy = Proxy(plain[1])
    try:
        file = write_machine_file(folder / "proxy.yaml", proxy.port, shipped_text)
        linked = connect(file, request_timeout_s=1.0)
        linked.next(CycleRead)
        for stop, go in ((proxy.stall, proxy.flow), (proxy.cut, lambda: None)):
            stop()
            assert linked.next(Lost).reason
            go()
            linked.next(Connected)
            linked.next(CycleRead)
    finally:
        linked.link.stop()
        proxy.stop()


@pytest.mark.slow
def test_stalled_cycle_counter_is_reported(connect, plain, folder, shipped_text):
    changes = {"nodes__cycle__node": "s=Weld.Heartbeat"}  # constant, because nobody writes it
    linked = connect(write_machine_file(folder / "still.yaml", plain[1], shipped_text, **changes))
    assert linked.next(Stalled).age_s > 0.3


@pytest.mark.parametrize(
    ("secured", "key", "words"),
    [
        (False, "server_key.pem", "security: none"),
        (True, "", "needed"),
        (True, "client_key.pem", "not belong"),
    ],
)
def test_the_test_machine_refuses_a_server_key_that_does_not_fit(
    tmp_path, shipped_text, monkeypatch, capsys, secured, key, words
):
    machine_server.make_certificates(tmp_path)
    names = {
        "certificate": "client.der",
        "private_key": "client_key.pem",
        "server_certificate": "server.der",
    }
    security = {"policy": "Basic256Sha256"} | names if secured else "none"
    file = write_machine_file(tmp_path / "m.yaml", free_port(), shipped_text, security=security)
    options = ["--server-key", str(tmp_path / key)] if key else []
    monkeypatch.setattr(
        "sys.argv", ["run_machine_server.py", "--machine-file", str(file), *options]
    )
    with ThreadPoolExecutor() as pool:  # of its own loop
        assert pool.submit(machine_server.main).result() == 2
    errors = capsys.readouterr().err
    assert "--server-key: " in errors and words in errors and errors.count("\n") == 1


def test_certificates_are_checked_before_they_are_used(tmp_path, shipped_text):
    later = datetime.now(UTC) + timedelta(days=5)
    cert, key = make(tmp_path, "client", CLIENT_URI, ["127.0.0.1"])
    make(tmp_path, "later", CLIENT_URI, ["127.0.0.1"], start=later)
    (tmp_path / "text.der").touch(0o600)
    (tmp_path / "text.der").write_text("no certificate")
    names = {
        "policy": "Basic256Sha256",
        "certificate": cert.name,
        "private_key": key.name,
        "server_certificate": cert.name,
    }
    for changes, words in (
        ({"certificate": "none.der"}, "security.certificate: "),
        ({"certificate": "text.der"}, "holds no certificate"),
        ({"certificate": "later.der"}, "is not valid before"),
        ({"private_key": "text.der"}, "holds no private key"),
        ({"private_key": "later_key.pem"}, "not belong"),
        ({"server_certificate": "later.der"}, "security.server_certificate: "),
    ):
        file = write_machine_file(
            tmp_path / "m.yaml", 4840, shipped_text, security=names | changes
        )
        with pytest.raises(SecurityError, match=words):
            certificates.check(MachineFile.load(file).security, certificates.now())
    assert certificates.check(
        MachineFile.load(_good(tmp_path, shipped_text, names)).security, certificates.now()
    )[0]
    assert key.stat().st_mode & 0o077 == 0


def _good(folder, text, security):
    return write_machine_file(folder / "m.yaml", 4840, text, security=security)


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o620, 0o644])
def test_a_key_or_password_that_others_may_read_is_refused(tmp_path, shipped_text, mode):
    cert, key = make(tmp_path, "client", CLIENT_URI, ["127.0.0.1"])
    (tmp_path / "password").write_text("stir\n")
    for path in (key, tmp_path / "password"):
        path.chmod(mode)
    names = {"policy": "Basic256Sha256", "certificate": cert.name, "private_key": key.name}
    file = _good(tmp_path, shipped_text, names | {"server_certificate": cert.name})
    with pytest.raises(SecurityError, match=rf"security\.private_key: .* 600 {key}"):
        certificates.check(MachineFile.load(file).security, certificates.now())
    with pytest.raises(SecurityError, match=r"user\.password_file: .* 600 "):
        password(User(name="fsw", password_file=str(tmp_path / "password")))


@pytest.mark.parametrize(("kind", "values"), WHOLE.items(), ids=[kind.name for kind in WHOLE])
def test_a_counter_begins_again_after_the_largest_value_of_its_type(
    kind, values, machine, parameters, read_of
):
    """And every heartbeat fits into a node of the same type."""
    largest = (
        values - 1 if kind.name in ("Byte", "UInt16", "UInt32", "UInt64") else values // 2 - 1
    )
    counters = [largest - 1, largest, largest - values + 1, largest - values + 2]
    tracker = CycleTracker(0.1)
    tracker.values = values
    gateway = Gateway(machine, parameters)
    gateway.on_connected()
    for k, counter in enumerate(counters):
        steps = tracker.see(counter, 0.1 * k)
        assert steps == min(k, 1)
        out = gateway.on_read(
            read_of(counter, at_s=0.1 * k, steps=steps, source_ns=(100 + k) * 10**8)
        )
        order = gateway.on_command(Command(78.4, 407.5), out.stamp_ns, "test", True, 0.1 * k)
        assert order.heartbeat == counter
        assert (
            variant_from_binary(Buffer(variant_to_binary(_variant(order.heartbeat, kind)))).Value
            == counter
        )
        gateway.on_written(order, "", 0.1 * k)
    assert (tracker.skipped, tracker.restarts) == (0, 0)


def test_a_password_from_the_environment(tmp_path, shipped_text, monkeypatch):
    names = {
        "policy": "Basic256Sha256",
        "certificate": "c",
        "private_key": "k",
        "server_certificate": "s",
    }
    user = {"name": "fsw", "password_env": "FSW_TEST_PASSWORD"}
    file = write_machine_file(tmp_path / "m.yaml", 4840, shipped_text, security=names, user=user)
    user = MachineFile.load(file).user
    with pytest.raises(SecurityError, match="FSW_TEST_PASSWORD"):
        password(user)
    monkeypatch.setenv("FSW_TEST_PASSWORD", "stir")
    assert password(user) == "stir"


def test_the_waits_between_attempts_are_bounded():
    waits_s = back_off(Reconnect(first_s=0.5, max_s=10.0))
    assert list(islice(waits_s, 7)) == [0.5, 1.0, 2.0, 4.0, 8.0, 10.0, 10.0]
    assert list(islice(back_off(Reconnect(first_s=5.0, max_s=1.0)), 2)) == [5.0, 5.0]


@pytest.mark.slow
def test_taken_port_error_has_a_remedy(monkeypatch, capsys):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        monkeypatch.setattr(
            "sys.argv", ["run_machine_server.py", "--port", str(taken.getsockname()[1])]
        )
        with (
            ThreadPoolExecutor() as pool
        ):  # a test in a browser may have left a loop that runs in this thread
            assert pool.submit(machine_server.main).result() == 2
    assert "--port" in capsys.readouterr().err
