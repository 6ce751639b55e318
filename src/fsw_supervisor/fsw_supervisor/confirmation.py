"""Requests that are answered when the actuator end reports their effect: an answer is of what acts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from fsw_control.fence import ActuatorState
from fsw_control.stop import Stop
from fsw_supervisor.failover import Failover, Role
from fsw_supervisor.state_machine import Mode

#: time within which the actuator end has to report the effect of a request [s] (chosen: twenty
#: ticks)
CONFIRM_S = 2.0


@dataclass(slots=True)
class Confirmation:
    """A request that was accepted; ``ok`` is None until it is known whether it has taken effect."""

    effect: Callable[[ActuatorState], bool]  #: whether a report shows the effect
    due_s: float  #: steady time at which it counts as not confirmed
    is_stop: bool = False  #: a safe stop was asked for
    ok: bool | None = None
    on_done: Callable[[], object] | None = None  #: called when it is known


class Confirmations:
    """Waits for the effects of requests; :meth:`look` is to be called a few times a second.

    A report may have been under way since before the request. So it counts only if it can come of
    nothing else than the request: it shows the stop register as the request has made it, or a
    command that was decided after it.
    """

    def __init__(self, failover: Failover, lockstep_wait_s: float) -> None:
        self._failover = failover
        self.wait_s = max(
            CONFIRM_S, lockstep_wait_s
        )  #: time within which an effect must be reported
        self._waiting: list[Confirmation] = []
        self._asked = (
            Stop()
        )  # the safe stop of this supervisor's last request, which covers those before

    def of_stop(self, now_s: float) -> Confirmation:
        """The safe stop of this supervisor's register is in force, and not acknowledged meanwhile."""
        machine = self._failover.machine
        self._asked = machine.register.value
        waiting = self._add(
            lambda state: machine.register.stopped and state.stop == self._asked, now_s
        )
        waiting.is_stop = True
        return waiting

    def of_acknowledgement(self, now_s: float) -> Confirmation:
        """The acknowledgement of this supervisor's register is known, and no safe stop has been heard since.

        Of a stop that was acknowledged before, any report shows that; then a later command has to
        act.
        """
        machine, state = self._failover.machine, self._failover.actuator
        value = machine.register.value
        is_later = (
            self._later() if state is not None and state.stop >= value else lambda state: True
        )

        def shows(state: ActuatorState) -> bool:
            return (
                state.stop >= value
                and not (state.stop.stopped or machine.register.stopped)
                and is_later(state)
            )

        return self._add(shows, now_s)

    def of_mode(self, mode: Mode, now_s: float) -> Confirmation:
        """A command of the mode acts that was decided after the request."""
        is_later = self._later()

        def shows(state: ActuatorState) -> bool:
            wanted = self._failover.machine.active if mode is Mode.AUTO else str(mode)
            return state.source == wanted != "" and is_later(state)

        return self._add(shows, now_s)

    def of_source(self, name: str, now_s: float) -> Confirmation:
        """A command of the controller ``name`` acts that was decided after the request."""
        is_later = self._later()
        return self._add(lambda state: state.source == name and is_later(state), now_s)

    def _later(self) -> Callable[[ActuatorState], bool]:
        """Whether a report shows a command of this supervisor that was decided from now on."""
        last = self._failover.last_decided_ns
        return lambda state: self._failover.leads and state.answered_ns > last

    def _add(self, effect: Callable[[ActuatorState], bool], now_s: float) -> Confirmation:
        waiting = Confirmation(effect, now_s + self.wait_s)
        self._waiting.append(waiting)
        return waiting

    def on_report(self) -> None:
        """Answer what the actuator end's last report shows; to be called once for each."""
        state = self._failover.actuator
        if any(waiting.is_stop for waiting in self._waiting):
            self._stop_again()
        for waiting in [*self._waiting]:
            if state is not None and waiting.effect(state):
                self._answer(waiting, True)

    def _stop_again(self) -> None:
        """Ask again for the safe stop if another one has been heard.

        Its acknowledgement may be under way, given before this supervisor was asked.
        """
        machine = self._failover.machine
        if machine.register.stopped and machine.register.value != self._asked:
            machine.stop_again(self._asked.who)
            self._asked = machine.register.value

    def look(self, now_s: float) -> None:
        """Answer what is not confirmed in time, or no longer by this supervisor."""
        leads = self._failover.role is Role.ACTIVE
        for waiting in [*self._waiting]:
            if not leads or now_s >= waiting.due_s:
                self._answer(waiting, False)

    def _answer(self, waiting: Confirmation, ok: bool) -> None:
        self._waiting.remove(waiting)
        waiting.ok = ok
        if waiting.on_done is not None:
            waiting.on_done()
