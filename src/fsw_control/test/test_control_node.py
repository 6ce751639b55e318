"""The controller node among real topics: what goes in, what comes out, what goes wrong."""

import math
from dataclasses import replace
from hashlib import sha256
from typing import Annotated

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from sensor_msgs.msg import Temperature
from std_msgs.msg import Header

from fsw_control import Command, Diagnosis, Plan, Proposal, Reference
from fsw_control import messages_ros as convert
from fsw_control.controller_node import ControllerNode
from fsw_control.fence import ActuatorState
from fsw_control.heat_plan import HeatPlan as HeatPlanData
from fsw_control.heat_plan import HeatPlanProblem
from fsw_control.parameters import NodeParameters
from fsw_control.reason import Reason, ReasonCode
from fsw_control.schema.ranges import Range
from fsw_control.topics_ros import LATCHED, LATEST, STREAM
from fsw_msgs.msg import (
    ControllerStatus,
    DriveFeedback,
    HeatPlan,
    Prediction,
    ShoulderDepth,
    SpindleTorque,
    WeldCommand,
    WeldProgress,
    WeldReference,
    WeldReferencePlan,
)
from fsw_test_support.ros_graph import Spinner

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("domain_id")]
STEP_NS = 100_000_000


HEAT_PLAN = HeatPlanData(
    at_s=[0.0, 10.0],
    heat_kw=[0.0, 1.0],
    variance_kw2=[0.0, 0.1],
    model={"copper_lag_s": 11.0},
    travel_mm=[0.0, 14.0],
    angle_deg=[0.0, 1.5],
    type="copper_lid",
    profile="a" * 64,
)


class EchoParameters(NodeParameters):
    """Parameters of the controller."""

    gain: Annotated[float, Range(0.0, 10.0, "kN/mm")] = 1.0
    """Force per depth error."""


class FileParameters(EchoParameters):
    """With the name of a file."""

    tuning_file: str = ""
    """Tuning."""


class Echo:
    """Proposes the applied command plus its gain, and remembers all it was given."""

    name = "echo"
    tolerated_sensors = ("torque",)

    def __init__(self, values):
        self.gain = values["gain"]
        self.seen = []
        self.resets = 0
        self.rejoined_after = []  # steps
        self.raises = False
        self.attainable = {}

    def plan_deviations(self, time_s):
        return [0.004] * len(time_s), [0.2] * len(time_s)

    def step(self, measurement, reference, applied, dt_s):
        self.seen.append((measurement, reference, applied, dt_s))
        if self.raises:
            raise RuntimeError("broken on purpose")
        plan = Plan((0.1,), (2.66,), (850.0,), (78.0,), (400.0,))
        quantities = {"depth_mm": 1.0, **self.attainable}
        diagnosis = Diagnosis(disturbances=quantities, active_limits=("force_max",), plan=plan)
        return Proposal(
            Command(applied.force_kn + self.gain, applied.speed_rpm), diagnosis=diagnosis
        )

    def reset(self, applied):
        self.resets += 1

    def rejoin(self):
        self.rejoined_after.append(len(self.seen))

    def use_logger(self, logger):
        self.logger = logger

    def check(self, values):
        return "gain 7 is never good" if values["gain"] == 7.0 else None

    def configure(self, values):
        self.gain = values["gain"]


