"""The process with heat conduction in a canister instead of the copper of (16).

All else is the paper's. The power (24) heats the canister without delay; its stir zone is what the
tool touches. Dead time and the tool's lag of (16) lie between it and the thermocouple, as in the
paper, and the depth (27) follows the thermocouple.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from math import isfinite, pi

from fsw_control.schema.models import InputError
from fsw_model import (
    STEP_S,
    Equilibrium,
    ModelParameters,
    OperatingPointError,
    OutsideModelError,
    ProcessModel,
    ProcessState,
)
from fsw_model.equations import MOTOR, TOOL, power_kw
from fsw_model.process import driven_step
from fsw_plant.canister import CanisterState, HeatModel
from fsw_plant.canister.stepped import heated
from fsw_plant.lag import lag_mean, lag_risen
from fsw_plant.tool_path import Motion


@dataclass(slots=True)
class CanisterProcessState(ProcessState):
    """State of the process on a canister; ``x[COPPER]`` is the stir zone, ``power`` is unused."""

    #: deviation of the stir zone's temperature at the present tick and at the previous ones within
    #: the dead time, oldest first
    copper: deque[float]
    canister: CanisterState

    def copy(self) -> CanisterProcessState:
        """Independent copy."""
        return CanisterProcessState(self.x, self.power, deque(self.copper), self.canister)


class CanisterProcess:
    """The process on a canister, which replaces the paper's process.

    ``parameters`` apply except for the copper's gain and lag.
    """

    def __init__(self, parameters: ModelParameters, canister: HeatModel) -> None:
        self.parameters, self._canister = parameters, canister
        model = ProcessModel(parameters)
        self.outputs = model.outputs
        self._delay_steps = model.delay_steps
        self._overlap = (
            model.delay_steps - parameters.dead_time_s / STEP_S
        )  # by which the dead time is less, of a step
        self._driven = driven_step(parameters)

    def advance(
        self,
        state: CanisterProcessState,
        force_kn: float,
        speed_rpm: float,
        motion: Motion,
        added_nm: float = 0.0,
    ) -> None:
        """Advance ``state`` in place by a step; ``added_nm`` is added to M_sp in (18).

        Raises
        ------
        OperatingPointError
            If the shoulder or the tool would leave the copper, or an input is not finite.
        """
        result = self._driven(*state.x, *self.met(state.copper), force_kn, speed_rpm)
        mean_kw, depth_mm = result[6:]
        lag_s = self.parameters.motor_lag_s
        if added_nm:  # rises within the step as 1 - exp(-s / lag)
            mean_kw += (1.0 - lag_mean(lag_s)) * power_kw(added_nm, speed_rpm)
        if not (depth_mm > 0.0 and isfinite(mean_kw)):
            raise OutsideModelError(depth_mm, force_kn, speed_rpm)
        try:
            state.canister = self._canister.step(
                state.canister, max(mean_kw, 0.0), *motion, STEP_S
            )
        except InputError as error:  # the tool is off the copper
            raise OperatingPointError(str(error)) from None
        state.copper.append(self._deviation(state.canister))
        state.copper.popleft()
        state.x = (
            *result[:3],
            state.copper[-1],
            result[TOOL],
            result[MOTOR] + lag_risen(lag_s) * added_nm,
        )

    def met(self, copper: deque[float]) -> tuple[float, float]:
        """The copper temperature that the tool sees at both ends of the next step, delayed."""
        start, end = copper[0], copper[1]
        if self._overlap < 1e-9:
            return start, end
        return start + self._overlap * (end - start), end + self._overlap * (copper[2] - end)

    def _deviation(self, canister: CanisterState) -> float:
        return (
            self._canister.stir_zone_temperature_c(canister)
            - self.parameters.operating_temperature_c
        )

    def refit(self, state: CanisterProcessState) -> None:
        """Convert a state of other parameters, with its history within the dead time."""
        kept = list(state.copper)[-self._delay_steps - 1 :]
        state.copper = deque([kept[0]] * (self._delay_steps + 1 - len(kept)) + kept)

    def start(
        self, depth_mm: float, temperature_c: float, power_kw: float, motion: Motion
    ) -> Equilibrium:
        """Heat the canister from ambient by a constant power up to a thermocouple temperature.

        Raises
        ------
        OperatingPointError
            If that takes too long, or the shoulder is not in the copper.
        """
        p = self.parameters
        rise_c = temperature_c - p.operating_temperature_c
        softening = 1.0 + p.softening_per_c * rise_c
        if not (depth_mm > 0.0 and softening > 0.0):
            raise OperatingPointError(
                f"no start at depth {depth_mm:.4g} mm, {temperature_c:.4g} degC (27)"
            )
        modes = (depth_mm / softening - p.operating_depth_mm, 0.0, 0.0)
        force = p.operating_force_kn
        copper: deque[float] = deque(maxlen=self._delay_steps + 1)
        tool_c = 0.0

        def missing_c(canister: CanisterState) -> float:
            nonlocal tool_c
            now = self._deviation(canister)
            if copper:
                tool_c = self._driven(
                    *modes, copper[-1], tool_c, 0.0, *self.met(copper), force, 0.0
                )[TOOL]
                copper.append(now)
            else:
                copper.extend([now] * (self._delay_steps + 1))
                tool_c = now
            return rise_c - tool_c

        try:
            canister = heated(self._canister, power_kw, motion, STEP_S, missing_c)
        except InputError as error:
            raise OperatingPointError(
                f"start at {temperature_c:g} degC: {error}; raise start.power_kw"
            ) from None
        x = (
            depth_mm / (1.0 + p.softening_per_c * tool_c) - p.operating_depth_mm,
            0.0,
            0.0,
            copper[-1],
            tool_c,
        )
        state = CanisterProcessState((*x, 0.0), deque(), deque(copper), canister)
        torque = self.outputs(state, force, 0.0).process_torque_nm
        speed = power_kw * 30000.0 / (pi * torque)
        state.x = (*x, torque + self.outputs(state, force, speed).friction_torque_nm)
        return Equilibrium(force, speed, self.outputs(state, force, speed), state)
