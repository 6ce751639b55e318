"""Set-points as messages: sending, reports of those in force, and the request service."""

from __future__ import annotations

import time
import uuid
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from math import isnan, nan
from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.service import Service
from rclpy.subscription import Subscription
from rclpy.task import Future

from fsw_control import messages_ros as convert
from fsw_control import units
from fsw_control.coded import Answer, Fact, RefusedError, Worded
from fsw_control.contract import Reference
from fsw_control.ramps import duration_s, ramp, ramp_plan
from fsw_control.ranges import set_point_problem
from fsw_control.references import AHEAD_REAL_NS, OTHER_CLOCK_NS, ReferenceQueue, Refused, values
from fsw_control.reports_ros import OK, WARN, Report, Taken, told
from fsw_control.topics_ros import LATCHED, LATEST
from fsw_control.units import NANOSECONDS
from fsw_msgs.msg import WeldProgress, WeldReference, WeldReferencePlan
from fsw_msgs.srv import SetReference

#: a request succeeds if its set-points are in force within this time
_ANSWER_S = 2.0
#: the weld programme reports once a second; after this silence its player has ended (chosen)
_PROGRAMME_SILENT_S = 5.0
#: a ramp begins this long after the last tick, so that none of its steps is late
_LEAD_NS = 500_000_000
#: later issue times would exceed the range of a message's stamp
_LAST_NS = (2**31 - 1) * NANOSECONDS


class SetPoints(Worded):
    """Answers to a request for set-points, beside that they are not permitted."""

    STEP = "set-points {depth_mm:.4g} mm, {temperature_c:.5g} degC"
    RAMP = (
        "set-points {depth_mm:.4g} mm, {temperature_c:.5g} degC by a ramp over {duration_s:.1f} s"
    )
    NEXT = "{sent.words}, in force from the next measurement on"
    ON_STANDBY = "this supervisor is on standby now; send the request again"
    INCOMPLETE = "no set-points are in force yet; give both depth and temperature"
    NO_START = "no set-points are in force from which a ramp could start; send them without a ramp"
    PROGRAMME_RUNS = (
        "the programme of the weld runs and would override it: hold the programme first"
    )
    NO_LISTENER = "no controller listens to set-points; start one"
    OVERTAKEN = (
        "other set-points were received after them; check those in force and send them again"
    )
    UNCONFIRMED = "not confirmed within {wait_s:g} s; check the set-points in force"


_ON_STANDBY = Answer.refused(SetPoints.ON_STANDBY)


def reference_queue(
    node: Node, refuse: Callable[[Fact], object] = lambda _: None
) -> ReferenceQueue:
    """Return a node's set-point queue, for :func:`subscribe_references`."""
    simulated = bool(node.get_parameter("use_sim_time").value)
    return ReferenceQueue(OTHER_CLOCK_NS if simulated else AHEAD_REAL_NS, refuse)


def _converted(queue: ReferenceQueue, message: WeldReference) -> Reference | None:
    """Content of a message; None, after a report by ``queue``, if it is invalid."""
    try:
        return convert.reference(message)
    except RefusedError as error:
        queue.refuse(Fact.of(Refused.INVALID, why=error.fact))
        return None


def subscribe_sent(
    node: Node, queue: ReferenceQueue, received: Callable[[str], object] = lambda _: None
) -> Subscription:
    """Add the set-points on the topic to ``queue``; ``received`` gets the mark of each."""
    queue.join(time.time_ns())

    def on_sent(message: WeldReference, info: Any) -> None:
        reference = _converted(queue, message)
        if reference is None:
            return
        stamp_ns = convert.stamp_ns(message.header.stamp)
        queue.receive(stamp_ns, reference, info["source_timestamp"], time.time_ns(), message.mark)
        received(message.mark)

    return node.create_subscription(WeldReference, "fsw/reference", on_sent, LATCHED)


def subscribe_references(node: Node, queue: ReferenceQueue) -> None:
    """Add set-points to ``queue``: those sent, and those a supervisor states for late joiners."""
    subscribe_sent(node, queue)
    _subscribe_stated(node, queue, "fsw/supervisor/reference")


def _subscribe_stated(node: Node, queue: ReferenceQueue, topic: str) -> None:
    """Subscribe to the set-points that a :class:`StatedReference` of another node reports."""

    def on_stated(message: WeldReference) -> None:
        reference, issued_ns = _converted(queue, message), convert.stamp_ns(message.issued)
        if reference is None:
            return
        if issued_ns >= _LAST_NS:
            queue.refuse(Fact.of(Refused.BAD_ISSUE, topic=topic, issued_ns=issued_ns))
            return
        queue.add(convert.stamp_ns(message.header.stamp), reference, issued_ns)

    node.create_subscription(WeldReference, topic, on_stated, LATEST)


