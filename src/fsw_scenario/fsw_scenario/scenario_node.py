"""Plays a scenario in the graph: set-points and switches, each before its tick.

The plant plays its own part (disturbances, faults) from the same file; see its parameter ``scenario``.
"""

from __future__ import annotations

import sys
import time
from collections import deque
from collections.abc import Sequence
from math import nan

import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.topic_endpoint_info import TopicEndpointInfo
from std_msgs.msg import Header, String

from fsw_control import messages_ros as convert
from fsw_control.contract import Reference
from fsw_control.message_synchronizer import StampFilter
from fsw_control.node_arguments import NodeArguments
from fsw_control.node_main_ros import run
from fsw_control.parameters import load as load_parameters
from fsw_control.parameters_ros import declare
from fsw_control.ramps import stair
from fsw_control.references_ros import reference_queue, subscribe_sent
from fsw_control.status_file import write_status
from fsw_control.topics_ros import LATCHED, LATEST, PLAYER_READY, STREAM, subscribe_sensors
from fsw_control.weld import TICK_NS
from fsw_msgs.msg import WeldReference, WeldReferencePlan
from fsw_scenario.launcher import ABORTED
from fsw_scenario.scenario import start_reference
from fsw_scenario.scenario_file import load
from fsw_scenario.timeline import references, switches
from fsw_scenario.weld_programme import READING_AGE_TICKS, PhaseMachine, State
from fsw_scenario.weld_programme_course import Course
from fsw_scenario.weld_programme_ros import ProgrammeServer

#: References are sent ahead with their time in the stamp, so that none comes late however fast the ticks are; half of
#: what the topic keeps.
_AHEAD = LATCHED.depth // 2
#: On the wall clock a reference is sent this long before it holds, whichever machine's clock is ahead.
_AHEAD_REAL_NS = 5_000_000_000
#: mark by which this node recognises its own set-points
_MARK = "programme {}"


