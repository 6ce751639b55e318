"""The supervisor's node over the middleware, in lockstep with a small plant in the same process."""

from __future__ import annotations

from unittest.mock import create_autospec

import pytest

rclpy = pytest.importorskip("rclpy")

from builtin_interfaces.msg import Duration  # noqa: E402
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus  # noqa: E402
from rclpy.node import Node  # noqa: E402
from rclpy.publisher import Publisher  # noqa: E402
from sensor_msgs.msg import Temperature  # noqa: E402

from fsw_control import messages_ros as convert  # noqa: E402
from fsw_control.cause import Cause  # noqa: E402
from fsw_control.contract import Command  # noqa: E402
from fsw_control.fence import Fence  # noqa: E402
from fsw_control.light_node_ros import DELIVERY_S  # noqa: E402
from fsw_control.reason import Reason, ReasonCode  # noqa: E402
from fsw_control.topics_ros import LATEST  # noqa: E402
from fsw_msgs.msg import (  # noqa: E402
    ControllerHealth,
    ControllerStatus,
    DriveFeedback,
    ShoulderDepth,
    SpindleTorque,
    SupervisorState,
    WeldCommand,
    WeldReference,
)
from fsw_msgs.srv import (  # noqa: E402
    ListControllers,
    OperatorRequest,
    SetMode,
    SwitchController,
)
from fsw_supervisor import failover  # noqa: E402
from fsw_supervisor.facts import Code, Fact  # noqa: E402
from fsw_supervisor.supervisor_node import SupervisorNode  # noqa: E402
from fsw_test_support.ros_graph import Spinner  # noqa: E402

pytestmark = pytest.mark.slow

STEP_NS = 100_000_000
STRICT, BEST_EFFORT = SwitchController.Request.STRICT, SwitchController.Request.BEST_EFFORT


class Peer(Node):
    """Plant and controllers: ticks as soon as its last tick is answered."""

    def __init__(self):
        super().__init__("peer")
        self.stamp_ns = 0
        self.commands, self.states, self.reports = [], [], []
        self.depths = self.create_publisher(ShoulderDepth, "fsw/depth", 10)
        self.torques = self.create_publisher(SpindleTorque, "fsw/spindle_torque", 10)
        self.temperatures = self.create_publisher(Temperature, "fsw/thermocouple", 10)
        self.drives = self.create_publisher(DriveFeedback, "fsw/drives", 10)
        self.pushed_kn, self.reasons, self.seen_before = 0.0, {}, ""
        self.fence = Fence()
        self.voices = {}
        self.wild = set()
        self.create_subscription(WeldCommand, "fsw/command", self.on_command, 10)
        self.create_subscription(
            SupervisorState, "fsw/supervisor/state", self.states.append, LATEST
        )
        self.create_subscription(DiagnosticArray, "/diagnostics", self.reports.append, 10)
        self.switching = self.create_client(SwitchController, "fsw/switch_controller")
        self.listing = self.create_client(ListControllers, "fsw/list_controllers")
        self.modes = self.create_client(SetMode, "fsw/set_mode")

    def add(self, name):
        self.voices[name] = (
            self.create_publisher(WeldCommand, f"fsw/{name}/proposal", 10),
            self.create_publisher(ControllerStatus, f"fsw/{name}/status", 10),
        )

    def remove(self, name):
        for publisher in self.voices.pop(name):
            self.destroy_publisher(publisher)

    @property
    def applied(self):
        return convert.command(self.commands[-1]) if self.commands else Command(78.4, 407.5)

    def on_command(self, message):
        self.commands.append(message)
        if self.fence.check(convert.signature(message), message.source) is None:
            self.fence.take(message.source, convert.stamp_ns(message.header.stamp))
        if convert.stamp_ns(message.header.stamp) == self.stamp_ns:
            self.tick()

    def tick(self):
        self.stamp_ns += STEP_NS
        header = convert.header(self.stamp_ns)
        acting = Command(self.applied.force_kn + self.pushed_kn, self.applied.speed_rpm)
        self.fence.measure()
        self.drives.publish(convert.drives_message(acting, self.stamp_ns, self.fence.state))
        self.depths.publish(convert.sensor_message("depth", 2.66, self.stamp_ns))
        torque_nm = 1050.0 * self.applied.force_kn / 78.4
        self.torques.publish(convert.sensor_message("torque", torque_nm, self.stamp_ns))
        self.temperatures.publish(convert.sensor_message("thermocouple", 850.0, self.stamp_ns))
        for name, (proposals, statuses) in self.voices.items():
            force = float("nan") if name in self.wild else self.applied.force_kn
            command = Command(force, self.applied.speed_rpm)
            reason = self.reasons.get(name, "")
            proposals.publish(
                convert.command_message(command, self.stamp_ns, name, not reason, reason)
            )
            seen = self.commands[-1].source if self.commands else self.seen_before
            status = ControllerStatus(
                header=header, controller=name, applied_source=seen, tolerated_sensors=["depth"]
            )
            statuses.publish(status)

    def report(self, part):
        for array in reversed(self.reports):
            for status in array.status:
                if status.name == f"fsw_supervisor: {part}":
                    return status
        return None