class Peer(Spinner):
    """The node under test, and everything around it."""

    def __init__(self, parameters, args):
        rclpy.init(args=["test", *args])
        self.controllers = []
        self.node = ControllerNode("echo", self._make, parameters)
        self.peer = rclpy.create_node("peer")
        self.got = {"proposal": [], "status": [], "prediction": [], "diagnostics": []}
        for name, kind in (
            ("proposal", WeldCommand),
            ("status", ControllerStatus),
            ("prediction", Prediction),
        ):
            self.peer.create_subscription(kind, f"/fsw/echo/{name}", self.got[name].append, STREAM)
        self.peer.create_subscription(
            DiagnosticArray, "/diagnostics", self.got["diagnostics"].append, STREAM
        )
        self.depths = self.peer.create_publisher(ShoulderDepth, "/fsw/depth", STREAM)
        self.torques = self.peer.create_publisher(SpindleTorque, "/fsw/spindle_torque", STREAM)
        self.temperatures = self.peer.create_publisher(Temperature, "/fsw/thermocouple", STREAM)
        self.drives = self.peer.create_publisher(DriveFeedback, "/fsw/drives", STREAM)
        self.references = self.peer.create_publisher(WeldReference, "/fsw/reference", LATCHED)
        self.commands = self.peer.create_publisher(WeldCommand, "/fsw/command", STREAM)
        super().__init__()
        self.executor.add_node(self.node)
        self.executor.add_node(self.peer)
        outputs = (
            self.depths,
            self.torques,
            self.temperatures,
            self.drives,
            self.references,
            self.commands,
        )
        self.until(lambda: all(publisher.get_subscription_count() for publisher in outputs))
        self.until(lambda: self.peer.count_publishers("/fsw/echo/proposal") == 1)

    def _make(self, values):
        self.controllers.append(Echo(values))
        return self.controllers[-1]

    @property
    def controller(self):
        return self.controllers[-1]

    def sense(self, k, sensors=("depth", "torque", "thermocouple"), depth=2.66):
        stamp = k * STEP_NS
        if "depth" in sensors:
            self.depths.publish(convert.sensor_message("depth", depth, stamp))
        if "torque" in sensors:
            self.torques.publish(convert.sensor_message("torque", 1052.0, stamp))
        if "thermocouple" in sensors:
            self.temperatures.publish(convert.sensor_message("thermocouple", 850.0, stamp))

    def command(self, k, force=78.0, source="echo"):
        self.commands.publish(convert.command_message(Command(force, 400.0), k * STEP_NS, source))

    def refer(self, depth=2.66, stamp=0):
        before = self.node.references.n_waiting
        self.references.publish(convert.reference_message(Reference(depth, 850.0), stamp))
        self.until(lambda: self.node.references.n_waiting > before)

    def tick(self, k, **how):
        count = len(self.got["proposal"])
        self.sense(k, **how)
        self.until(lambda: len(self.got["proposal"]) > count)
        return self.got["proposal"][-1]

    def end(self):
        self.executor.shutdown()
        self.node.destroy_node()
        self.peer.destroy_node()
        rclpy.try_shutdown()


@pytest.fixture
def start():
    peers = []

    def make(*args):
        peers.append(Peer(EchoParameters, args))
        return peers[-1]

    yield make
    for peer in peers:
        peer.end()


def test_answers_a_tick_with_its_stamp_in_si_units(start):
    peer = start()
    peer.refer()
    proposal = peer.tick(7)
    assert convert.stamp_ns(proposal.header.stamp) == 7 * STEP_NS
    assert (proposal.source, proposal.healthy, convert.reason(proposal)) == (
        "echo",
        True,
        Reason(),
    )
    assert proposal.axial_force == pytest.approx(79_400.0)
    assert proposal.spindle_speed == pytest.approx(407.576 * math.pi / 30.0)
    measurement, reference, applied, dt_s = peer.controller.seen[0]
    assert measurement.time_s == pytest.approx(0.7)
    assert measurement.depth_mm == pytest.approx(2.66)
    assert reference.temperature_c == 850.0
    assert applied == Command(78.4, 407.576)
    assert dt_s == 0.1
    peer.until(lambda: peer.got["status"] and peer.got["prediction"])
    status, prediction = peer.got["status"][-1], peer.got["prediction"][-1]
    assert status.controller == "echo" and not status.selected
    assert list(status.tolerated_sensors) == ["torque"]
    assert list(status.disturbance_names) == ["depth [m]"]
    assert list(status.disturbances) == pytest.approx([1e-3])
    assert list(prediction.depth) == pytest.approx([2.66e-3])
    assert list(prediction.axial_force) == pytest.approx([78e3])
    assert list(prediction.depth_deviation) == pytest.approx([4e-6])
    assert list(prediction.temperature_deviation) == pytest.approx([0.2])


