"""Requests that are answered once the actuator end reports their effect.

An answer thus describes what acts on the machine, not what was sent.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from fsw_control.fence import ActuatorState
from fsw_control.stop import Stop
from fsw_supervisor.failover import Failover, Role
from fsw_supervisor.state_machine import Mode

#: time within which the actuator end has to report the effect of a request [s] (chosen: 20 ticks)
CONFIRM_S = 2.0


@dataclass(slots=True)
class Confirmation:
    """An accepted request; ``ok`` is None until its effect is known."""

    effect: Callable[[ActuatorState], bool]  #: whether a report shows the effect
    due_s: float  #: steady time after which it counts as not confirmed
    is_stop: bool = False  #: the request is a safe stop
    ok: bool | None = None
    on_done: Callable[[], object] | None = None  #: called when the effect is known


class Confirmations:
    """Waits for the effects of requests; call :meth:`look` a few times a second.

    A report may date from before the request. It therefore counts only if nothing but the request
    can have caused it: it shows the stop register as changed by the request, or a command decided
    after it.
    """

    def __init__(self, failover: Failover, lockstep_wait_s: float) -> None:
        self._failover = failover
        # time within which an effect must be reported
        self.wait_s = max(CONFIRM_S, lockstep_wait_s)
        self._waiting: list[Confirmation] = []
        # the safe stop of this supervisor's last request, which covers the earlier ones
        self._asked = Stop()

    def of_stop(self, now_s: float) -> Confirmation:
        """Confirm that the safe stop of this supervisor's register is in force."""
        # Equal registers, not just "stopped": a report sent before the request may show an earlier
        # stop, whose acknowledgement is under way and would end this one unseen.
        machine = self._failover.machine
        self._asked = machine.register.value
        waiting = self._add(
            lambda state: machine.register.stopped and state.stop == self._asked, now_s
        )
        waiting.is_stop = True
        return waiting

    def of_acknowledgement(self, now_s: float) -> Confirmation:
        """Confirm that the acknowledgement is known, and no safe stop has been heard since.

        If the stop was acknowledged before, every report shows that, so a later command has to
        act.
        """
        machine, state = self._failover.machine, self._failover.actuator
        value = machine.register.value
        known_before = state is not None and state.stop >= value
        is_later = self._later() if known_before else lambda state: True

        def shows(state: ActuatorState) -> bool:
            stopped = state.stop.stopped or machine.register.stopped
            return state.stop >= value and not stopped and is_later(state)

        return self._add(shows, now_s)

    def of_mode(self, mode: str, now_s: float) -> Confirmation:
        """Confirm that a command of the mode, decided after the request, acts."""
        is_later = self._later()

        def shows(state: ActuatorState) -> bool:
            source = self._failover.machine.active if mode == Mode.AUTO else mode
            return state.source == source != "" and is_later(state)

        return self._add(shows, now_s)

    def of_source(self, name: str, now_s: float) -> Confirmation:
        """Confirm that a command of controller ``name``, decided after the request, acts."""
        is_later = self._later()
        return self._add(lambda state: state.source == name and is_later(state), now_s)

    def _later(self) -> Callable[[ActuatorState], bool]:
        """Return a test whether a report shows a command decided here from now on."""
        # Stamps order commands, whoever sent them; the clock of arrival does not. A command of
        # another leader does not show that this request was heard, so this one has to lead.
        last = self._failover.last_decided_ns
        return lambda state: self._failover.leads and state.answered_ns > last

    def _add(self, effect: Callable[[ActuatorState], bool], now_s: float) -> Confirmation:
        waiting = Confirmation(effect, now_s + self.wait_s)
        self._waiting.append(waiting)
        return waiting

    def on_report(self) -> None:
        """Answer requests confirmed by the actuator end's last report; call it once per report."""
        state = self._failover.actuator
        if any(waiting.is_stop for waiting in self._waiting):
            self._stop_again()
        for waiting in [*self._waiting]:
            if state is not None and waiting.effect(state):
                self._answer(waiting, True)

    def _stop_again(self) -> None:
        """Request the safe stop again if another one has been heard.

        The other's acknowledgement, given before this request, may be under way.
        """
        machine = self._failover.machine
        if machine.register.stopped and machine.register.value != self._asked:
            machine.stop_again(self._asked.who)
            self._asked = machine.register.value

    def look(self, now_s: float) -> None:
        """Answer requests that are overdue, or can no longer be confirmed by this supervisor."""
        leads = self._failover.role is Role.ACTIVE
        for waiting in [*self._waiting]:
            if not leads or now_s >= waiting.due_s:
                self._answer(waiting, False)

    def _answer(self, waiting: Confirmation, ok: bool) -> None:
        self._waiting.remove(waiting)
        waiting.ok = ok
        if waiting.on_done is not None:
            waiting.on_done()
