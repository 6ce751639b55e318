"""The operator's page as a node: shows the graph, and carries out what a person asks for.

By itself it changes nothing: it publishes no set-points before it is asked to, and the weld goes
on as it is when this node ends or dies.
"""

from __future__ import annotations

import json
import time
from collections import deque
from collections.abc import Callable, Mapping
from functools import partial
from math import nan
from pathlib import Path
from typing import Any

from rcl_interfaces.srv import GetParameters
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.task import Future

from fsw_analysis.procedure import Procedure
from fsw_analysis.rule_book import RuleBook, default
from fsw_control import messages_ros as convert
from fsw_control.light_node_ros import LightNode
from fsw_control.parameters_ros import ParameterValues
from fsw_control.schema.extensions import all_loaded
from fsw_control.schema.files import write_status
from fsw_control.schema.models import content_of, read_text, validate
from fsw_control.stop import StopCause, StopRegister
from fsw_control.stop_ros import StopHolder
from fsw_control.topics_ros import LATCHED
from fsw_control.units import NANOSECONDS
from fsw_hmi import users
from fsw_hmi.alarm_desk_ros import AlarmDesk
from fsw_hmi.answers import Answer
from fsw_hmi.control_room import ControlRoom, Order
from fsw_hmi.frames import frame, readable, row
from fsw_hmi.headline import headline
from fsw_hmi.limits import (
    PARAMETERS,
    StopProgress,
    limits,
    outside_now,
    reference,
    safe_state,
    worst,
)
from fsw_hmi.live_weld import LiveWeld
from fsw_hmi.orders_ros import Orders
from fsw_hmi.parameters import HmiParameters
from fsw_hmi.recording import Recording
from fsw_hmi.requests import Acknowledge, SafeStop, Shelve, Unshelve
from fsw_hmi.watch_ros import Watch
from fsw_hmi.web import LivePage, PageFiles
from fsw_hmi.web_server import WebThread, address, application, is_local, listen, tls_context
from fsw_hmi.weld_view import Row
from fsw_msgs.msg import OperatorAction
from fsw_recorder.signature import Purpose, signer_of

_LOOK_S, _REPORT_S = 0.05, 1.0
#: shortest time between two ticks on the page, when time runs faster than the wall clock
_TICK_PERIOD_S = 0.04
#: The supervisor's interlocks are asked for again, as they can be changed.
_ASK_AGAIN_S = 5.0
#: in simulated time silence lasts so much longer
_SIMULATED_SILENCE = 10.0
#: actions on the page, at most
_MOST_ACTIONS = 50