def test_diagnostics_say_that_a_set_point_is_out_of_reach(start):
    peer = start()
    peer.refer()
    peer.controller.attainable = {"attainable_depth_mm": 2.66, "attainable_temperature_c": 835.0}
    peer.tick(0)

    def codes(since=0):
        reports = (array.status[0] for array in peer.got["diagnostics"][since:])
        return [{pair.key: pair.value for pair in report.values} for report in reports]

    peer.until(lambda: any(code["code"] == "out_of_reach" for code in codes()))
    values = next(code for code in codes() if code["code"] == "out_of_reach")
    assert (values["code: reach"], values["code: reach: parts"]) == ("upper_bound", "temperature")
    peer.controller.attainable = {"attainable_depth_mm": 2.66, "attainable_temperature_c": 850.0}
    peer.tick(1)
    before = len(peer.got["diagnostics"])
    peer.until(lambda: any(code["code"] == "proposing" for code in codes(before)))


def test_follows_the_applied_command_of_the_tick_before(start):
    peer = start()
    peer.refer()
    peer.tick(0)
    peer.sense(1)
    peer.command(0, force=80.0)
    peer.until(lambda: len(peer.got["proposal"]) == 2)
    assert peer.controller.seen[1][2].force_kn == pytest.approx(80.0)
    peer.until(lambda: peer.got["status"][-1].selected)
    assert peer.got["status"][-1].applied_source == "echo"


def test_without_reference_it_is_not_healthy(start):
    proposal = start().tick(0)
    assert not proposal.healthy
    assert proposal.why.code == ReasonCode.NO_SET_POINT


@pytest.mark.parametrize("sender_is_gone", [True, False])
def test_late_joiner_takes_the_supervisors_reference(start, sender_is_gone):
    """The sender's first reference says "at once" and comes after what the supervisor keeps."""
    peer = start()
    kept = peer.peer.create_publisher(WeldReference, "/fsw/supervisor/reference", LATCHED)
    issued_ns = peer.peer.get_clock().now().nanoseconds
    kept.publish(
        convert.reference_message(Reference(2.71, 850.0), 3 * STEP_NS, issued_ns + 10**12)
    )
    peer.until(lambda: peer.node.references)
    if not sender_is_gone:
        peer.references.publish(convert.reference_message(Reference(2.66, 850.0), 0))
        peer.until(lambda: peer.node.references.n_waiting == 2)
    assert peer.tick(9).healthy
    assert peer.controller.seen[-1][1].depth_mm == pytest.approx(2.71)


@pytest.fixture
def heated(start):
    """A peer with the publisher of heat plans, and a plan in force since before the first tick."""
    peer = start()
    peer.heat = peer.peer.create_publisher(HeatPlan, "/fsw/heat_plan", LATEST)
    peer.refer()
    peer.heat.publish(convert.heat_plan_message(HEAT_PLAN, 0))
    peer.until(lambda: peer.node._heat.at(1))
    peer.tick(1)
    return peer


def test_known_heat_reaches_a_controller_and_the_one_after_its_restart(heated):
    assert heated.controller.seen[-1][1].heat.heat(5.0) == pytest.approx(0.5)
    heated.executor.remove_node(heated.node)
    heated.node.destroy_node()
    heated.node = ControllerNode("echo", heated._make, EchoParameters)
    heated.executor.add_node(heated.node)
    heated.until(lambda: heated.node._heat.at(1))
    heated.until(lambda: heated.depths.get_subscription_count() == 1)
    heated.until(lambda: heated.node.references)
    heated.tick(2)
    assert heated.controller.seen[-1][1].heat.profile == HEAT_PLAN.profile


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"heat_kw": [0.0, math.nan]}, HeatPlanProblem.NOT_FINITE),
        ({"heat_kw": [0.0]}, HeatPlanProblem.LENGTHS),
        ({"variance_kw2": [0.0, -1.0]}, HeatPlanProblem.VARIANCE),
        ({"profile": "b" * 64}, HeatPlanProblem.CHANGED),
        ({"at_s": [0.0, 0.05]}, HeatPlanProblem.OVER),
    ],
)
def test_a_bad_heat_plan_is_reported_and_changes_nothing(heated, changes, problem):
    heated.heat.publish(convert.heat_plan_message(replace(HEAT_PLAN, **changes), 0))
    shown = f"refused: {problem.words}"
    heated.until(
        lambda: any(
            pair.key == "heat plan" and pair.value == shown
            for array in heated.got["diagnostics"]
            for pair in array.status[0].values
        )
    )
    heated.tick(2)
    (_, before, *_), (_, after, *_) = heated.controller.seen
    assert after.heat is before.heat


