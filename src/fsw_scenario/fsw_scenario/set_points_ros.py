"""Sends the set-points of a scenario to the controllers: marked, announced, and ahead of time."""

from __future__ import annotations

from dataclasses import dataclass

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.subscription import Subscription

from fsw_control import messages_ros as convert
from fsw_control.contract import Reference
from fsw_control.ramps import stair
from fsw_control.references_ros import reference_queue, subscribe_sent
from fsw_control.topics_ros import LATCHED, LATEST
from fsw_control.weld import TICK_NS
from fsw_msgs.msg import HeatPlan, WeldReference, WeldReferencePlan
from fsw_scenario.scenario import Scenario, start_reference
from fsw_scenario.timeline import references
from fsw_scenario.weld_programme import PhaseMachine
from fsw_scenario.weld_programme_course import Course, HeatAhead

#: Number of references sent ahead with their time in the stamp, so that none is late however fast
#: the ticks are; half of what the topic keeps.
_AHEAD = LATCHED.depth // 2
#: On the wall clock a reference is sent this long in advance, whichever machine's clock is ahead.
_AHEAD_REAL_NS = 5_000_000_000
#: in lockstep, time limit for a delivery on a busy machine, also to a dead node (chosen)
DELIVERY = Duration(seconds=2)
#: mark by which the player recognises its own set-points
_MARK = "programme {}"


@dataclass(slots=True)
class ScenarioTime:
    """Position of the newest measurement in the scenario."""

    machine: PhaseMachine  #: has the scenario's tick, and by how many the process's leads it
    first_ns: int | None = None  #: stamp of its first tick
    stamp_ns: int = 0  #: of the newest measurement

    def ns(self, tick: int) -> int:
        """Stamp of a tick of the scenario."""
        begin_ns = 0 if self.first_ns is None else self.first_ns - TICK_NS
        return (tick + self.machine.held) * TICK_NS + begin_ns


class SetPoints:
    """Sends the set-points of a scenario, and tracks those that the controllers follow.

    ``synchronous``: the player is part of the first tick in simulated time, so that all known
    set-points are sent before.
    """

    def __init__(
        self,
        node: Node,
        scenario: Scenario,
        time: ScenarioTime,
        from_start: bool,
        synchronous: bool,
        heat: HeatAhead | None = None,
    ) -> None:
        self._node, self._scenario, self._time = node, scenario, time
        self._synchronous, self._heat = synchronous, heat
        self.course = Course(references(scenario, start_reference(scenario.plant)))
        #: set-points that the controllers follow, by the same rules, including this node's
        self.received = reference_queue(node)
        # a scenario given at the start sends none, so that its bag is unchanged
        self._mark = _MARK.format(0) if scenario.phases or not from_start else ""
        self._mark_received, self._restarts = False, 0
        self._references = node.create_publisher(WeldReference, "fsw/reference", LATCHED)
        self._plan = node.create_publisher(WeldReferencePlan, "fsw/reference_plan", LATEST)
        self._heat_plan = node.create_publisher(HeatPlan, "fsw/heat_plan", LATEST)
        self.publishers = [self._references, self._plan, self._heat_plan]
        self._subscription: Subscription | None = None

    def destroy(self) -> None:
        """Leave the graph; the known heat goes with the weld."""
        if self._heat is not None:
            self._heat_plan.publish(convert.heat_plan_message(None, self._time.stamp_ns))
            self._heat_plan.wait_for_all_acked(DELIVERY)
        if self._subscription is not None:
            self._node.destroy_subscription(self._subscription)
        for publisher in self.publishers:
            self._node.destroy_publisher(publisher)

    def begin(self) -> None:
        """Send the first set-points, and listen to all set-points from now on."""
        _, first = self.course.coming.popleft()
        if self._synchronous:
            self.announce()
            self.announce_heat()
        self._send(first, 0)
        if self._synchronous:
            self.send_ahead()
        self._subscription = subscribe_sent(self._node, self.received, self._on_received)

    def have_arrived(self) -> bool:
        """Whether all subscribers have received everything."""
        return all(publisher.wait_for_all_acked(Duration()) for publisher in self.publishers)

    def _on_received(self, mark: str) -> None:
        """Note that this node's newest set-points have arrived; other marks are someone else's."""
        self._mark_received = self._mark_received or mark == self._mark

    def in_force(self) -> Reference:
        """Set-points that the controllers follow now."""
        return self.received.at(self._time.stamp_ns) or self.planned()

    def planned(self) -> Reference:
        """The scenario's set-points at its present tick."""
        return self.course.programme_at(self._time.machine.tick)

    def are_by_hand(self) -> bool:
        """Whether foreign set-points are in force while this node still sends its own."""
        self.received.at(self._time.stamp_ns)
        return self.course.followed and self._mark_received and self.received.mark != self._mark

    def resume(self, present: Reference, warm: bool = False) -> None:
        """Resume the programme from the present set-points and tick, if it has been left."""
        if self.course.followed:
            self.course.resume(present, self._time.machine.tick, warm)
            self.restart(present)

    def restart(self, present: Reference) -> None:
        """Send set-points, effective at once and voiding those sent ahead, and the future ones."""
        self._restarts += 1
        self._mark, self._mark_received = _MARK.format(self._restarts), False
        self.announce()
        self.announce_heat()
        self._send(present, 0)
        self.send_ahead()
        if self._synchronous:  # the plant takes its next step after this
            for publisher in self.publishers:
                publisher.wait_for_all_acked(DELIVERY)

    def _send(self, reference: Reference, stamp_ns: int) -> None:
        self._references.publish(convert.reference_message(reference, stamp_ns, mark=self._mark))

    def announce(self) -> None:
        """Publish the plan of all set-points if the scenario has one."""
        if self._scenario.announced:
            planned = [
                (self._time.ns(tick), reference) for tick, reference in stair(self.course.coming)
            ]
            self._plan.publish(convert.reference_plan_message(planned, self._time.stamp_ns))

    def announce_heat(self) -> None:
        """Publish the heat along the path from where the programme is now, if it is known.

        A programme that is held or aborted withdraws it: the tool does not move along the path.
        """
        if self._heat is not None:
            plan = self._heat.plan(self._time.ns(0) * 1e-9) if self.course.followed else None
            self._heat_plan.publish(convert.heat_plan_message(plan, self._time.stamp_ns))

    def send_ahead(self) -> None:
        """Send set-points that are due soon."""
        coming = self.course.coming
        for _ in range(_AHEAD):
            if not coming or coming[0][0] > self._horizon():
                return
            tick, reference = coming.popleft()
            self._send(reference, self._time.ns(tick))

    def _horizon(self) -> int:
        tick = self._time.machine.tick
        if not self._synchronous:
            return tick + _AHEAD_REAL_NS // TICK_NS
        # Steps are few and all sent at the start; a ramp or a sine has a reference per tick.
        return tick + _AHEAD if len(self.course.coming) > _AHEAD else self._scenario.n_ticks
