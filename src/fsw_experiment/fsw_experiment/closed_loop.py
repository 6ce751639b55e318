"""The closed loop in one process: plant emulator, controllers and selection, without middleware, at full speed."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import nan
from pathlib import Path
from typing import Any

import numpy as np

from fsw_control.contract import Command, Controller, Limits, Reference
from fsw_control.host import answer
from fsw_control.validity import SensorGuard
from fsw_experiment.open_loop import OpenLoopController
from fsw_experiment.scenario import Scenario, ScenarioError
from fsw_experiment.timeline import references, switches
from fsw_model import STEP_S
from fsw_plant import PlantConfig, PlantEmulator, PlantSchedule
from fsw_recorder.weld_signals import ProposalSignals, StatusSignals, TruthSignals, WeldSignals

TICK_NS = 100_000_000
_TRUTH = (
    "depth_mm",
    "temperature_c",
    "motor_torque_nm",
    "process_torque_nm",
    "friction_torque_nm",
    "process_power_kw",
    "force_kn",
    "speed_rpm",
    "depth_disturbance_mm",
    "temperature_disturbance_c",
    "force_disturbance_kn",
    "speed_disturbance_rpm",
)


def plant_of(scenario: Scenario) -> PlantEmulator:
    """The plant that a scenario sets up, with its disturbances and faults."""
    return PlantEmulator(PlantConfig.from_values(scenario.plant), PlantSchedule.from_yaml(scenario.text, scenario.name))


def start_reference(scenario: Scenario) -> Reference:
    """Set-points in force before a scenario's first reference event: those the plant starts from."""
    return Reference(
        float(scenario.plant.get("start.depth_mm", 2.66)), float(scenario.plant.get("start.temperature_c", 850.0))
    )


@dataclass(slots=True)
class _Hosted:
    """A controller with what it has said so far."""

    controller: Controller
    rows: list[tuple[Any, ...]]
    steps_s: list[float]