def test_a_plan_of_another_path_is_dropped_by_the_programmes_report(heated):
    progress = heated.peer.create_publisher(WeldProgress, "/fsw/weld_progress", LATEST)
    stamp = convert.stamp_from_ns(5 * 10**9)
    progress.publish(WeldProgress(header=Header(stamp=stamp), state="running", length=0.5))
    heated.until(lambda: heated.node._heat.at(1) is None)
    heated.tick(2)
    assert heated.controller.seen[-1][1].heat is None


def test_reference_sent_ahead_begins_at_its_tick(start):
    peer = start()
    peer.refer()
    peer.refer(depth=2.86, stamp=2 * STEP_NS)
    for k in range(4):
        peer.tick(k)
    assert [entry[1].depth_mm for entry in peer.controller.seen] == pytest.approx(
        [2.66, 2.66, 2.86, 2.86]
    )


def test_announced_set_points_are_known_from_the_tick_after_the_plans_stamp(start):
    peer = start()
    plans = peer.peer.create_publisher(WeldReferencePlan, "/fsw/reference_plan", LATEST)
    peer.refer()
    planned = [(9 * STEP_NS, Reference(2.86, 850.0))]
    plans.publish(convert.reference_plan_message(planned, 2 * STEP_NS))
    peer.until(lambda: peer.node._plans.coming)
    for k in range(1, 5):
        peer.tick(k)
    assert [len(entry[1].coming) for entry in peer.controller.seen] == [0, 0, 1, 1]


def test_hundreds_of_references_sent_ahead_all_arrive(start):
    peer = start()
    peer.references.publish(convert.reference_message(Reference(2.66, 850.0), 0))
    for k in range(1, 400):
        peer.references.publish(
            convert.reference_message(Reference(2.66 + 1e-3 * k, 850.0), 10 * k * STEP_NS)
        )
    peer.until(lambda: peer.node.references.n_waiting == 400)
    peer.tick(1)
    assert peer.controller.seen[-1][1].depth_mm == pytest.approx(2.66)
    for k in (399 * 10 - 1, 399 * 10):
        peer.tick(k)
    assert [entry[1].depth_mm for entry in peer.controller.seen[-2:]] == pytest.approx(
        [2.66 + 0.398, 2.66 + 0.399]
    )


def test_missing_sensor_is_bridged_then_unhealthy_with_the_reason(start):
    peer = start()
    peer.refer()
    peer.tick(0)
    answers = [peer.tick(k, sensors=("torque", "thermocouple")) for k in range(1, 7)]
    assert answers[0].healthy and not answers[-1].healthy
    assert convert.reason(answers[-1]) == Reason(ReasonCode.INVALID_SENSOR, ("depth",))
    assert peer.tick(7).why.code == ReasonCode.INVALID_SENSOR
    peer.tick(8)
    assert peer.tick(9).healthy


def test_a_value_that_is_held_is_marked_and_never_fresh(start):
    peer = start()
    peer.refer()
    for k in range(4):
        peer.tick(
            k, sensors=("depth", "torque") if k == 2 else ("depth", "torque", "thermocouple")
        )
    seen = [entry[0] for entry in peer.controller.seen]
    assert [measurement.held for measurement in seen] == [(), (), ("thermocouple",), ()]
    assert seen[2].temperature_valid and seen[2].temperature_c == seen[1].temperature_c


def test_drive_feedback_reaches_the_controller_with_its_tick(start):
    peer = start()
    peer.refer()
    peer.drives.publish(convert.drives_message(Command(81.5, 402.0), STEP_NS))
    peer.until(lambda: peer.node._synchronizer._optional["drives"])
    peer.tick(1)
    peer.tick(2)
    with_drives, without = (entry[0] for entry in peer.controller.seen)
    assert (with_drives.force_kn, with_drives.speed_rpm) == pytest.approx((81.5, 402.0))
    assert math.isnan(without.force_kn) and math.isnan(without.speed_rpm)