class StatedReference:
    """Publishes the set-points in force, latched, for nodes that join after their sender has left.

    Its ``topic`` has no other writer.
    """

    def __init__(self, node: Node, topic: str) -> None:
        self._node = node
        self._publisher = node.create_publisher(WeldReference, topic, LATCHED)
        self._stated: tuple[Reference, int] | None = None
        self._tick_ns = -1

    def update(self, tick_ns: int, reference: Reference | None, issued_ns: int) -> None:
        """Publish the set-points in force at a tick if they are new or time went back."""
        went_back, self._tick_ns = tick_ns < self._tick_ns, tick_ns
        if reference is not None and (went_back or (reference, issued_ns) != self._stated):
            self._stated = (reference, issued_ns)
            self._publisher.publish(convert.reference_message(reference, tick_ns, issued_ns))

    def close(self) -> None:
        """Remove the publisher."""
        self._node.destroy_publisher(self._publisher)


@dataclass(eq=False, slots=True)
class _Asked:
    """A request in progress; ``received_ns`` is the tick at which its set-points arrived."""

    mark: str
    answered: Future  #: has the answer
    due_s: float
    sent: Fact | None = None
    received_ns: int | None = None


class KeptReference:
    """Receives set-points and, while leading, serves requests and publishes those in force.

    The service ``fsw/set_reference`` checks a request and sends its set-points on
    ``fsw/reference``; it answers when they are in force by the rules of :class:`ReferenceQueue`,
    or cannot be. Both need the lead: a supervisor that was replaced without noticing may reach
    nobody.

    An operator's command line ends as soon as it has sent its set-points, and the middleware then
    forgets them. Those in force are therefore published on ``fsw/supervisor/reference``, whose
    only writer is the leading supervisor. A restarted supervisor gets them from the controllers.

    Parameters
    ----------
    node : rclpy.node.Node
    leads : callable
        Awaited before a request is executed and before success is reported; whether this
        supervisor leads.
    problem : callable
        Why requested set-points, depth [mm] and temperature [degC], are rejected although they
        are in range; None to accept them.
    """

    def __init__(
        self,
        node: Node,
        leads: Callable[[], Awaitable[bool]],
        problem: Callable[[float, float], Fact | None] = lambda depth_mm, temperature_c: None,
    ) -> None:
        self._node = node
        self._leads = leads
        self._problem = problem
        self.queue = reference_queue(node, self._on_refused)
        self.queue.decides = False
        self._statement: StatedReference | None = None
        self._service: Service | None = None
        self._group = ReentrantCallbackGroup()  # a pending answer does not block the topics
        self._publishers: tuple[Publisher, Publisher] | None = None
        self._controllers: list[str] = []
        self._asked: list[_Asked] = []
        self._tick_ns = -1
        self._refused = self._reported = 0
        self._last_refusal: Fact | None = None
        self._programme_runs_s: float | None = None  #: last report of a running weld programme
        node.create_subscription(WeldProgress, "fsw/weld_progress", self._on_programme, LATEST)
        subscribe_sent(node, self.queue, self._on_received)
        _subscribe_stated(node, self.queue, "fsw/supervisor/reference")

    def listen_to(self, controller: str) -> None:
        """Subscribe to the set-points that a controller reports as in force."""
        self._controllers.append(controller)
        _subscribe_stated(self._node, self.queue, f"fsw/{controller}/reference")

    def open(self) -> None:
        """Lead: serve requests from now on, and publish from the next tick on."""
        self.queue.decides = True
        if self._statement is None:
            self._statement = StatedReference(self._node, "fsw/supervisor/reference")
            self._service = self._node.create_service(
                SetReference, "fsw/set_reference", self._on_request, callback_group=self._group
            )

    def close(self) -> None:
        """Stop publishing and serving requests."""
        self.queue.decides = False
        if self._statement is not None:
            self._statement.close()
            self._node.destroy_service(self._service)
            self._statement = self._service = None
        for publisher in self._publishers or ():
            self._node.destroy_publisher(publisher)
        self._publishers = None

    def on_tick(self, tick_ns: int) -> None:
        """Publish the set-points in force if they have changed; allowed several times per tick."""
        if tick_ns == self._tick_ns:
            return
        self._tick_ns = tick_ns
        present = self.queue.at(tick_ns)
        if self._statement is not None:
            self._statement.update(tick_ns, present, self.queue.issued_ns)
        self.look(time.monotonic())

    def look(self, now_s: float) -> None:
        """Answer requests that are in force or overdue; call it several times a second."""
        for request in [*self._asked]:
            in_force = self.queue.mark == request.mark
            overtaken = request.received_ns not in (None, self._tick_ns) and not in_force
            if not in_force and not overtaken and now_s < request.due_s:
                continue
            if request.sent is None:
                continue
            if overtaken:
                answer = Answer.refused(SetPoints.OVERTAKEN)
            elif request.received_ns is None:
                answer = Answer.refused(SetPoints.UNCONFIRMED, wait_s=_ANSWER_S)
            elif not in_force:
                answer = Answer.done(SetPoints.NEXT, sent=request.sent)
            else:
                answer = Answer(True, request.sent)
            self._asked.remove(request)
            request.answered.set_result(answer)

    def drop(self) -> None:
        """Reject the pending requests: this supervisor no longer leads."""
        requests, self._asked = self._asked, []
        for request in requests:
            request.answered.set_result(_ON_STANDBY)

    def _on_received(self, mark: str) -> None:
        for request in self._asked:
            if request.mark == mark and request.received_ns is None:
                request.received_ns = self._tick_ns

    def report(self) -> Report:
        """Entry of the diagnostics: set-points refused since the last report."""
        new, self._reported = self._refused - self._reported, self._refused
        last = self._last_refusal
        counts = {"refused": self._refused, **told("last refusal", last)}
        if not new or last is None:
            return Report("set-points", OK, Fact.of(Taken.ACCEPTED), counts)
        return Report("set-points", WARN, Fact.of(Taken.REFUSED, count=new, last=last), counts)

    def _on_refused(self, refusal: Fact) -> None:
        self._refused += 1
        self._last_refusal = refusal
        self._node.get_logger().warning(refusal.words, throttle_duration_sec=1.0)

    async def _on_request(
        self, request: SetReference.Request, response: SetReference.Response
    ) -> SetReference.Response:
        return _respond(response, await self._answer(request))

    async def _answer(self, request: SetReference.Request) -> Answer:
        if not await self._leads():
            return _ON_STANDBY
        due_s = time.monotonic() + _ANSWER_S
        mark = f"set_reference {uuid.uuid4().hex}"
        pending = _Asked(mark, Future(executor=self._node.executor), due_s)
        self._asked.append(pending)
        try:
            present = self.queue.at(self._tick_ns) if self._tick_ns >= 0 else None
            goal = _goal(request, present)
            if problem := self._problem(goal.depth_mm, goal.temperature_c):
                raise RefusedError(problem)
            self._check_programme()
            self._check_listeners()
            pending.sent = self._send(goal, present if request.ramp else goal, pending.mark)
        except RefusedError as error:
            self._asked.remove(pending)
            return Answer(False, error.fact)
        answer: Answer = await pending.answered
        return _ON_STANDBY if answer.ok and not await self._leads() else answer

    def _on_programme(self, message: WeldProgress) -> None:
        runs = message.state == "running" and not message.left
        self._programme_runs_s = time.monotonic() if runs else None

    def _check_programme(self) -> None:
        heard_s = self._programme_runs_s
        if heard_s is not None and time.monotonic() - heard_s <= _PROGRAMME_SILENT_S:
            raise RefusedError.of(SetPoints.PROGRAMME_RUNS)

    def _check_listeners(self) -> None:
        topics = [f"fsw/{name}/reference" for name in self._controllers]
        resolved = map(self._node.resolve_topic_name, topics)
        if not any(map(self._node.count_publishers, resolved)):
            raise RefusedError.of(SetPoints.NO_LISTENER)

    def _send(self, goal: Reference, start: Reference | None, mark: str) -> Fact:
        """Send set-points, effective at once and voiding those sent ahead; return the answer."""
        if start is None:
            raise RefusedError.of(SetPoints.NO_START)
        if self._publishers is None:
            create = self._node.create_publisher
            plans = create(WeldReferencePlan, "fsw/reference_plan", LATEST)
            self._publishers = create(WeldReference, "fsw/reference", LATCHED), plans
        sent, plans = self._publishers
        points, plan = [(0, start)], []
        if start != goal:
            begin_ns = self._tick_ns + _LEAD_NS
            points += ramp(start, goal, begin_ns)
            plan = ramp_plan(start, goal, begin_ns)
        plans.publish(convert.reference_plan_message(plan, max(self._tick_ns, 0)))
        for stamp_ns, point in points:
            sent.publish(convert.reference_message(point, stamp_ns, mark=mark))
        if start == goal:
            return Fact(SetPoints.STEP, values(goal))
        lasts_s = duration_s(start, goal)
        return Fact(SetPoints.RAMP, {**values(goal), "duration_s": lasts_s})


def _respond(response: SetReference.Response, answer: Answer) -> SetReference.Response:
    fact = answer.fact
    response.ok, response.code, response.message = answer.ok, str(fact.code), fact.words
    sent = fact.data.get("sent", fact).data if answer.ok else {}
    response.depth = units.m_from_mm(sent.get("depth_mm", nan))
    response.temperature = sent.get("temperature_c", nan)
    response.duration = sent.get("duration_s", 0.0)
    return response


def _goal(request: SetReference.Request, present: Reference | None) -> Reference:
    """Requested set-points; RefusedError if a value is out of range or cannot be kept."""
    depth_mm, temperature_c = units.mm_from_m(request.depth), float(request.temperature)
    if present is None and (isnan(depth_mm) or isnan(temperature_c)):
        raise RefusedError.of(SetPoints.INCOMPLETE)
    if present is not None:
        depth_mm = present.depth_mm if isnan(depth_mm) else depth_mm
        temperature_c = present.temperature_c if isnan(temperature_c) else temperature_c
    if problem := set_point_problem(depth_mm, temperature_c):
        raise RefusedError(problem)
    return Reference(depth_mm, temperature_c)
