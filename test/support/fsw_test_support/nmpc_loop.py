"""The NMPC in closed loop with a process, for its tests."""

from __future__ import annotations

from typing import Any

from fsw_control import Command, Limits, Measurement, Proposal, Reference
from fsw_model import ProcessModel
from fsw_nmpc import NmpcController

TARGET = Reference(2.66, 816.4)


class Loop:
    """Process and controller; the process may differ from the controller's model."""

    def __init__(
        self, controller: NmpcController | None = None, model: ProcessModel | None = None
    ) -> None:
        self.controller, self.model = controller or NmpcController(), model or ProcessModel()
        rest = self.model.equilibrium()
        self.state, self.applied, self.tick = (
            rest.state.copy(),
            Command(rest.force_kn, rest.speed_rpm),
            0,
        )
        self.controller.reset(self.applied)

    def measure(self, **changes: Any) -> Measurement:
        """The measurement of now, with changes."""
        shown = self.model.outputs(self.state, self.applied.force_kn, self.applied.speed_rpm)
        values = {
            "depth_mm": shown.depth_mm,
            "torque_nm": shown.motor_torque_nm,
            "temperature_c": shown.temperature_c,
        }
        return Measurement(0.1 * self.tick, **(values | changes))

    def step(
        self, reference: Reference = TARGET, follow: Command | None = None, **changes: Any
    ) -> Proposal:
        """One tick; ``follow``: the command applied instead of the proposal."""
        proposal = self.controller.step(self.measure(**changes), reference, self.applied, 0.1)
        self.applied = follow or proposal.command
        self.model.step(self.state, self.applied.force_kn, self.applied.speed_rpm)
        self.tick += 1
        return proposal

    @property
    def shown(self) -> Measurement:
        """The measurement of now."""
        return self.measure()


def within(proposal: Proposal, before: Command) -> bool:
    """Whether a proposal keeps the bounds always, and the moves where it can.

    Else it is not healthy.
    """
    lim, command = Limits(), proposal.command
    if lim.clip(command, None) != command:
        return False
    near = lim.clip(before, None)
    if (
        max(
            abs(near.force_kn - before.force_kn) - 1.0,
            abs(near.speed_rpm - before.speed_rpm) - 3.0,
        )
        > 1e-6
    ):
        before, healthy = near, False
    else:
        healthy = proposal.healthy
    moves = (
        abs(command.force_kn - before.force_kn) - 1.0,
        abs(command.speed_rpm - before.speed_rpm) - 3.0,
    )
    return max(moves) <= 2e-6 and healthy == proposal.healthy
