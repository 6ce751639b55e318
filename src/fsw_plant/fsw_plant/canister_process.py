"""The process with heat conduction in a canister in the place of the copper of (16); all else is the paper's.

The power (24) heats the canister at once; its stir zone is what the tool meets. On the thermocouple's way there are the
dead time and the tool's lag of (16), as in the paper, and depth (27) follows the thermocouple, as there.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from math import isfinite, pi

from fsw_canister import CanisterParameters, CanisterState, ReducedCanister, load_or_reduce
from fsw_model import STEP_S, Equilibrium, ModelParameters, OperatingPointError, ProcessModel, ProcessState
from fsw_model.equations import COPPER, TOOL
from fsw_model.process import driven_step
from fsw_plant.tool_path import Motion
from fsw_schema.models import InputError

#: is told the share that is done, and of what
Progress = Callable[[float, str], None]
#: in which the heating-up before the first tick must have come to an end, chosen
_LONGEST_HEATING_S = 1800.0


_reduced: dict[CanisterParameters, ReducedCanister] = {}


def reduced(parameters: CanisterParameters, progress: Progress | None = None) -> ReducedCanister:
    """The reduced canister of these parameters, the last one kept; a new geometry takes a while, which is reported."""
    if parameters not in _reduced:
        made = load_or_reduce(parameters, progress=progress)
        _reduced.clear()
        _reduced[parameters] = made
    return _reduced[parameters]


@dataclass(slots=True)
class CanisterProcessState(ProcessState):
    """State of the process on a canister; ``x[COPPER]`` is the stir zone, ``power`` is not used.

    Attributes
    ----------
    copper : deque of float
        Deviation of the stir zone's temperature at the present tick and before it, as far as the dead time reaches,
        oldest first.
    canister : CanisterState
    motion : Motion
        Of the tool in the next step.
    """

    copper: deque[float]
    canister: CanisterState
    motion: Motion

    def copy(self) -> CanisterProcessState:
        """Independent copy."""
        return CanisterProcessState(self.x, self.power, deque(self.copper), self.canister, self.motion)


class CanisterProcess(ProcessModel):
    """The process on a canister, stepped as :class:`fsw_model.ProcessModel`.

    It has no equilibrium: :meth:`heated` is where it starts.

    Parameters
    ----------
    parameters : ModelParameters
        Of all but the copper's gain and lag.
    canister : ReducedCanister
    """

    def __init__(self, parameters: ModelParameters, canister: ReducedCanister) -> None:
        super().__init__(parameters)
        self._canister = canister
        self._overlap = self.delay_steps - parameters.dead_time_s / STEP_S  # of a step, by which the dead time is less
        self._driven = driven_step(parameters)

    def step(self, state: ProcessState, force_kn: float, speed_rpm: float) -> None:
        """Advance by one step under ``state.motion``; as of :class:`fsw_model.ProcessModel`."""
        assert isinstance(state, CanisterProcessState)
        result = self._driven(*state.x, *self._met(state.copper), force_kn, speed_rpm)
        mean_kw, depth_mm = result[6:]
        if not (depth_mm > 0.0 and isfinite(mean_kw)):
            raise OperatingPointError(
                f"process model: depth {depth_mm:.4g} mm with {force_kn:.4g} kN, {speed_rpm:.4g} rpm; "
                "the model is valid for finite inputs while the shoulder is in the copper, above 0 mm"
            )
        try:
            self._heat(state, max(mean_kw, 0.0))
        except InputError as error:  # the tool is off the copper
            raise OperatingPointError(str(error)) from None
        state.x = (*result[:3], state.copper[-1], *result[4:6])

    def _met(self, copper: deque[float]) -> tuple[float, float]:
        """The copper as the tool meets it at start and end of the next step: what it was a dead time ago."""
        start, end = copper[0], copper[1]
        if self._overlap < 1e-9:
            return start, end
        return start + self._overlap * (end - start), end + self._overlap * (copper[2] - end)

    def _heat(self, state: CanisterProcessState, power_kw: float) -> None:
        """Heat the canister for a step."""
        state.canister = self._canister.step(state.canister, power_kw, *state.motion, STEP_S)
        state.copper.append(self._deviation(state.canister))
        state.copper.popleft()

    def _deviation(self, canister: CanisterState) -> float:
        return self._canister.stir_zone_temperature_c(canister) - self.parameters.operating_temperature_c

    def refit(self, copper: deque[float]) -> deque[float]:
        """As ``with_history``, of the copper's temperature."""
        kept = list(copper)[-self.delay_steps - 1 :]
        return deque([kept[0]] * (self.delay_steps + 1 - len(kept)) + kept)

    def heated(self, depth_mm: float, temperature_c: float, power_kw: float, motion: Motion) -> Equilibrium:
        """The canister heated from ambient by a constant power until the thermocouple shows a temperature.

        Raises
        ------
        OperatingPointError
            If that takes too long, or the shoulder is not in the copper.
        """
        p = self.parameters
        rise_c = temperature_c - p.operating_temperature_c
        softening = 1.0 + p.softening_per_c * rise_c
        if not (depth_mm > 0.0 and softening > 0.0):
            raise OperatingPointError(f"no start at depth {depth_mm:.4g} mm, {temperature_c:.4g} degC (27)")
        canister = self._canister.initial()
        cold = self._deviation(canister)
        modes = (depth_mm / softening - p.operating_depth_mm, 0.0, 0.0)
        state = CanisterProcessState(
            (*modes, cold, cold, 0.0), deque(), deque([cold] * (self.delay_steps + 1)), canister, motion
        )
        force = p.operating_force_kn
        for _ in range(round(_LONGEST_HEATING_S / STEP_S)):
            if state.x[TOOL] >= rise_c:
                break
            tool = self._driven(*state.x, *self._met(state.copper), force, 0.0)[TOOL]
            try:
                self._heat(state, power_kw)
            except InputError as error:
                raise OperatingPointError(f"start: {error}") from None
            state.x = (*modes, state.copper[-1], tool, 0.0)
        else:
            raise OperatingPointError(
                f"start: {power_kw:g} kW heat the canister to {p.operating_temperature_c + state.x[TOOL]:.1f} degC in "
                f"{_LONGEST_HEATING_S:g} s, not to {temperature_c:g} degC; raise start.power_kw"
            )
        modes = (depth_mm / (1.0 + p.softening_per_c * state.x[TOOL]) - p.operating_depth_mm, 0.0, 0.0)
        state.x = (*modes, *state.x[COPPER:])
        torque = self.outputs(state, force, 0.0).process_torque_nm
        speed = power_kw * 30000.0 / (pi * torque)
        state.x = (*state.x[:5], torque + self.outputs(state, force, speed).friction_torque_nm)
        return Equilibrium(force, speed, self.outputs(state, force, speed), state)