class ScenarioNode(Node):
    """The player; ``source`` is a scenario in place of the parameter ``scenario``.

    It subscribes to the sensors only when the first set-points have been sent and the controllers listen, so a plant
    that waits for its subscribers starts when everything is ready. When the scenario is over it ends the process.

    Raises
    ------
    fsw_schema.models.InputError
        If the scenario is wrong.
    """

    def __init__(self, source: str | None = None) -> None:
        super().__init__("fsw_scenario")
        settings = declare(self, "fsw_scenario", "player.yaml")
        self._scenario = load(source or settings["scenario"], settings["overrides"])
        self._controllers: int = settings["wait_for_controllers"]
        self._silence_s: float = settings["silence_timeout_s"]
        self._simulated = bool(self.get_parameter("use_sim_time").value)
        self._course = Course(references(self._scenario, start_reference(self._scenario.plant)))
        #: what the controllers follow, by the same rule, including what this node sends
        self._received = reference_queue(self)
        self._mark, self._mark_received, self._restarts = _MARK.format(0), False, 0
        self._stamps = StampFilter(silence_s=1.0)
        self._switches = deque(switches(self._scenario).items())
        self._first_ns: int | None = None
        self._stamp_ns = 0
        self._shown: deque[tuple[int, float]] = deque(maxlen=10 * READING_AGE_TICKS)  #: by the thermocouple
        self._tick = 0  #: of the scenario; that of the process is larger by the ticks held
        self._held = 0
        self._reported = -self._scenario.n_ticks  # the first tick is reported
        self._last_sample_s = self._began_s = time.monotonic()
        self.finished = False
        self._setpoints = self.create_publisher(WeldReference, "fsw/reference", LATCHED)
        self._plan = self.create_publisher(WeldReferencePlan, "fsw/reference_plan", LATEST)
        self._requests = self.create_publisher(String, "fsw/switch_request", STREAM)
        self._ready = self.create_publisher(Header, PLAYER_READY, LATEST)
        self._watch = self.create_timer(0.05, self._on_watch, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._programme: ProgrammeServer | None = None
        self._listening = False

    def _on_watch(self) -> None:
        if not self._listening and self._controllers_listen() and self._is_alone():
            self._begin()
        if self._programme is not None and self._programme.machine.state is State.ABORTED:
            self._programme.ask_safe_stop()
            if self._programme.stopped:
                self._programme.publish(self._stamp_ns)
                self._end(f"the weld is {self._programme.machine.describe()}; {self._programme.stopped}", ABORTED)
        if not self.finished and time.monotonic() - self._last_sample_s > self._silence_s:
            self._end(f"{self._missing()} for {self._silence_s:g} s; is the graph running, on the same domain?")

    def _missing(self) -> str:
        if self._listening:
            return "no measurement on fsw/depth"
        return f"no {self._controllers} controllers listening" if self._is_alone() else "another scenario player there"

    def _controllers_listen(self) -> bool:
        """Whether all that listen to set-points get them, and enough of these are controllers."""
        infos = self.get_subscriptions_info_by_topic(self._setpoints.topic_name)
        if self._setpoints.get_subscription_count() < len(infos):
            return False
        proposals = [name for name, _ in self.get_topic_names_and_types() if name.endswith("/proposal")]
        proposing = {_node_of(info) for name in proposals for info in self.get_publishers_info_by_topic(name)}
        return len(proposing.intersection(map(_node_of, infos))) >= self._controllers

    def _is_alone(self) -> bool:
        """Whether no other player sets the points of this weld; one that was killed is seen until its lease ends."""
        me = (self.get_namespace(), self.get_name())
        senders = map(_node_of, self.get_publishers_info_by_topic(self._setpoints.topic_name))
        return sum(sender == me for sender in senders) < 2

    def _begin(self) -> None:
        self._listening = True
        self._last_sample_s = time.monotonic()
        _, first = self._course.coming.popleft()
        if self._simulated:
            self._announce()
        self._send(first, 0)
        if self._simulated:
            self._send_ahead()
        if self._scenario.phases:
            machine = PhaseMachine(self._scenario.phases)
            self._programme = ProgrammeServer(self, machine, self._course, self._in_force, self._restart)
            subscribe_sent(self, self._received, self._on_received)
        subscribe_sensors(self, self._on_sample)
        self.get_logger().info(f"playing {self._scenario.name}: {self._scenario.duration_s:g} s")

    def _on_sample(self, sensor: str, stamp_ns: int, value: float) -> None:
        if sensor == "thermocouple":
            self._shown.append((stamp_ns, value))
        self._follow(sensor, stamp_ns, value)
        if sensor == "depth" and self._simulated and not self.finished:
            self._ready.publish(Header(stamp=convert.stamp_from_ns(stamp_ns)))

    def _follow(self, sensor: str, stamp_ns: int, value: float) -> None:
        """Continue with the depth; the other sensors confirm a jump in time."""
        before_ns = self._stamps.newest_ns
        accepted = self._stamps.offer(sensor, stamp_ns, value, time.monotonic())
        if accepted is None:
            return
        if accepted.jumped and self._first_ns is not None and before_ns is not None and stamp_ns > before_ns:
            self.get_logger().warning(
                "the measurements' time has jumped: the scenario continues from its present position"
            )
            self._first_ns += stamp_ns - before_ns - TICK_NS
            present = self._course.programme_at(self._tick)
            if self._course.followed:
                self._course.resume(present, self._tick)
                self._restart(present)
        if "depth" in accepted.samples:
            self._on_depth(stamp_ns)

    def _on_depth(self, stamp_ns: int) -> None:
        if self._first_ns is None:
            self._first_ns = TICK_NS if self._simulated else stamp_ns
            self._began_s = time.monotonic()
            if not self._simulated:
                self._announce()
        self._last_sample_s = time.monotonic()
        self._tick = 1 + round((stamp_ns - self._first_ns) / TICK_NS)
        if self._programme is not None:
            machine, self._stamp_ns = self._programme.machine, stamp_ns
            jumped = machine.follow(self._tick, self._reading_c(stamp_ns))
            self._tick, self._held = machine.tick, machine.held
            self._received.at(stamp_ns)
            if jumped and self._course.followed:
                present = self._in_force()
                self._course.resume(present, self._tick)
                self._restart(present)
                self.get_logger().info(f"temperature reached: {machine.describe()}")
            if self._course.followed and self._mark_received and self._received.mark != self._mark:
                self.get_logger().warning(
                    "manual set-points are in force; those of the programme follow after a resume"
                )
                self._course.leave()
                self._announce()
            self._programme.on_tick(stamp_ns)
            if machine.state in (State.HELD, State.ABORTED):
                return
        self._send_ahead()
        while self._switches and self._switches[0][0] <= self._tick + 1:
            _, controller = self._switches.popleft()
            self._requests.publish(String(data=controller))
        if (self._tick - self._reported) * 100 >= self._scenario.n_ticks:
            self._reported = self._tick
            self._report(False)
        if self._tick >= self._scenario.n_ticks:
            self._end("")

    def _reading_c(self, stamp_ns: int) -> float:
        """The thermocouple's reading some ticks ago; NaN where it is unknown."""
        known_ns = stamp_ns - READING_AGE_TICKS * TICK_NS
        return next((value for at_ns, value in reversed(self._shown) if at_ns <= known_ns), nan)

    def _report(self, finished: bool) -> None:
        tick, wall_s = min(self._tick, self._scenario.n_ticks), time.monotonic() - self._began_s
        write_status(tick=tick, finished=finished, wall_s=round(wall_s, 3))

    def _on_received(self, mark: str) -> None:
        """Note that this node's newest set-points have arrived; those with another mark are then someone else's."""
        self._mark_received = self._mark_received or mark == self._mark

    def _in_force(self) -> Reference:
        """The set-points that the controllers follow now."""
        return self._received.at(self._stamp_ns) or self._course.programme_at(self._tick)

    def _restart(self, present: Reference) -> None:
        """Send set-points that take effect at once and void those sent ahead, and then the future ones."""
        self._restarts += 1
        self._mark, self._mark_received = _MARK.format(self._restarts), False
        self._announce()
        self._send(present, 0)
        self._send_ahead()

    def _send(self, one: Reference, stamp_ns: int) -> None:
        mark = self._mark if self._scenario.phases else ""
        self._setpoints.publish(convert.reference_message(one, stamp_ns, mark=mark))

    def _announce(self) -> None:
        """Publish the plan of all set-points, where the scenario has one."""
        if self._scenario.announced:
            planned = [(self._time_ns(tick), reference) for tick, reference in stair(self._course.coming)]
            self._plan.publish(convert.reference_plan_message(planned, self._time_ns(0)))

    def _time_ns(self, tick: int) -> int:
        return (tick + self._held) * TICK_NS + (0 if self._first_ns is None else self._first_ns - TICK_NS)

    def _send_ahead(self) -> None:
        coming = self._course.coming
        for _ in range(_AHEAD):
            if not coming or coming[0][0] > self._horizon():
                return
            tick, reference = coming.popleft()
            self._send(reference, self._time_ns(tick))

    def _horizon(self) -> int:
        if not self._simulated:
            return self._tick + _AHEAD_REAL_NS // TICK_NS
        # Steps are few and all go out at the start; a ramp or a sine has a reference per tick.
        return self._tick + _AHEAD if len(self._course.coming) > _AHEAD else self._scenario.n_ticks

    def _end(self, failure: str, code: int = 1) -> None:
        """End the process, with an exit code after a failure."""
        if self.finished:
            return
        self.finished = True
        if failure:
            print(f"scenario: {failure}", file=sys.stderr, flush=True)
            raise SystemExit(code)
        self.get_logger().info(f"{self._scenario.name} is over after {self._scenario.duration_s:g} s")
        self._report(True)
        rclpy.try_shutdown()

    def destroy_node(self) -> None:
        """End; a scenario that was not played to its end is reported."""
        if not self.finished:
            print("scenario: stopped before the end of the scenario", file=sys.stderr)
        super().destroy_node()


def _node_of(info: TopicEndpointInfo) -> tuple[str, str]:
    return info.node_namespace, info.node_name


def main(args: Sequence[str] | None = None) -> int:
    """Play a scenario; ``args`` as ``sys.argv``, with an optional scenario before ``--ros-args``.

    Returns
    -------
    int
        0 when the scenario was played to its end, or stopped before (which is reported); 1 when it cannot go on, 2
        when an argument is wrong, 3 when the programme was aborted.
    """
    parameters = load_parameters("fsw_scenario", "player.yaml")
    return run(ScenarioNode, args, NodeArguments("fsw_scenario", __doc__ or "", parameters, "[SCENARIO]"))


if __name__ == "__main__":
    sys.exit(main())
