"""Plays a scenario in the graph: set-points and switches, each before its tick."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from math import nan

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.subscription import Subscription
from std_msgs.msg import Header

from fsw_control import messages_ros as convert
from fsw_control.coded import Answer, Fact
from fsw_control.message_synchronizer import StampFilter
from fsw_control.schema.files import write_status
from fsw_control.topics_ros import LATCHED, PLAYER_READY, subscribe_sensors
from fsw_control.weld import TICK_NS, TICK_S
from fsw_msgs.msg import WeldProgress
from fsw_scenario.discovery_ros import Discovery
from fsw_scenario.emulator_events_ros import EmulatorEvents
from fsw_scenario.running_kpi import FAILED, Deviations, Outcome, RunningKpi, WeldEnd
from fsw_scenario.scenario import Scenario
from fsw_scenario.set_points_ros import ScenarioTime, SetPoints
from fsw_scenario.switching_ros import Switching
from fsw_scenario.timeline import switches
from fsw_scenario.weld_programme import READING_AGE_TICKS, PhaseMachine, State
from fsw_scenario.weld_programme_course import HeatAhead
from fsw_scenario.weld_programme_ros import ProgrammeServer, SafeStop

#: time limit for finding a controller named by a goal
_CONTROLLER_S = 5.0
_TIME_JUMPED = (
    "the measurements' time has jumped: the scenario continues from its present position"
)


@dataclass(frozen=True, slots=True)
class PlayerOptions:
    """How a scenario is played."""

    wait_for_controllers: int
    silence_timeout_s: float
    #: plant and controllers were started for this scenario: the player is part of the first tick
    #: in simulated time, and the plant plays its own part of the scenario
    from_start: bool
    heat: HeatAhead | None = None  #: known along the path


class WeldPlayer:
    """Plays a scenario from the next tick on; ``over`` gets the outcome, ``report`` the progress.

    It subscribes to the sensors only when the controllers listen and the first set-points have
    been sent (in lockstep: received), so that a plant that waits for its subscribers starts when
    everything is ready. The progress is reported once a second.
    """

    def __init__(
        self,
        node: Node,
        scenario: Scenario,
        options: PlayerOptions,
        report: Callable[[WeldProgress], object],
        over: Callable[[Outcome], object],
    ) -> None:
        self._node, self.scenario, self._options = node, scenario, options
        self._feed_back, self._over = report, over
        self._simulated = bool(node.get_parameter("use_sim_time").value)
        self._synchronous = self._simulated and options.from_start
        self.kpi = RunningKpi()
        self.machine = PhaseMachine(scenario.phases, scenario.n_ticks)
        self.time = ScenarioTime(self.machine)
        self.set_points = SetPoints(
            node, scenario, self.time, options.from_start, self._synchronous, options.heat
        )
        self._stamps = StampFilter(lockstep=self._simulated)
        self._switches = deque(switches(scenario).items())
        if not options.from_start and "controller" in scenario.model_fields_set:
            self._switches.appendleft((0, scenario.controller))
        named = [name for _, name in self._switches]
        self.deviations = Deviations()
        #: readings of the thermocouple with their stamps
        self._shown: deque[tuple[int, float]] = deque(maxlen=10 * READING_AGE_TICKS)
        self._reported = -scenario.n_ticks  # the first tick is reported
        self._judged = 0  #: tick of the last figures of merit
        self._last_sample_s = self._began_s = time.monotonic()
        self.finished = False
        self._switching = Switching(node, self._permit_step)
        self._unanswered_ns: int | None = None  #: stamp of a depth, in lockstep
        self._ready = (
            node.create_publisher(Header, PLAYER_READY, LATCHED) if self._simulated else None
        )
        self._emulator = None if options.from_start else EmulatorEvents(node, scenario)
        self._discovery = Discovery(
            node, self.set_points.publishers, options.wait_for_controllers, named
        )
        self._stop = SafeStop(node)
        self._watch = node.create_timer(
            0.05, self._on_watch, clock=Clock(clock_type=ClockType.STEADY_TIME)
        )
        self._programme: ProgrammeServer | None = None
        self._subscriptions: list[Subscription] = []
        self._begun = self.listening = False

    def destroy(self) -> None:
        """Leave the graph."""
        node = self._node
        node.destroy_timer(self._watch)
        for subscription in self._subscriptions:
            node.destroy_subscription(subscription)
        if self._ready is not None:
            node.destroy_publisher(self._ready)
        parts = (self.set_points, self._switching, self._stop, self._emulator)
        for part in (*parts, self._programme):
            if part is not None:
                part.destroy()

    def abort(self, who: str = "") -> Answer:
        """Abort the weld and request the safe stop, for an operator."""
        answer = self.machine.abort() if self._programme is None else self._programme.abort()
        if answer.ok:
            self._stop.who = who
        return answer

    @property
    def controller(self) -> str:
        """The controller in control, as the supervisor has last reported; empty before."""
        return self._stop.controller

    def _on_watch(self) -> None:
        if self.finished:
            return
        self._switching.look()
        absent = "" if self._begun else self._discovery.absent()
        discovery, may_begin = self._discovery, not (self._begun or absent)
        if may_begin and discovery.is_complete() and discovery.is_alone():
            self._begin()
        may_listen = self._begun and not self.listening
        if may_listen and (not self._synchronous or self.set_points.have_arrived()):
            self._listen()
        if self.machine.state is State.ABORTED:
            self._stop.ask()
            if self._stop.answer is not None:
                if self._programme is not None:
                    self._programme.publish(self.time.stamp_ns)
                self._end(State.ABORTED, self._stop.answer, self.machine.describe())
        silence_s = self._options.silence_timeout_s
        silent_s = time.monotonic() - self._last_sample_s
        if absent and not self._options.from_start and silent_s > _CONTROLLER_S:
            self._end(FAILED, Fact.of(WeldEnd.NO_CONTROLLER, absent=absent))
        elif silent_s > silence_s:
            missing = self.missing()
            self._end(FAILED, Fact.of(WeldEnd.SILENT, missing=missing, time_s=silence_s))

    def missing(self) -> str:
        """What the player waits for, in words."""
        if not self._begun:
            return self._discovery.missing()
        topic = self.set_points.publishers[0].topic_name
        return (
            "no measurement on fsw/depth"
            if self.listening
            else f"no acknowledgement of {topic} by all subscribers"
        )

    def _begin(self) -> None:
        self._begun = True
        self._last_sample_s = time.monotonic()
        self.set_points.begin()
        self._programme = ProgrammeServer(
            self._node, self.scenario, self.machine, self.set_points, self._feed_back
        )
        if self.scenario.phases or not self._options.from_start:
            self._stop.watch(self.abort)

    def _listen(self) -> None:
        self.listening = True
        self._last_sample_s = time.monotonic()
        self._subscriptions += subscribe_sensors(self._node, self._on_sample)
        self._node.get_logger().info(
            f"playing {self.scenario.name}: {self.scenario.duration_s:g} s"
        )

    def _on_sample(self, sensor: str, stamp_ns: int, value: float) -> None:
        if sensor == "thermocouple":
            self._shown.append((stamp_ns, value))
        self._follow(sensor, stamp_ns, value)
        if sensor == "depth":
            self._unanswered_ns = stamp_ns
            self._permit_step()

    def _permit_step(self) -> None:
        """In lockstep, let the plant take its next step once the supervisor has all requests."""
        stamp_ns = self._unanswered_ns
        if self._ready is None or stamp_ns is None or self.finished or self._switching.pending:
            return
        self._unanswered_ns = None
        self._ready.publish(Header(stamp=convert.stamp_from_ns(stamp_ns)))

    def _follow(self, sensor: str, stamp_ns: int, value: float) -> None:
        """Advance by the depth sample; the other sensors confirm a jump in time."""
        before_ns = self._stamps.newest_ns
        accepted = self._stamps.offer(sensor, stamp_ns, value, time.monotonic())
        if accepted is None:
            return
        if (
            accepted.jumped
            and self.time.first_ns is not None
            and before_ns is not None
            and stamp_ns > before_ns
        ):
            self._node.get_logger().warning(_TIME_JUMPED)
            self.time.first_ns += stamp_ns - before_ns - TICK_NS
            self.set_points.resume(self.set_points.planned())
        if "depth" in accepted.samples and not self.finished:
            self._on_depth(stamp_ns, accepted.samples["depth"])

    def _on_depth(self, stamp_ns: int, depth_mm: float) -> None:
        if self.time.first_ns is None:
            self.time.first_ns = TICK_NS if self._synchronous else stamp_ns
            self._began_s = time.monotonic()
            if not self._synchronous:
                self.set_points.announce()
                self.set_points.announce_heat()
        self._last_sample_s = time.monotonic()
        self.time.stamp_ns = stamp_ns
        machine, number = self.machine, 1 + round((stamp_ns - self.time.first_ns) / TICK_NS)
        jumped = machine.follow(number, _reading_c(self._shown, stamp_ns))
        if jumped and self.set_points.course.followed:
            self.set_points.resume(self.set_points.in_force(), warm=True)
            self._node.get_logger().info(f"temperature reached: {machine.describe().words}")
        self._yield_to_hand()
        assert self._programme is not None
        self._judge(depth_mm)
        self._programme.on_tick(stamp_ns)
        if machine.state in (State.HELD, State.ABORTED):
            return
        self.set_points.send_ahead()
        if self._emulator is not None:
            self._emulator.send_until(machine.tick + 1)
        while self._switches and self._switches[0][0] <= machine.tick + 1:
            _, controller = self._switches.popleft()
            self.deviations.ask(controller, machine.tick)
            self._switching.ask(controller)
        if (machine.tick - self._reported) * 100 >= self.scenario.n_ticks:
            self._reported = machine.tick
            self._report(False)
        if machine.tick >= self.scenario.n_ticks:
            self._report(True)
            lasted_s = self.scenario.duration_s
            over = Fact.of(WeldEnd.OVER, scenario=self.scenario.name, time_s=lasted_s)
            self._end(State.DONE, over, *self.deviations.facts)

    def _yield_to_hand(self) -> None:
        """Stop sending if foreign set-points are in force."""
        if not self.set_points.are_by_hand():
            return
        when = "after a resume" if self.scenario.phases else "no more in this scenario"
        self._node.get_logger().warning(
            f"manual set-points are in force; those planned follow {when}"
        )
        self.set_points.course.leave()
        self.set_points.announce()
        if not self.scenario.phases:
            self.deviations.note_by_hand(self.machine.tick)

    def _judge(self, depth_mm: float) -> None:
        """Update the figures of merit and the controller in command."""
        welded = self.machine.tick + self.machine.held
        ticks, self._judged = welded - self._judged, welded
        self.deviations.count(self.controller, self.machine.tick, ticks)
        planned = not self.scenario.phases and self.set_points.course.followed
        target = self.set_points.planned() if planned else self.set_points.in_force()
        shown_c = self._shown[-1][1] if self._shown else nan
        self.kpi.add(max(ticks, 0) * TICK_S, target, depth_mm, shown_c)

    def _report(self, finished: bool) -> None:
        wall_s = time.monotonic() - self._began_s
        write_status(tick=self.machine.tick, finished=finished, wall_s=round(wall_s, 3))

    def _end(self, verdict: str, fact: Fact, *others: Fact) -> None:
        if not self.finished:
            self.finished = True
            self._over(Outcome(verdict, fact, others))


def _reading_c(shown: Iterable[tuple[int, float]], stamp_ns: int) -> float:
    """The thermocouple's reading some ticks ago; NaN if unknown."""
    known_ns = stamp_ns - READING_AGE_TICKS * TICK_NS
    return next((value for at_ns, value in reversed([*shown]) if at_ns <= known_ns), nan)