@pytest.mark.parametrize(("answered_ns", "expected"), [(0, []), (5 * STEP_NS, [0])])
def test_start_in_mid_weld_calls_rejoin_before_the_first_step(start, answered_ns, expected):
    """The actuator end has answered others' commands before."""
    peer = start("--ros-args", "-p", "use_sim_time:=true")  # a tick waits for the drives
    peer.refer()
    for k in (6, 7):
        state = ActuatorState(answered_ns=answered_ns + (k - 6) * STEP_NS)
        peer.drives.publish(convert.drives_message(Command(78.0, 400.0), k * STEP_NS, state))
        peer.tick(k)
    assert peer.controller.rejoined_after == expected


def test_nan_from_a_tolerated_sensor_stays_healthy(start):
    peer = start()
    peer.refer()
    for k in range(8):
        proposal = peer.tick(k, sensors=("depth", "thermocouple"))
    assert proposal.healthy
    assert peer.controller.seen[-1][0].invalid_sensors() == ("torque",)


def test_controller_exception_is_reported_and_survived(start):
    peer = start()
    peer.refer()
    peer.tick(0)
    peer.controller.raises = True
    proposal = peer.tick(1)
    assert not proposal.healthy
    assert "broken on purpose" in proposal.why.detail
    peer.until(
        lambda: any(a.status[0].level == DiagnosticStatus.ERROR for a in peer.got["diagnostics"])
    )
    peer.controller.raises = False
    assert peer.tick(2).healthy


def test_a_jump_of_time_resets_the_controller(start):
    peer = start()
    peer.refer()
    peer.tick(1000)
    resets = peer.controller.resets
    assert peer.tick(0).healthy
    assert peer.controller.resets == resets + 1
    assert peer.controller.seen[-1][3] == 0.1


@pytest.mark.parametrize(("answered_ns", "expected"), [(0, []), (STEP_NS, [2])])
def test_after_a_jump_of_time_in_mid_weld_the_controller_rejoins(start, answered_ns, expected):
    peer = start("--ros-args", "-p", "use_sim_time:=true")  # a tick waits for the drives
    peer.refer()
    for k, answered in ((100, 0), (101, answered_ns), (5000, answered_ns)):
        state = ActuatorState(answered_ns=answered)
        peer.drives.publish(convert.drives_message(Command(78.0, 400.0), k * STEP_NS, state))
        peer.tick(k)
    assert peer.controller.rejoined_after == expected


def test_bad_commands_and_references_are_ignored(start):
    peer = start()
    peer.refer()
    peer.tick(0)
    peer.references.publish(WeldReference(depth=math.nan, temperature=850.0))
    peer.commands.publish(WeldCommand(axial_force=math.inf, spindle_speed=1.0))
    peer.command(0, force=77.0)
    peer.until(lambda: peer.node.applied.ignored == 1 and peer.node.refused_references == 1)
    peer.until(lambda: peer.node.applied.latest.stamp_ns == 0)
    peer.tick(1)
    assert peer.controller.seen[-1][1].depth_mm == pytest.approx(2.66)
    assert peer.controller.seen[-1][2].force_kn == pytest.approx(77.0)


def test_commands_that_the_supervisor_did_not_send_are_ignored(start):
    peer = start()
    peer.refer()
    peer.tick(1000)
    peer.command(1000, force=77.0)
    for k, writer in (
        (0, ""),
        (1000, ""),
        (1000, "stranger"),
        (1001, "stranger"),
        (10**9, "stranger"),
    ):
        message = convert.command_message(Command(61.0, 310.0), k * STEP_NS, "echo")
        message.leader = writer
        peer.commands.publish(message)
    peer.until(lambda: peer.node.applied.ignored == 5)
    peer.tick(1001)
    assert peer.controller.seen[-1][2].force_kn == pytest.approx(77.0)