class ClosedLoop:
    """Runs a scenario offline.

    All controllers are always warm, as in the graph: each is stepped at every tick and follows the applied command;
    the selected one's proposal is limited and applied. While it is unhealthy the first healthy other one takes its
    place for the tick, and with none the last command is held.

    Parameters
    ----------
    scenario : Scenario
    controllers : mapping of str to Controller
        By name; a scenario without controller needs none.
    limits : Limits, optional
        Bounds and move limits applied after the selection.

    Raises
    ------
    ScenarioError
        If the scenario selects a controller that is not there.
    """

    def __init__(
        self, scenario: Scenario, controllers: Mapping[str, Controller] | None = None, limits: Limits | None = None
    ) -> None:
        self.scenario = scenario
        self.plant = plant_of(scenario)
        self.limits = limits or Limits()
        start = self.plant.applied
        chosen: dict[str, Controller] = dict(controllers or {})
        if scenario.open_loop:
            chosen[OpenLoopController.name] = OpenLoopController(scenario, start, self.limits)
        missing = [name for name in scenario.controllers if name not in chosen]
        if missing:
            raise ScenarioError(
                f"{scenario.name}: controller {', '.join(missing)} is not available; "
                f"available: {', '.join(chosen) or 'none'}"
            )
        for controller in chosen.values():
            controller.reset(start)
        self.selected = OpenLoopController.name if scenario.open_loop else scenario.controller
        self._hosted = {name: _Hosted(controller, [], []) for name, controller in chosen.items()}
        self._applied = start
        self._rows: list[tuple[Any, ...]] = []

    def run(self, progress: Callable[[float], None] | None = None) -> WeldSignals:
        """Run to the end and return what a bag of the same weld would give.

        Parameters
        ----------
        progress : callable, optional
            Called now and then with the share done, 0 to 1.
        """
        scenario, plant, limits, hosted = self.scenario, self.plant, self.limits, self._hosted
        changes, swaps = references(scenario, start_reference(scenario)), switches(scenario)
        reference = changes[0]
        guard = SensorGuard()
        applied = self._applied
        rows = self._rows
        clock = time.perf_counter
        for tick in range(1, scenario.n_ticks + 1):
            reference = changes.get(tick, reference)
            self.selected = swaps.get(tick, self.selected)
            reading = plant.measure()
            stamp_ns = reading.stamp_ns
            values: dict[str, float] = {}
            for sensor, samples in (
                ("depth", reading.depth_mm),
                ("torque", reading.torque_nm),
                ("thermocouple", reading.temperature_c),
            ):
                for sample in samples:
                    if sample.stamp_ns == stamp_ns:
                        values[sensor] = sample.value
                        break
            measurement = guard.measure(stamp_ns * 1e-9, values)
            command, source, healthy = applied, "hold", False
            for name, host in hosted.items():
                began = clock()
                proposal = answer(host.controller, measurement, reference, applied, STEP_S)
                host.steps_s.append(clock() - began)
                wanted = proposal.command
                host.rows.append((wanted.force_kn, wanted.speed_rpm, proposal))
                if proposal.healthy and (not healthy or name == self.selected):
                    command, source, healthy = wanted, name, True
            applied = limits.clip(command, applied)
            rows.append((stamp_ns, values, reference, applied, source, self.selected, plant.truth()))
            plant.apply(applied, stamp_ns, source)
            plant.step()
            if progress is not None and tick % 100 == 0:
                progress(tick / scenario.n_ticks)
        return self._signals()

    def _signals(self) -> WeldSignals:
        rows, n = self._rows, len(self._rows)
        stamps = np.array([row[0] for row in rows], dtype=np.int64)
        commands: list[Command] = [row[3] for row in rows]
        empty = np.full(n, "", dtype=object)

        def sensed(sensor: str) -> Any:
            return np.array([row[1].get(sensor, nan) for row in rows])

        return WeldSignals(
            path=Path(self.scenario.name),
            stamp_ns=stamps,
            time_s=(stamps - stamps[0]) * 1e-9,
            depth_mm=sensed("depth"),
            torque_nm=sensed("torque"),
            temperature_c=sensed("thermocouple"),
            reference_depth_mm=np.array([row[2].depth_mm for row in rows]),
            reference_temperature_c=np.array([row[2].temperature_c for row in rows]),
            force_kn=np.array([command.force_kn for command in commands]),
            speed_rpm=np.array([command.speed_rpm for command in commands]),
            command_source=np.array([row[4] for row in rows], dtype=object),
            command_reason=empty,
            command_latency_s=np.full(n, nan),
            actual_controller=np.array([row[5] for row in rows], dtype=object),
            actual_mode=np.full(n, "auto", dtype=object),
            proposals={name: _proposal_signals(host) for name, host in self._hosted.items()},
            statuses={name: self._status_signals(name, host) for name, host in self._hosted.items()},
            truth=_truth_signals([row[6] for row in rows]),
            attachments={"scenario.yaml": self.scenario.text.encode()},
        )

    def _status_signals(self, name: str, host: _Hosted) -> StatusSignals:
        diagnoses = [row[2].diagnosis for row in host.rows]

        def numbers(attribute: str) -> Any:
            return np.array([getattr(diagnosis, attribute) for diagnosis in diagnoses], dtype=np.float64)

        names = dict.fromkeys(key for diagnosis in diagnoses for key in diagnosis.disturbances)
        return StatusSignals(
            depth_estimate_mm=numbers("depth_estimate_mm"),
            temperature_estimate_c=numbers("temperature_estimate_c"),
            torque_estimate_nm=numbers("torque_estimate_nm"),
            healthy=np.array([row[2].healthy for row in host.rows], dtype=np.float64),
            selected=np.array([row[4] == name for row in self._rows], dtype=np.float64),
            solve_time_s=numbers("solve_time_s"),
            iterations=numbers("iterations"),
            bad_cycles=numbers("bad_cycles"),
            solver_status=np.array([diagnosis.solver_status for diagnosis in diagnoses], dtype=object),
            reason=np.array([row[2].reason for row in host.rows], dtype=object),
            active_limits=np.array([",".join(diagnosis.active_limits) for diagnosis in diagnoses], dtype=object),
            disturbances={
                key: np.array([diagnosis.disturbances.get(key, nan) for diagnosis in diagnoses]) for key in names
            },
        )


def _proposal_signals(host: _Hosted) -> ProposalSignals:
    return ProposalSignals(
        force_kn=np.array([row[0] for row in host.rows]),
        speed_rpm=np.array([row[1] for row in host.rows]),
        healthy=np.array([row[2].healthy for row in host.rows], dtype=np.float64),
        reason=np.array([row[2].reason for row in host.rows], dtype=object),
        latency_s=np.array(host.steps_s),
    )


def _truth_signals(truths: list[Any]) -> TruthSignals:
    numbers: dict[str, Any] = {name: np.array([getattr(truth, name) for truth in truths]) for name in _TRUTH}
    return TruthSignals(
        **numbers,
        watchdog=np.array([int(truth.watchdog) for truth in truths], dtype=np.float64),
        refused_commands=np.array([truth.refused_commands for truth in truths], dtype=np.float64),
        active_faults=np.array([",".join(truth.active_faults) for truth in truths], dtype=object),
    )
