"""The supervisor's arbiter without middleware, for several controllers in a process."""

from __future__ import annotations

from collections.abc import Mapping

from fsw_control.contract import Command, Controller, Proposal
from fsw_control.parameters import defaults
from fsw_control.reason import Reason
from fsw_control.weld import TICK_S
from fsw_scenario.timeline import SWITCH_TIMEOUT_S
from fsw_supervisor import Arbiter, ArbiterSettings, Decision, ProposalInput
from fsw_supervisor.parameters import SupervisorParameters


class OfflineSupervisor:
    """Decides every tick like the supervisor of a lockstep graph, with default parameters.

    It starts with the controller ``selected``. Controllers that are not in its parameter
    ``fallbacks`` follow after those that are.
    """

    def __init__(self, controllers: Mapping[str, Controller], selected: str) -> None:
        values = defaults(SupervisorParameters)
        fallbacks = dict.fromkeys([*values["fallbacks"], *controllers])
        settings = ArbiterSettings.from_values(
            values | {"controller": selected, "fallbacks": list(fallbacks)}
        )
        self._arbiter = Arbiter(settings, lockstep=True)
        self._unheard = {
            name: controller.tolerated_sensors for name, controller in controllers.items()
        }
        self._now_s = 0.0

    @property
    def state(self) -> tuple[str, str]:
        """Active controller and mode."""
        return self._arbiter.machine.active, str(self._arbiter.machine.mode)

    def switch(self, name: str) -> None:
        """Request a controller for the next tick on."""
        self._arbiter.operator.ask_switch(name, False, SWITCH_TIMEOUT_S, "scenario", self._now_s)

    def decide(
        self,
        stamp_ns: int,
        values: Mapping[str, float],
        drives: Command,
        proposals: Mapping[str, Proposal],
    ) -> Decision:
        """Command that answers a tick, given the samples by sensor (mm, N m, degC)."""
        arbiter = self._arbiter
        self._now_s += TICK_S
        decisions = arbiter.on_drives(stamp_ns, drives, self._now_s)
        assert arbiter.ticks.present is not None
        arbiter.ticks.present.samples.update(
            values
        )  # all at once: half the time of on_sample for each
        for name, proposal in proposals.items():
            offer = ProposalInput(
                stamp_ns, name, proposal.command, proposal.healthy, Reason.of(proposal.reason)
            )
            decisions += arbiter.on_proposal(name, offer, self._now_s)
            if name in self._unheard:
                decisions += arbiter.on_status(name, self._unheard.pop(name), False, self._now_s)
        while not decisions and (wakeup_s := arbiter.wakeup_s) is not None:
            self._now_s = wakeup_s
            decisions = arbiter.on_time(wakeup_s)
        return decisions[-1]