class HmiNode(LightNode, Node):  # type: ignore[misc]  # rclpy has no types everywhere
    """Serves the page in a thread of its own.

    Everything that touches the graph happens in the executor's thread.

    Orders come over by a queue and a guard condition; frames go back by calls in the server's
    loop.
    """

    def __init__(self, **arguments: Any) -> None:
        super().__init__("fsw_hmi", **arguments)
        self._settings = ParameterValues(self, HmiParameters)
        values = self._settings.values
        known, token = users.of(values["users_file"], values["token_file"])
        encrypted = tls_context(values["tls_cert"], values["tls_key"])
        files = PageFiles("live")
        listening = listen(values["host"], values["port"])
        self._received: deque[Order] = deque()
        self._tick_sent_s = 0.0
        self._interlocks: dict[str, float] = {}
        self._asked_leader, self._asked_s = "", float("-inf")
        self._actions = self.create_publisher(OperatorAction, "fsw/operator_action", LATCHED)
        self._get_parameters = self.create_client(GetParameters, "fsw_supervisor/get_parameters")
        self._watch = Watch(self, self._on_rows, self._show)
        self._book = book_of(values["procedure"])
        self._desk = AlarmDesk(self, self._watch, self._setting)
        self._weld = LiveWeld(self._book)
        self._stopping, self._recording = StopProgress(), Recording()
        self._headline: dict[str, str] = {}
        self._account: dict[str, Any] | None = None
        self._orders = Orders(self, self._watch.awake)
        self._register = StopRegister()
        self._stop = StopHolder(self, self._register, self._register.merge)
        self._wake = self.create_guard_condition(self._on_orders)
        self._room = ControlRoom(known, values["local_stop"], values["handover_timeout_s"])
        pages = pages_of(values["pages_folder"])
        self._page = LivePage(files, self._room, self._deliver, listening.gate.touch, pages)
        hosts = values["host"], *values["allow_hosts"]
        app = application(self._page.routes(), hosts, listening.gate)
        self._web = WebThread(self._page, app, listening, encrypted)
        self._done = deque[dict[str, Any]](maxlen=_MOST_ACTIONS)
        self._show("alarms", self._desk.frame())
        self._show("actions", {"actions": []})
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        for period_s, look in ((_LOOK_S, self._look), (_REPORT_S, self._report)):
            self.create_timer(period_s, look, clock=steady)
        self._say_hello()
        self._web.start()
        if encrypted is None and not is_local(listening):
            self.get_logger().warning(
                "the page can be reached from other computers, and nothing is encrypted"
            )
        _announce(address(listening, encrypted is not None), token)

    def _setting(self, name: str) -> float:
        value: float = self._settings[name]
        simulated = name == "silence_s" and self.get_parameter("use_sim_time").value
        return value * _SIMULATED_SILENCE if simulated else value

    def destroy_node(self) -> None:
        """Close the pages, then end."""
        if hasattr(self, "_web"):
            self._web.stop()
            self._on_orders()  # who has lost control by it
        super().destroy_node()

    # ---------------------------------------------------------------- to the pages

    def _on_rows(self, rows: list[Row], restarted: bool) -> None:
        now_s = time.monotonic()
        if restarted:
            self._web.call(self._page.forget)
            self._weld.forget()
            self._recording = Recording()
            self._watch.progress = None  # of the weld before; a programme reports every second
        if self._watch.progress is not None and self._weld.on_progress(self._watch.progress):
            self._account = None
            self._web.call(partial(self._page.withdraw, "account"))
        now = self._watch.now
        if now.state is not None:
            self._weld.on_state(now.leader, now.state)
        for tick in rows:
            self._weld.add(tick, self._watch.source)
            text = row(tick.stamp_ns, tick.values)
            shown = None
            if now_s - self._tick_sent_s >= _TICK_PERIOD_S:
                self._tick_sent_s = now_s
                now.outside = outside_now(
                    now.values, self._watch.programme(), self._book, self._limits
                )
                values = {**now.values, "time_s": tick.stamp_ns / NANOSECONDS}
                stop = self._stopping.at(self._watch.stopped, values, safe_state(self._interlocks))
                rest = f'"flags":{json.dumps(worst(now.outside))},"stop":{json.dumps(stop)}'
                shown = f'{{"t":"tick","server_s":{time.time():.3f},"row":{text},{rest}}}'
            self._web.call(partial(self._page.tick, text, shown, now_s))

    def _show(self, kind: str, content: Mapping[str, Any], of: str = "") -> None:
        """Send a frame to all pages; it replaces the earlier one of its kind and subject."""
        self._web.call(partial(self._page.show, f"{kind} {of}".rstrip(), frame(kind, content)))

    def _show_headline(self) -> None:
        alarms = self._desk.frame()["alarms"]
        line = headline(self._desk.now, alarms, self._account, self._recording.state)
        if line != self._headline:
            self._headline = line
            self._show("headline", line)

    def _say_hello(self) -> None:
        self._limits = limits(self._interlocks, self._book)
        hello = {"limits": self._limits, "reference": reference(self._interlocks)}
        self._web.call(partial(self._page.set_hello, hello))

    # ---------------------------------------------------------------- now and then

    def _look(self) -> None:
        self._watch.look()
        self._orders.look()  # after it has noted how long this process stood still
        self._watch.now.stop_waits = self._register.stopped
        if self._desk.judge():
            self._show("alarms", self._desk.frame())
        self._show_headline()

    def _report(self) -> None:
        watch = self._watch
        if not self._web.alive:
            raise RuntimeError("the page's server has ended")
        self._show("state", watch.state_frame())
        watch.show_progress()
        newest_ns, recorder = watch.view.newest_ns, watch.recorder()
        newest_s = nan if newest_ns is None else newest_ns / NANOSECONDS
        self._recording.look(recorder.level, recorder.code, watch.recording, newest_s)
        self._show("recording", self._recording.frame())
        self._account = self._weld.frame(self._recording.gaps)
        if self._account is not None:
            self._show("account", self._account)
        now_s = time.monotonic()
        leader = watch.now.leader
        is_old = leader != self._asked_leader or now_s - self._asked_s > _ASK_AGAIN_S
        if leader and is_old and self._get_parameters.service_is_ready():
            self._asked_leader, self._asked_s = leader, now_s
            future = self._get_parameters.call_async(GetParameters.Request(names=list(PARAMETERS)))
            future.add_done_callback(self._on_parameters)

    def _on_parameters(self, future: Future) -> None:
        response = future.result()
        if response is None:
            return
        values = zip(PARAMETERS, response.values, strict=False)  # of type 3: a double
        interlocks = {name: value.double_value for name, value in values if value.type == 3}
        if interlocks != self._interlocks:
            self._interlocks = interlocks
            self._say_hello()

    # ---------------------------------------------------------------- orders

    def _deliver(self, order: Order) -> None:
        """In the server's thread."""
        self._received.append(order)
        self._wake.trigger()

    def _on_orders(self) -> None:
        while self._received:
            self._on_order(self._received.popleft())

    def _on_order(self, order: Order) -> None:
        action, answer = order.action, partial(self._answer, order)
        if action is None:
            self._record(order, order.answer)
        elif isinstance(action, Acknowledge | Shelve | Unshelve):
            done = self._desk.carry_out(action, order.who)
            self._show("alarms", self._desk.frame())
            answer(done)
        else:
            if isinstance(action, SafeStop):
                # Not only by the supervisor's service: the plant hears of it, too, if no
                # supervisor lives; and as a new stop, for this copy may be out of date.
                self._register.stop(
                    StopCause.OPERATOR, order.who, self.get_clock().now().nanoseconds
                )
                self._stop.look()
            timeout_s = self._settings["request_timeout_s"]
            self._orders.carry_out(action, order.who, answer, timeout_s)

    def _answer(self, order: Order, answer: Answer) -> None:
        answer = answer._replace(message=readable(answer.message))
        self._record(order, answer)
        self._web.call(partial(order.reply, answer))

    def _record(self, order: Order, answer: Answer) -> None:
        done = {"who": order.who, "action": order.asked, **answer._asdict()}
        self._done.append(done | {"server_s": round(time.time(), 3)})
        self._show("actions", {"actions": list(self._done)})
        header = convert.header(int(self.get_clock().now().nanoseconds))
        more = {"holder": order.holder, "kind": int(order.kind)}
        self._actions.publish(OperatorAction(header=header, **more, **done))


def pages_of(folder: str) -> dict[str, Callable[[], str]]:
    """Pages that other distributions make from a folder; InputError if one is broken."""
    makers = all_loaded("fsw.pages") if folder else {}
    return {name: partial(make, Path(folder).expanduser()) for name, make in makers.items()}


def book_of(file: str) -> RuleBook:
    """Judge of the weld; InputError if the procedure is unusable or changed after signing."""
    if not file:
        return default()
    signer_of(Path(file), Purpose.PROCEDURE, None)
    return validate(Procedure, content_of(read_text(file, "procedure"), file), file)


def _announce(url: str, token: str) -> None:
    """Print address and token; the token must not get into the log, which is recorded."""
    print(f"operator's page: {url}", flush=True)
    write_status(url=url)
    if token:
        print(f"token: {token}", flush=True)
