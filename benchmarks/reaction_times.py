#!/usr/bin/env python3
"""Reaction and process safety times of the safety case's faults, simulated, one process.

Each fault begins in a weld in equilibrium. With the supervisor's arbiter and the plant's watchdog,
the reaction time is from the fault's onset to the first command or watchdog step of a safe stop,
with the arbiter's deadline added. Without them (the active controller's proposal is limited and
applied, and the last one held), the process safety time is from the onset until the process, free
of noise, is beyond a trip limit. The worst of several seeds counts for each. The figures are the
same on every run; ``scripts/build_docs.py`` writes them into docs/concepts/safety.md.

usage: reaction_times.py [--quick] [--json FILE]
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass
from math import inf, nan
from typing import Any

import _benchmark

from fsw_control.command_gate import answer
from fsw_control.contract import Command, Limits, Proposal
from fsw_control.parameters import defaults
from fsw_control.validity import SensorGuard
from fsw_control.weld import TICK_S
from fsw_model import STEP_S
from fsw_plant import PlantConfig, PlantEmulator, PlantSchedule, Truth
from fsw_plant.emulator import WatchdogState
from fsw_plant.event_schema import disturbance, fault
from fsw_scenario.closed_loop import OfflineSupervisor
from fsw_scenario.controllers import make
from fsw_scenario.scenario import start_reference
from fsw_supervisor.parameters import SupervisorParameters

ACTIVE = "nmpc"
ONSET_TICK, HORIZON_S, SEEDS = 200, 120.0, (1, 2, 3)
_SETTINGS = defaults(SupervisorParameters)
#: by quantity: value of the process, unit, sign of the dangerous side
QUANTITIES: dict[str, tuple[Callable[[Truth], float], str, float]] = {
    "depth_high": (lambda truth: truth.depth_mm, "mm", 1.0),
    "temperature_high": (lambda truth: truth.temperature_c, "°C", 1.0),
    "temperature_low": (lambda truth: truth.temperature_c, "°C", -1.0),
    "force_high": (lambda truth: truth.force_kn, "kN", 1.0),
    "torque_high": (lambda truth: truth.motor_torque_nm, "N·m", 1.0),
}
LIMITS: dict[str, float] = {name: _SETTINGS[f"interlocks.{name}.trip"] for name in QUANTITIES}


@dataclass(frozen=True)
class Fault:
    """A fault of the table: what begins at its onset, and the limit that it threatens."""

    hazard: str
    name: str
    limit: str
    events: Sequence[Any] = ()  #: of the plant's schedule
    #: what the active controller adds to the applied command in each tick, kN and rpm; None: it
    #: works
    runaway: tuple[float, float] | None = None
    unusable: bool = False  #: no controller is healthy
    silent: bool = False  #: no command reaches the plant


def _sensor(sensor: str, kind: str, magnitude: float = 0.0) -> list[Any]:
    return [fault(sensor, kind, magnitude)]


def _push(amplitude_kn: float) -> list[Any]:
    return [disturbance("axial_force", "step", amplitude_kn)]


FAULTS = (
    Fault("Too deep", "the active controller raises the force", "depth_high", runaway=(1.0, 0.0)),
    Fault(
        "Too deep", "the depth sensor slips by −2 mm", "depth_high", _sensor("depth", "bias", -2.0)
    ),
    Fault(
        "Too deep",
        "the depth sensor drifts by −0.05 mm/s",
        "depth_high",
        _sensor("depth", "drift", -0.05),
    ),
    Fault("Too deep", "depth samples are missing", "depth_high", _sensor("depth", "dropout")),
    Fault(
        "Too hot",
        "the active controller raises the speed",
        "temperature_high",
        runaway=(0.0, 10.0),
    ),
    Fault(
        "Too hot",
        "the thermocouple drifts by −2 °C/s",
        "temperature_high",
        _sensor("thermocouple", "drift", -2.0),
    ),
    Fault(
        "Too hot",
        "the thermocouple shows 1000 °C more",
        "temperature_high",
        _sensor("thermocouple", "bias", 1e3),
    ),
    Fault(
        "Too hot",
        "the torque shows 450 N·m too little",
        "temperature_high",
        _sensor("torque", "bias", -450.0),
    ),
    Fault(
        "Too cold",
        "the active controller lowers the speed",
        "temperature_low",
        runaway=(0.0, -10.0),
    ),
    Fault(
        "Too cold",
        "the thermocouple drifts by 2 °C/s",
        "temperature_low",
        _sensor("thermocouple", "drift", 2.0),
    ),
    Fault(
        "The tool breaks", "the drive pushes 20 kN more than commanded", "force_high", _push(20.0)
    ),
    Fault(
        "The tool breaks",
        "the torque shows 500 N·m too much",
        "torque_high",
        _sensor("torque", "bias", 500.0),
    ),
    Fault(
        "The tool breaks",
        "the torque shows 2000 N·m too much",
        "torque_high",
        _sensor("torque", "bias", 2000.0),
    ),
    Fault("Uncontrolled force", "no controller is usable", "depth_high", unusable=True),
    Fault(
        "Uncontrolled force",
        "the same, and the drive pushes 5 kN more",
        "depth_high",
        _push(5.0),
        unusable=True,
    ),
    Fault("Uncontrolled force", "no command arrives", "depth_high", silent=True),
    Fault(
        "Uncontrolled force",
        "the same, and the drive pushes 5 kN more",
        "depth_high",
        _push(5.0),
        silent=True,
    ),
)


class _Weld:
    """A weld with a fault, tick by tick, with or without what reacts to it."""

    def __init__(self, case: Fault, seed: int, protected: bool) -> None:
        self._case, self._protected, self._failed = case, protected, False
        config: dict[str, Any] = {"seed": seed} | (
            {} if protected else {"watchdog": {"hold_s": 600.0}}
        )
        self._plant = PlantEmulator(PlantConfig.from_values(config), PlantSchedule())
        self._controllers = {name: make(name) for name in ("nmpc", "decentral")}
        self._applied = self._plant.applied
        for controller in self._controllers.values():
            controller.reset(self._applied)
        self._supervisor = OfflineSupervisor(self._controllers, ACTIVE)
        self._guard, self._limits, self._reference = SensorGuard(), Limits(), start_reference({})

    def step(self, failed: bool) -> tuple[str, Truth]:
        """One tick; returns why a safe stop was commanded in it, if one was, and the process."""
        case, plant = self._case, self._plant
        if failed and not self._failed:
            for event in case.events:
                plant.begin(copy(event))
        self._failed = failed
        reading = plant.measure()
        stamp_ns, values, drives = reading.stamp_ns, reading.values, reading.drives
        measurement = self._guard.measure(stamp_ns * 1e-9, values, drives)
        proposals = {
            name: self._spoilt(
                name,
                answer(controller, measurement, self._reference, self._applied, STEP_S),
                failed,
            )
            for name, controller in self._controllers.items()
        }
        stopped = ""
        if self._protected:
            decision = self._supervisor.decide(stamp_ns, values, drives, proposals)
            self._applied, source = decision.command, decision.source
            if source == "safe_stop" and not (failed and case.silent):
                stopped = ", ".join(decision.reason.interlocks) or decision.reason.words
        else:
            proposal, source = proposals[ACTIVE], ACTIVE
            self._applied = self._limits.clip(
                proposal.command if proposal.healthy else self._applied, self._applied
            )
        truth = plant.truth()
        if not (failed and case.silent):
            plant.apply(self._applied, stamp_ns, source)
        plant.step()
        return (
            "watchdog of the drives" if plant.truth().watchdog is WatchdogState.SAFE else stopped,
            truth,
        )

    def _spoilt(self, name: str, proposal: Proposal, failed: bool) -> Proposal:
        case = self._case
        if failed and case.unusable:
            return Proposal(self._applied, healthy=False, reason="fault of the benchmark")
        if failed and case.runaway is not None and name == ACTIVE:
            force_kn, speed_rpm = case.runaway
            moved = Command(self._applied.force_kn + force_kn, self._applied.speed_rpm + speed_rpm)
            return Proposal(self._limits.clip(moved, self._applied))
        return proposal


@dataclass
class _Outcome:
    """A run from the onset on: seconds to the safe stop and to the limit, NaN if there is none."""

    stop_s: float = nan
    cause: str = ""
    limit_s: float = nan
    beyond_s: float = 0.0  #: beyond the limit altogether
    worst: float = nan  #: value


def _run(case: Fault, seed: int, protected: bool) -> _Outcome:
    weld, outcome = _Weld(case, seed, protected), _Outcome()
    value_of, _, sign = QUANTITIES[case.limit]
    for tick in range(ONSET_TICK + round(HORIZON_S / TICK_S)):
        cause, truth = weld.step(tick >= ONSET_TICK)
        since_s = (tick - ONSET_TICK) * TICK_S
        if tick < ONSET_TICK:
            assert not cause, f"{case.name}: the weld stops before the fault"
            continue
        if cause and not outcome.cause:
            outcome.stop_s, outcome.cause = since_s, cause
        if outcome.cause and case.limit == "temperature_low":
            continue  # a safe stop cools the weld: that is not the fault's doing
        value = value_of(truth)
        outcome.worst = (
            value
            if outcome.worst != outcome.worst
            else sign * max(sign * value, sign * outcome.worst)
        )
        if sign * value > sign * LIMITS[case.limit]:
            outcome.limit_s = since_s if outcome.limit_s != outcome.limit_s else outcome.limit_s
            outcome.beyond_s += TICK_S
    return outcome


def measured(case: Fault, seeds: Sequence[int] = SEEDS) -> _benchmark.Figures:
    """The row of a fault: the slowest reaction, and the soonest that a limit is passed."""
    with_, without = (
        [_run(case, seed, protected) for seed in seeds] for protected in (True, False)
    )
    _, unit, sign = QUANTITIES[case.limit]
    slowest = max(with_, key=lambda run: run.stop_s if run.cause else inf)
    passed = [run.limit_s for run in without if run.limit_s == run.limit_s]
    return {
        "hazard": case.hazard,
        "fault": case.name,
        "limit": f"{case.limit} {LIMITS[case.limit]:g} {unit}",
        "reaction_s": round(slowest.stop_s + _SETTINGS["deadline_s"], 2)
        if slowest.cause
        else None,
        "by": slowest.cause,
        "process_safety_s": round(min(passed), 1) if passed else None,
        "beyond_s": round(max(run.beyond_s for run in with_), 1),
        "worst_with_reaction": round(
            sign * max(sign * run.worst for run in with_), 1 + (unit == "mm")
        ),
        "worst_without_reaction": round(
            sign * max(sign * run.worst for run in without), 1 + (unit == "mm")
        ),
        "unit": unit,
    }


def main() -> int:
    """Measure all faults, print a table and write the JSON."""
    arguments = _benchmark.parser(__doc__, "one seed instead of three").parse_args()
    seeds = SEEDS[:1] if arguments.quick else SEEDS
    rows = []
    for case in FAULTS:
        rows.append(row := measured(case, seeds))
        times = (
            "-" if row[key] is None else f"{row[key]:.2f}"
            for key in ("reaction_s", "process_safety_s")
        )
        print(
            f"{case.hazard:<19}{case.name:<46}" + "".join(f"{time:>8}" for time in times),
            row["by"],
            flush=True,
        )
    _benchmark.save({"horizon_s": HORIZON_S, "seeds": len(seeds), "rows": rows}, arguments.json)
    return 0


if __name__ == "__main__":
    sys.exit(main())
