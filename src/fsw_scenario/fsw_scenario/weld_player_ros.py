"""Plays one scenario in the graph: set-points and switches, each before its tick."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from math import nan
from typing import NamedTuple

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.subscription import Subscription
from std_msgs.msg import Header, String

from fsw_control import messages_ros as convert
from fsw_control import units
from fsw_control.contract import Reference
from fsw_control.message_synchronizer import StampFilter
from fsw_control.ramps import stair
from fsw_control.references_ros import reference_queue, subscribe_sent
from fsw_control.status_file import write_status
from fsw_control.topics_ros import LATCHED, LATEST, PLAYER_READY, STREAM, subscribe_sensors
from fsw_control.weld import TICK_NS, TICK_S
from fsw_msgs.msg import WeldProgress, WeldReference, WeldReferencePlan
from fsw_scenario.audience_ros import Audience
from fsw_scenario.deviations import Deviations
from fsw_scenario.emulator_events_ros import EmulatorEvents
from fsw_scenario.running_kpi import RunningKpi
from fsw_scenario.scenario import Scenario, start_reference
from fsw_scenario.timeline import references, switches
from fsw_scenario.weld_programme import READING_AGE_TICKS, PhaseMachine, State
from fsw_scenario.weld_programme_course import Course
from fsw_scenario.weld_programme_ros import TICKS_PER_REPORT, ProgrammeServer, SafeStop

#: References are sent ahead with their time in the stamp, so that none comes late however fast the ticks are; half of
#: what the topic keeps.
_AHEAD = LATCHED.depth // 2
#: On the wall clock a reference is sent this long before it holds, whichever machine's clock is ahead.
_AHEAD_REAL_NS = 5_000_000_000
#: a controller that a goal names must be found within this time
_CONTROLLER_S = 5.0
#: mark by which the player recognises its own set-points
_MARK = "programme {}"
FAILED = "failed"
_TIME_JUMPED = "the measurements' time has jumped: the scenario continues from its present position"


class Outcome(NamedTuple):
    """How a weld has ended: ``verdict`` is ``done``, ``aborted`` or ``failed``."""

    verdict: str
    message: str


@dataclass(frozen=True, slots=True)
class PlayerOptions:
    """How a scenario is played."""

    wait_for_controllers: int
    silence_timeout_s: float
    #: whether the plant and the controllers were started for this scenario: the player then is part of the first tick
    #: in simulated time, and the plant plays its own part of the scenario
    from_start: bool


class WeldPlayer:
    """Plays a scenario from the next tick on; ``over`` gets the outcome, ``report`` the progress once a second.

    It subscribes to the sensors only when the first set-points have been sent and the controllers listen, so a plant
    that waits for its subscribers starts when everything is ready.
    """

    def __init__(
        self,
        node: Node,
        scenario: Scenario,
        options: PlayerOptions,
        report: Callable[[WeldProgress], object],
        over: Callable[[Outcome], object],
    ) -> None:
        self._node, self.scenario, self._options, self._tell, self._over = node, scenario, options, report, over
        self._simulated = bool(node.get_parameter("use_sim_time").value)
        self._synchronous = self._simulated and options.from_start
        self.kpi = RunningKpi()
        self._course = Course(references(scenario, start_reference(scenario.plant)))
        #: what the controllers follow, by the same rule, including what this node sends
        self._received = reference_queue(node)
        # a scenario given at start sends none, so that its bag stays what it was
        self._mark = _MARK.format(0) if scenario.phases or not options.from_start else ""
        self._mark_received, self._restarts = False, 0
        self._stamps = StampFilter(silence_s=1.0)
        self._switches = deque(switches(scenario).items())
        if not options.from_start and "controller" in scenario.model_fields_set:
            self._switches.appendleft((0, scenario.controller))
        named = [name for _, name in self._switches]
        self._deviations = Deviations()
        self._first_ns: int | None = None
        self._stamp_ns = 0
        self._shown: deque[tuple[int, float]] = deque(maxlen=10 * READING_AGE_TICKS)  #: by the thermocouple
        self._tick = 0  #: of the scenario; that of the process is larger by the ticks held
        self._held = 0
        self._reported = -scenario.n_ticks  # the first tick is reported
        self._fed = self._judged = 0  #: ticks of the last feedback and of the last figures of merit
        self._last_sample_s = self._began_s = time.monotonic()
        self.finished = self._aborted = False
        self._setpoints = node.create_publisher(WeldReference, "fsw/reference", LATCHED)
        self._plan = node.create_publisher(WeldReferencePlan, "fsw/reference_plan", LATEST)
        self._requests = node.create_publisher(String, "fsw/switch_request", STREAM)
        self._ready = node.create_publisher(Header, PLAYER_READY, LATEST) if self._simulated else None
        self._emulator = None if options.from_start else EmulatorEvents(node, scenario)
        self._audience = Audience(node, self._setpoints, options.wait_for_controllers, named)
        self._stop = SafeStop(node)
        self._watch = node.create_timer(0.05, self._on_watch, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._programme: ProgrammeServer | None = None
        self._subscriptions: list[Subscription] = []
        self._listening = False

    def destroy(self) -> None:
        """Leave the graph."""
        node = self._node
        node.destroy_timer(self._watch)
        for subscription in self._subscriptions:
            node.destroy_subscription(subscription)
        for publisher in (self._setpoints, self._plan, self._requests, self._ready):
            if publisher is not None:
                node.destroy_publisher(publisher)
        for part in (self._stop, self._emulator, self._programme):
            if part is not None:
                part.destroy()

    def abort(self) -> tuple[bool, str]:
        """Give the weld up and ask for the safe stop; returns whether, and the answer in words."""
        if self._programme is not None:
            ok, answer = self._programme.abort()
        else:
            ok, answer = not (self.finished or self._aborted), f"aborted at {self._tick * TICK_S:.1f} s"
            if ok and self._listening:
                present = self._in_force()
                self._course.leave()
                self._send(present, 0)  # voids those sent ahead
        self._aborted = self._aborted or ok
        return ok, answer

    def describe(self) -> str:
        """State of the weld in words."""
        if self._programme is not None:
            return self._programme.machine.describe()
        return f"{State.ABORTED if self._aborted else State.RUNNING} at {self._tick * TICK_S:.1f} s"

    def _on_watch(self) -> None:
        if self.finished:
            return
        absent = "" if self._listening else self._audience.absent()
        if not (self._listening or absent) and self._audience.is_complete() and self._audience.is_alone():
            self._begin()
        if self._aborted or (self._programme is not None and self._programme.machine.state is State.ABORTED):
            self._stop.ask()
            if self._stop.answer:
                if self._programme is not None:
                    self._programme.publish(self._stamp_ns)
                self._end(State.ABORTED, f"the weld is {self.describe()}; {self._stop.answer}")
        silence_s = self._options.silence_timeout_s
        silent_s = time.monotonic() - self._last_sample_s
        if absent and not self._options.from_start and silent_s > _CONTROLLER_S:
            self._end(FAILED, f"{absent}; start it, or name another one")
        elif silent_s > silence_s:
            missing = "no measurement on fsw/depth" if self._listening else self._audience.missing()
            self._end(FAILED, f"{missing} for {silence_s:g} s; is the graph running, on the same domain?")

    def _begin(self) -> None:
        self._listening = True
        self._last_sample_s = time.monotonic()
        _, first = self._course.coming.popleft()
        if self._synchronous:
            self._announce()
        self._send(first, 0)
        if self._synchronous:
            self._send_ahead()
        if self.scenario.phases:
            machine = PhaseMachine(self.scenario.phases)
            self._programme = ProgrammeServer(
                self._node, machine, self._course, self._in_force, self._restart, self._tell
            )
        self._subscriptions.append(subscribe_sent(self._node, self._received, self._on_received))
        if self._programme is not None or not self._options.from_start:
            self._stop.watch(self.abort)
        self._subscriptions += subscribe_sensors(self._node, self._on_sample)
        self._node.get_logger().info(f"playing {self.scenario.name}: {self.scenario.duration_s:g} s")

    def _on_sample(self, sensor: str, stamp_ns: int, value: float) -> None:
        if sensor == "thermocouple":
            self._shown.append((stamp_ns, value))
        self._follow(sensor, stamp_ns, value)
        if sensor == "depth" and self._ready is not None and not self.finished:
            self._ready.publish(Header(stamp=convert.stamp_from_ns(stamp_ns)))

    def _follow(self, sensor: str, stamp_ns: int, value: float) -> None:
        """Continue with the depth; the other sensors confirm a jump in time."""
        before_ns = self._stamps.newest_ns
        accepted = self._stamps.offer(sensor, stamp_ns, value, time.monotonic())
        if accepted is None:
            return
        if accepted.jumped and self._first_ns is not None and before_ns is not None and stamp_ns > before_ns:
            self._node.get_logger().warning(_TIME_JUMPED)
            self._first_ns += stamp_ns - before_ns - TICK_NS
            present = self._course.programme_at(self._tick)
            if self._course.followed:
                self._course.resume(present, self._tick)
                self._restart(present)
        if "depth" in accepted.samples and not self.finished:
            self._on_depth(stamp_ns, accepted.samples["depth"])

    def _on_depth(self, stamp_ns: int, depth_mm: float) -> None:
        if self._first_ns is None:
            self._first_ns = TICK_NS if self._synchronous else stamp_ns
            self._began_s = time.monotonic()
            if not self._synchronous:
                self._announce()
        self._last_sample_s = time.monotonic()
        self._tick, self._stamp_ns = 1 + round((stamp_ns - self._first_ns) / TICK_NS), stamp_ns
        if self._programme is not None:
            machine = self._programme.machine
            jumped = machine.follow(self._tick, _reading_c(self._shown, stamp_ns))
            self._tick, self._held = machine.tick, machine.held
            if jumped and self._course.followed:
                present = self._in_force()
                self._course.resume(present, self._tick)
                self._restart(present)
                self._node.get_logger().info(f"temperature reached: {machine.describe()}")
        self._yield_to_hand()
        if self._programme is not None:
            self._programme.on_tick(stamp_ns)
        self._judge(depth_mm)
        if self._programme is None:
            self._feed_back(stamp_ns)
        if self._aborted or (self._programme and self._programme.machine.state in (State.HELD, State.ABORTED)):
            return
        self._send_ahead()
        if self._emulator is not None:
            self._emulator.send_until(self._tick + 1)
        while self._switches and self._switches[0][0] <= self._tick + 1:
            _, controller = self._switches.popleft()
            self._deviations.ask(controller, self._tick)
            self._requests.publish(String(data=controller))
        if (self._tick - self._reported) * 100 >= self.scenario.n_ticks:
            self._reported = self._tick
            self._report(False)
        if self._tick >= self.scenario.n_ticks:
            self._report(True)
            over = f"{self.scenario.name} is over after {self.scenario.duration_s:g} s"
            self._end(State.DONE, f"{over}{self._deviations}")

    def _yield_to_hand(self) -> None:
        """Send nothing more when set-points that are not this node's are in force."""
        self._received.at(self._stamp_ns)
        if not (self._course.followed and self._mark_received and self._received.mark != self._mark):
            return
        what = "no more in this scenario" if self._programme is None else "after a resume"
        self._node.get_logger().warning(f"manual set-points are in force; those planned follow {what}")
        self._course.leave()
        self._announce()
        if self._programme is None:
            self._deviations.note_by_hand(self._tick)

    def _judge(self, depth_mm: float) -> None:
        """Keep the figures of merit, and who is in control."""
        ticks, self._judged = self._tick + self._held - self._judged, self._tick + self._held
        self._deviations.count(self._stop.controller, self._tick, ticks)
        planned = self._programme is None and self._course.followed
        wanted = self._course.programme_at(self._tick) if planned else self._in_force()
        shown_c = self._shown[-1][1] if self._shown else nan
        self.kpi.add(max(ticks, 0) * TICK_S, wanted, depth_mm, shown_c)

    def _feed_back(self, stamp_ns: int) -> None:
        """Report the progress of a scenario without phases, when it is due."""
        left = max(self.scenario.n_ticks - self._tick, 0)
        if left and 0 < self._tick - self._fed < TICKS_PER_REPORT:
            return
        self._fed = self._tick
        state = State.RUNNING if left else State.DONE
        state = State.ABORTED if self._aborted else state
        self._tell(_progress(stamp_ns, state, left, self._course.programme_at(self._tick), not self._course.followed))

    def _report(self, finished: bool) -> None:
        tick, wall_s = min(self._tick, self.scenario.n_ticks), time.monotonic() - self._began_s
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
        self._setpoints.publish(convert.reference_message(one, stamp_ns, mark=self._mark))

    def _announce(self) -> None:
        """Publish the plan of all set-points, where the scenario has one."""
        if self.scenario.announced:
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
        if not self._synchronous:
            return self._tick + _AHEAD_REAL_NS // TICK_NS
        # Steps are few and all go out at the start; a ramp or a sine has a reference per tick.
        return self._tick + _AHEAD if len(self._course.coming) > _AHEAD else self.scenario.n_ticks

    def _end(self, verdict: str, message: str) -> None:
        if not self.finished:
            self.finished = True
            self._over(Outcome(verdict, message))


def _reading_c(shown: Iterable[tuple[int, float]], stamp_ns: int) -> float:
    """The thermocouple's reading some ticks ago; NaN where it is unknown."""
    known_ns = stamp_ns - READING_AGE_TICKS * TICK_NS
    return next((value for at_ns, value in reversed([*shown]) if at_ns <= known_ns), nan)


def _progress(stamp_ns: int, state: State, ticks_left: int, planned: Reference, left: bool) -> WeldProgress:
    """The progress of a scenario without phases."""
    return WeldProgress(
        header=convert.header(stamp_ns),
        state=str(state),
        time_left=ticks_left * TICK_S,
        depth=units.m_from_mm(planned.depth_mm),
        temperature=planned.temperature_c,
        left=left,
    )