class Bench(Spinner):
    """Supervisor and peer in one executor, in a domain of their own."""

    def __init__(self, domain, arguments=(), remap=None):
        settings = [item for setting in ("lockstep:='on'", *arguments) for item in ("-p", setting)]
        settings += ["-r", remap] if remap else []
        rclpy.init(args=["test", "--ros-args", *settings], domain_id=domain)
        super().__init__()
        self.peer = Peer()
        self.supervisor = SupervisorNode()
        self.executor.add_node(self.peer)
        self.executor.add_node(self.supervisor)

    def run(self, *names):
        """Let the weld run under the first of ``names``."""
        peer = self.peer
        for name in names or ("decentral", "nmpc"):
            peer.add(name)
        topics = (peer.depths, peer.torques, peer.temperatures, peer.drives)
        voices = [publisher for pair in peer.voices.values() for publisher in pair]
        self.until(
            lambda: all(publisher.get_subscription_count() for publisher in [*topics, *voices])
        )
        self.until(
            lambda: (
                peer.count_publishers(peer.resolve_topic_name("fsw/command")) == 1 and peer.states
            )
        )
        peer.tick()
        self.until(lambda: len(peer.commands) > 8)

    def health(self, name):
        """A controller's health as last published; that of an unknown one before it joins."""
        known = self.peer.states[-1].controllers
        return next((item for item in known if item.name == name), ControllerHealth())

    def switch(self, name, strictness=STRICT, timeout_s=5.0):
        timeout = Duration(sec=int(timeout_s), nanosec=round(timeout_s % 1 * 1e9))
        request = SwitchController.Request(name=name, strictness=strictness, timeout=timeout)
        return self.call(self.peer.switching, request)

    def close(self):
        self.executor.shutdown()
        self.peer.destroy_node()
        self.supervisor.destroy_node()
        rclpy.try_shutdown()


@pytest.fixture
def make_bench(domain_id):
    """Makes the bench, in a domain that is this test's alone."""
    benches = []

    def make(*arguments, remap=None):
        benches.append(Bench(domain_id, arguments, remap))
        return benches[-1]

    yield make
    for bench in benches:
        bench.close()


@pytest.fixture
def bench(make_bench):
    """A weld that runs under ``decentral`` with ``nmpc`` as its shadow."""
    bench = make_bench()
    bench.run()
    return bench


