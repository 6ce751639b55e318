"""Requests that are answered when the actuator end reports their effect: an answer is of what acts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from fsw_control.fence import ActuatorState
from fsw_control.stop import Stop
from fsw_supervisor.failover import Failover, Role
from fsw_supervisor.state_machine import Mode

#: time within which the actuator end has to report the effect of a request [s] (chosen: twenty ticks)
CONFIRM_S = 2.0


@dataclass(slots=True)
class Confirmation:
    """A request that was accepted; ``ok`` is None until it is known whether it has taken effect."""

    effect: Callable[[ActuatorState], bool]  #: whether a report shows the effect
    due_s: float  #: steady time at which it counts as not confirmed
    source_before: str  #: of the command that acted when it was asked for
    begins_s: float  #: steady time before which reports do not count: they may have waited here
    reports: int = 0  #: since then
    ok: bool | None = None
    on_done: Callable[[], object] | None = None  #: called when it is known


class Confirmations:
    """Waits for the effects of requests; :meth:`look` is to be called after every report and a few times a second."""

    def __init__(self, failover: Failover, lockstep_wait_s: float) -> None:
        self._failover, self._wait_s = failover, max(CONFIRM_S, lockstep_wait_s)
        self._waiting: list[Confirmation] = []
        self._asked = Stop()  # the safe stop of this supervisor's last request, which covers those before

    def of_stop(self, now_s: float) -> Confirmation:
        """The safe stop of this supervisor's register is in force, and not acknowledged meanwhile.

        Another stop at the actuator end does not count: an acknowledgement of it may be under way that was
        given before this request. So this supervisor stops again when it has heard another one.
        """
        machine = self._failover.machine
        self._asked = machine.register.value

        def shows(state: ActuatorState) -> bool:
            if machine.register.stopped and machine.register.value != self._asked:
                machine.stop_again(self._asked.who)
                self._asked = machine.register.value
            return machine.register.stopped and state.stop == self._asked

        return self._add(shows, now_s)

    def of_acknowledgement(self, now_s: float) -> Confirmation:
        """The acknowledgement of this supervisor's register is known, and no safe stop has been heard since.

        Of a stop that was acknowledged before, reports show that already; one that has waited here does not count.
        """
        machine = self._failover.machine
        value = machine.register.value

        def shows(state: ActuatorState) -> bool:
            return state.stop >= value and not (state.stop.stopped or machine.register.stopped)

        return self._add(shows, now_s, machine.settings.tick_period_s)

    def of_mode(self, mode: Mode, now_s: float) -> Confirmation:
        """Commands of the mode act that were decided after the request.

        The report that comes next may still be of a command decided before; of that its source is known.
        """

        def shows(state: ActuatorState) -> bool:
            machine = self._failover.machine
            wanted = machine.active if mode is Mode.AUTO else str(mode)
            leads = self._failover.leads and state.source == wanted != ""
            return leads and (self_.reports > 1 or (self_.reports == 1 and state.source != self_.source_before))

        self_ = self._add(shows, now_s, self._failover.machine.settings.tick_period_s)
        return self_

    def of_source(self, name: str, now_s: float) -> Confirmation:
        """A command of the controller ``name`` acts."""
        period_s = self._failover.machine.settings.tick_period_s
        return self._add(lambda state: self._failover.leads and state.source == name, now_s, period_s)

    def _add(self, effect: Callable[[ActuatorState], bool], now_s: float, drain_s: float = 0.0) -> Confirmation:
        state = self._failover.actuator
        source = "" if state is None else state.source
        waiting = Confirmation(effect, now_s + self._wait_s, source, now_s + drain_s)
        self._waiting.append(waiting)
        return waiting

    def on_report(self) -> None:
        """Note that the actuator end has reported; before :meth:`look`."""
        for waiting in self._waiting:
            waiting.reports += 1

    def look(self, now_s: float) -> None:
        """Answer what is known."""
        state, leads = self._failover.actuator, self._failover.role is Role.ACTIVE
        for waiting in [*self._waiting]:
            shown = state is not None and waiting.reports > 0 and now_s >= waiting.begins_s and waiting.effect(state)
            if shown or not leads or now_s >= waiting.due_s:
                self._waiting.remove(waiting)
                waiting.ok = shown
                if waiting.on_done is not None:
                    waiting.on_done()