def test_parameters_reach_the_controller_at_runtime_if_they_are_good(start):
    peer = start("--ros-args", "-p", "gain:=2.0")
    assert peer.controller.gain == 2.0
    client = peer.peer.create_client(SetParameters, "/fsw_echo/set_parameters")
    peer.until(client.service_is_ready)

    def set_gain(value):
        request = SetParameters.Request(
            parameters=[Parameter("gain", value=value).to_parameter_msg()]
        )
        future = client.call_async(request)
        peer.until(future.done)
        return future.result().results[0]

    assert set_gain(3.0).successful
    assert peer.controller.gain == 3.0
    for bad, text in ((11.0, "gain"), (math.nan, "gain"), (7.0, "never good")):
        result = set_gain(bad)
        assert not result.successful
        assert text in result.reason
    assert peer.controller.gain == 3.0


def test_lockstep_waits_for_the_command_without_a_clock(start):
    """In simulated time nothing but data drives the node: no /clock is published here."""
    peer = start("--ros-args", "-p", "use_sim_time:=true", "-p", "lockstep_deadline:=5.0")
    peer.refer()
    peer.tick(0)
    for k in range(1, 30):
        peer.sense(k)
        peer.command(k - 1, force=70.0 + k)
        peer.until(lambda k=k: len(peer.got["proposal"]) == k + 1)
    assert [entry[2].force_kn for entry in peer.controller.seen[1:]] == pytest.approx(
        [70.0 + k for k in range(1, 30)]
    )


def test_repeated_lockstep_tick_gets_the_same_answer_without_a_step(start):
    peer = start("--ros-args", "-p", "use_sim_time:=true", "-p", "lockstep_deadline:=5.0")
    peer.refer()
    first = peer.tick(1)
    for count in (2, 3):
        peer.sense(1)
        peer.until(
            lambda count=count: (
                len(peer.got["proposal"]) == count and len(peer.got["status"]) == count
            )
        )
    assert peer.got["proposal"] == [first] * 3
    assert len(peer.controller.seen) == 1
    peer.sense(1, sensors=("depth", "torque"))  # a sensor that sends twice is no repeated tick
    peer.command(1)
    peer.tick(2)
    assert len(peer.got["proposal"]) == 4
    assert len(peer.controller.seen) == 2


def test_content_of_a_file_that_a_parameter_names_is_stated(tmp_path):
    """Its path alone says nothing of what the controller was tuned with."""
    hashes = {}
    for name, text in (("a", "gain: 1"), ("b", "gain: 2"), ("c", "gain: 1")):
        (tmp_path / name).write_text(text)
        hashes[name] = sha256(text.encode()).hexdigest()
    rclpy.init(args=["test", "--ros-args", "-p", f"tuning_file:={tmp_path / 'a'}"])
    try:
        node = ControllerNode("echo", Echo, FileParameters)

        def stated():
            return node.get_parameter("tuning_file_sha256").value

        assert stated() == hashes["a"]
        for name in ("b", "c"):
            file = Parameter("tuning_file", value=str(tmp_path / name))
            assert node.set_parameters([file])[0].successful and stated() == hashes[name]
        [other] = node.set_parameters([Parameter("tuning_file_sha256", value="x" * 64)])
        assert not other.successful and stated() == hashes["c"]
        assert node.set_parameters([Parameter("tuning_file", value="")])[0].successful
        assert stated() == ""
        node.destroy_node()
    finally:
        rclpy.try_shutdown()


def test_bad_parameter_at_start_is_refused():
    rclpy.init(args=["test", "--ros-args", "-p", "gain:=99.0"])
    try:
        with pytest.raises(Exception, match="gain"):
            ControllerNode("echo", Echo, EchoParameters)
    finally:
        rclpy.try_shutdown()


def test_the_controller_logs_in_the_name_of_its_node():
    made = []
    rclpy.init(args=["test", "--ros-args", "-r", "__ns:=/cell1"])
    try:
        node = ControllerNode(
            "echo", lambda values: made.append(Echo(values)) or made[-1], EchoParameters
        )
        assert made[0].logger.name == "cell1.fsw_echo"
        node.destroy_node()
    finally:
        rclpy.try_shutdown()