def test_who_joins_before_the_role_is_decided_is_told_then(make_bench, capfd, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr(failover, "LISTEN_S", 1e6)  # however busy the machine is
        bench = make_bench()
        bench.peer.add("third")
        proposals, _ = bench.peer.voices["third"]
        bench.until(proposals.get_subscription_count)
        assert not bench.peer.states
    bench.run()
    assert capfd.readouterr().err.count(Fact.of(Code.JOINED, controller="third").words) == 1


@pytest.mark.requirement("S25")
def test_a_safe_stop_that_the_controllers_have_seen_goes_on_after_a_restart(make_bench):
    bench = make_bench()
    bench.peer.seen_before = "safe_stop"
    bench.run()
    assert {message.source for message in bench.peer.commands} == {"safe_stop"}
    assert bench.peer.states[-1].actual_mode == "safe_stop"
    assert bench.peer.states[-1].stop.stopped


@pytest.mark.requirement("S5")
def test_forwards_the_selected_controller_and_answers_each_tick_once(bench):
    stamps = [convert.stamp_ns(message.header.stamp) for message in bench.peer.commands]
    assert stamps == [STEP_NS * count for count in range(1, len(stamps) + 1)]
    assert {message.source for message in bench.peer.commands} == {"decentral"}
    assert all(message.healthy for message in bench.peer.commands)
    state = bench.peer.states[-1]
    assert (state.actual_controller, state.actual_mode, state.target_mode) == (
        "decentral",
        "auto",
        "auto",
    )


def test_the_state_is_latched_for_those_who_come_later(bench):
    late = []
    bench.peer.create_subscription(SupervisorState, "fsw/supervisor/state", late.append, LATEST)
    bench.until(lambda: late)
    assert late[0].applied.source == "decentral"


@pytest.mark.parametrize("lockstep", [True, False])
def test_in_lockstep_a_state_waits_until_the_one_before_has_arrived(bench, lockstep):
    """Of its publisher only the last is kept: a recorder on a busy machine would miss a state."""
    bench.run()
    supervisor, kept = bench.supervisor, bench.supervisor._states
    supervisor._arbiter.lockstep = lockstep
    supervisor._states = states = create_autospec(Publisher, instance=True)
    states.wait_for_all_acked.side_effect = [True, False, False]  # then a subscriber is stalled
    try:
        for _ in range(3):
            supervisor._report_changes()
    finally:
        supervisor._states = kept
    names = ["wait_for_all_acked", "publish"] if lockstep else ["publish"]
    assert [made[0] for made in states.method_calls] == 3 * names
    waits_s = [made.args[0].nanoseconds / 1e9 for made in states.wait_for_all_acked.mock_calls]
    assert waits_s == pytest.approx([DELIVERY_S, DELIVERY_S, 0.0] if lockstep else [], abs=0.1)


def test_switches_by_service_and_says_what_happened(bench):
    answer = bench.switch("nmpc")
    assert answer.ok
    assert answer.code == "applied" and "nmpc" in answer.message
    bench.until(lambda: bench.peer.commands[-1].source == "nmpc")
    bench.until(lambda: bench.peer.states[-1].actual_controller == "nmpc")
    assert Cause(bench.peer.states[-1].cause) is Cause.SWAP_REQUESTED
    refused = bench.switch("nobody")
    assert (refused.ok, refused.code) == (False, "unknown_controller")
    assert "nobody" in refused.message
    assert bench.switch("nmpc", strictness=7).code == "unknown_strictness"


def test_a_waiting_answer_does_not_hold_up_the_ticks(bench):
    bench.peer.wild.add("nmpc")
    bench.until(lambda: not bench.health("nmpc").consecutive_good)
    future = bench.peer.switching.call_async(
        SwitchController.Request(name="nmpc", strictness=BEST_EFFORT, timeout=Duration(sec=60))
    )
    ticks = len(bench.peer.commands)
    bench.until(lambda: len(bench.peer.commands) > ticks + 30)
    assert not future.done()
    listed = bench.call(bench.peer.listing, ListControllers.Request())
    assert listed.active == "decentral"
    bench.peer.wild.clear()
    bench.until(future.done)
    assert future.result().ok


def test_lists_controllers_with_their_health(bench):
    bench.peer.wild.add("nmpc")
    bench.until(lambda: bench.health("nmpc").rejected > 3)
    answer = bench.call(bench.peer.listing, ListControllers.Request())
    assert (answer.active, answer.mode) == ("decentral", "auto")
    decentral, nmpc = answer.controllers
    assert (decentral.name, decentral.warm, decentral.lack) == (
        "decentral",
        True,
        ControllerHealth.NONE,
    )
    assert list(decentral.tolerated_sensors) == ["depth"]
    assert (nmpc.healthy, nmpc.warm) == (False, False)
    assert nmpc.lack == ControllerHealth.UNUSABLE
    assert Reason.of_messages(nmpc.why).code is ReasonCode.NOT_FINITE


def test_fails_over_within_the_tick(bench):
    bench.peer.wild.add("decentral")
    bench.until(lambda: bench.peer.commands[-1].source == "nmpc")
    stamps = [convert.stamp_ns(message.header.stamp) for message in bench.peer.commands]
    assert stamps == [STEP_NS * count for count in range(1, len(stamps) + 1)]
    assert {message.source for message in bench.peer.commands} == {"decentral", "nmpc"}
    bench.until(lambda: bench.peer.states[-1].cause == Cause.SWAP_FAILED)


def test_modes_by_service(bench):
    answer = bench.call(
        bench.peer.modes, SetMode.Request(mode="manual", axial_force=80e3, spindle_speed=42.0)
    )
    assert answer.ok, answer.message
    bench.until(lambda: bench.peer.commands[-1].axial_force == pytest.approx(80e3))
    assert bench.peer.commands[-1].source == "manual"
    assert not bench.call(
        bench.peer.modes, SetMode.Request(mode="manual", axial_force=80.0, spindle_speed=42.0)
    ).ok
    assert bench.call(bench.peer.modes, SetMode.Request(mode="hold", who="anna (3f2a)")).ok
    bench.until(lambda: bench.peer.commands[-1].source == "hold")
    bench.until(lambda: bench.peer.states[-1].who == "anna (3f2a)")
    assert bench.call(bench.peer.modes, SetMode.Request(mode="auto")).ok
    bench.until(lambda: bench.peer.commands[-1].source == "decentral")
    bench.until(lambda: bench.peer.states[-1].who == "operator")
    assert bench.call(bench.peer.listing, ListControllers.Request()).mode == "auto"
    forged = SetMode.Request(mode="hold", who="anna\n[ERROR]\x1b[2J " + "x" * 500)
    assert bench.call(bench.peer.modes, forged).ok
    bench.until(lambda: bench.peer.states[-1].who.startswith("anna [ERROR]"))
    assert bench.peer.states[-1].who.isprintable() and len(bench.peer.states[-1].who) <= 100


def test_a_third_controller_appears_by_itself_and_leaves(bench, capfd):
    bench.peer.add("third")
    bench.until(lambda: bench.health("third").warm)
    assert bench.switch("third").ok
    assert bench.switch("decentral", BEST_EFFORT).ok
    bench.peer.remove("third")
    left, printed = Fact.of(Code.LEFT, controller="third").words, []
    bench.until(lambda: printed.append(capfd.readouterr().err) or left in "".join(printed))
    bench.until(lambda: not bench.health("third").healthy)


def value_of(status, key="code"):
    return next(pair.value for pair in status.values if pair.key == key)


@pytest.mark.requirement("S11")
def test_a_foreign_writer_is_an_error_in_diagnostics(bench):
    bench.until(lambda: bench.peer.report("command topic") is not None)
    assert value_of(bench.peer.report("command topic")) == "only_writer"
    foreign = bench.peer.create_publisher(WeldCommand, "fsw/command", 10)
    bench.until(lambda: foreign.get_subscription_count() == 2)
    foreign.publish(convert.command_message(Command(60.0, 300.0), 1, "decentral"))
    bench.until(lambda: bench.peer.report("command topic").level == DiagnosticStatus.ERROR)
    assert value_of(bench.peer.report("command topic"), "foreign commands") == "1"
    assert value_of(bench.peer.report("command topic")) == "foreign"
    assert bench.peer.commands[-1].source == "decentral"


def test_diagnostics_tell_the_timing_of_each_controller(bench):
    bench.until(lambda: bench.peer.report("controller decentral") is not None)
    keys = {pair.key for pair in bench.peer.report("controller decentral").values}
    assert {
        "latency mean [ms]",
        "latency 99 % [ms]",
        "latency max [ms]",
        "jitter [ms]",
        "missed",
        "late",
    } <= keys
    bench.until(lambda: bench.peer.report("arbiter").message.startswith("auto: decentral"))
    bench.until(
        lambda: bench.peer.report("process").message == "sensors valid, all values within limits"
    )


def test_parameters_can_be_changed_while_running_and_are_checked(bench):
    from rclpy.parameter import Parameter

    good, bad = bench.supervisor.set_parameters(
        [Parameter("warm_ticks", value=7), Parameter("deadline_s", value=0.9)]
    )
    assert good.successful
    bench.until(lambda: bench.health("nmpc").required_good == 7)
    assert not bad.successful
    assert "deadline_s is 0.9 s; it must be between 0 and tick_period_s" in bad.reason


def test_parameters_that_contradict_each_other_stop_the_start(make_bench):
    with pytest.raises(ValueError, match="deadline_s"):
        make_bench("deadline_s:=0.5")
    rclpy.try_shutdown()


def test_topics_and_discovery_follow_the_namespace(make_bench):
    bench = make_bench(remap="__ns:=/cell")
    bench.run("decentral", "third")
    assert bench.supervisor.count_publishers("/cell/fsw/command") == 1
    bench.until(lambda: bench.health("third").warm)
    assert bench.switch("third").ok


@pytest.mark.parametrize("name", ["manual", "unknown"])
def test_reserved_source_names_are_not_controllers(bench, name):
    bench.peer.add(name)
    bench.peer.add("third")  # found later than the one before
    bench.until(lambda: bench.health("third").warm)
    assert bench.switch(name).code == "unknown_controller"


@pytest.mark.requirement("S1")
def test_an_interlock_trips_on_what_the_load_cell_sees(bench):
    bench.peer.pushed_kn = 97.5 - bench.peer.applied.force_kn
    bench.until(lambda: bench.peer.commands[-1].source == "safe_stop")
    bench.until(lambda: bench.peer.states[-1].actual_mode == "safe_stop")
    assert bench.peer.states[-1].why[0].interlocks == ["force_high"]
    assert bench.peer.states[-1].acknowledgement_blocked_by == ["force_high"]
    acknowledge = bench.peer.create_client(OperatorRequest, "fsw/acknowledge")
    refused = bench.call(acknowledge, OperatorRequest.Request())
    assert (refused.ok, refused.code) == (False, "cause_present")
    assert "force_high" in refused.message
    bench.peer.pushed_kn = 0.0
    bench.until(lambda: not bench.peer.states[-1].acknowledgement_blocked_by)
    assert bench.call(acknowledge, OperatorRequest.Request()).ok
    bench.until(lambda: not bench.peer.states[-1].stop.stopped)
    mode = bench.peer.create_client(SetMode, "fsw/set_mode")
    assert bench.call(mode, SetMode.Request(mode="auto")).ok
    bench.until(lambda: bench.peer.states[-1].actual_mode == "auto")
    assert not bench.peer.states[-1].stop.stopped


def test_without_a_set_point_the_state_says_so(make_bench):
    bench = make_bench()
    bench.peer.reasons = dict.fromkeys(("decentral", "nmpc"), "no set-point yet")
    bench.run()
    assert bench.peer.states[-1].actual_mode == "hold"
    waiting = [ReasonCode.WAITING_FOR_CONTROLLER, ReasonCode.OTHER]
    bench.until(lambda: [why.code for why in bench.peer.states[-1].why] == waiting)
    bench.peer.reasons.clear()
    bench.until(lambda: bench.peer.states[-1].actual_controller == "decentral")


def test_set_points_are_kept_for_those_who_come_when_their_sender_has_left(bench):
    bench.run()
    operator = rclpy.create_node("operator")
    sender = operator.create_publisher(WeldReference, "fsw/reference", LATEST)
    bench.until(lambda: sender.get_subscription_count())
    sender.publish(WeldReference(depth=float("nan"), temperature=850.0))
    sender.publish(WeldReference(depth=2.7e-3, temperature=845.0))
    heard = []
    bench.peer.create_subscription(WeldReference, "fsw/supervisor/reference", heard.append, LATEST)
    bench.until(lambda: heard)
    operator.destroy_node()
    late = []
    bench.peer.create_subscription(WeldReference, "fsw/supervisor/reference", late.append, LATEST)
    bench.until(lambda: late)
    assert len(heard) == len(late) == 1
    assert convert.stamp_ns(late[0].issued) > 0
    assert (late[0].depth, late[0].temperature) == (pytest.approx(2.7e-3), 845.0)
    assert 0 < convert.stamp_ns(late[0].header.stamp) <= bench.peer.stamp_ns
