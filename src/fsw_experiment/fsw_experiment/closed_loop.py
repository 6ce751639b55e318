"""The closed loop in one process: plant emulator, controllers and selection, without middleware, at full speed."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from math import nan
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from fsw_analysis.weld_signals import DriveSignals, ProposalSignals, StatusSignals, TruthSignals, WeldSignals
from fsw_control import weld
from fsw_control.contract import Command, Controller, Limits, Proposal, Reference
from fsw_control.host import answer
from fsw_control.references import ReferencePlan
from fsw_control.validity import SensorGuard
from fsw_experiment.open_loop import OpenLoopController
from fsw_experiment.scenario import Scenario, ScenarioError
from fsw_experiment.timeline import references, switches
from fsw_model import STEP_S
from fsw_plant import PlantConfig, PlantEmulator, PlantSchedule, Truth

TICK_NS = 100_000_000
#: ticks between two reports of progress
_PROGRESS_TICKS = 100


def plant_of(scenario: Scenario) -> PlantEmulator:
    """The plant that a scenario sets up, with its disturbances and faults."""
    return PlantEmulator(PlantConfig.from_values(scenario.plant), PlantSchedule.from_yaml(scenario.text, scenario.name))


def start_reference(scenario: Scenario) -> Reference:
    """Set-points in force before a scenario's first reference event: those the plant starts from."""
    plant = scenario.plant
    return Reference(
        float(plant.get("start.depth_mm", weld.DEPTH_MM)), float(plant.get("start.temperature_c", weld.TEMPERATURE_C))
    )


@dataclass(slots=True)
class _Hosted:
    """A controller with its proposals so far, and how long each took."""

    controller: Controller
    proposals: list[Proposal] = field(default_factory=list)
    steps_s: list[float] = field(default_factory=list)


class _Row(NamedTuple):
    """What happened at one tick."""

    stamp_ns: int
    values: dict[str, float]
    drives: Command
    reference: Reference
    applied: Command
    source: str
    selected: str
    truth: Truth


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
        self._hosted = {name: _Hosted(controller) for name, controller in chosen.items()}
        self._applied = start
        self._rows: list[_Row] = []

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
        plan = ReferencePlan([(tick * TICK_NS, one) for tick, one in changes.items()]) if scenario.announced else None
        guard = SensorGuard()
        applied = self._applied
        clock = time.perf_counter
        for tick in range(1, scenario.n_ticks + 1):
            reference = changes.get(tick, reference)
            if plan is not None:
                reference = replace(reference, coming=plan.after(tick * TICK_NS))
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
            drives = reading.drives
            measurement = guard.measure(stamp_ns * 1e-9, values, drives)
            command, source, healthy = applied, "hold", False
            for name, host in hosted.items():
                began = clock()
                proposal = answer(host.controller, measurement, reference, applied, STEP_S)
                host.steps_s.append(clock() - began)
                host.proposals.append(proposal)
                if proposal.healthy and (not healthy or name == self.selected):
                    command, source, healthy = proposal.command, name, True
            applied = limits.clip(command, applied)
            row = _Row(stamp_ns, values, drives, reference, applied, source, self.selected, plant.truth())
            self._rows.append(row)
            plant.apply(applied, stamp_ns, source)
            plant.step()
            if progress is not None and tick % _PROGRESS_TICKS == 0:
                progress(tick / scenario.n_ticks)
        return self._signals()

    def _signals(self) -> WeldSignals:
        rows, n = self._rows, len(self._rows)
        stamps = np.array([row.stamp_ns for row in rows], dtype=np.int64)

        def numbers(value: Callable[[_Row], float]) -> Any:
            return np.array([value(row) for row in rows], dtype=np.float64)

        def texts(value: Callable[[_Row], str]) -> Any:
            return np.array([value(row) for row in rows], dtype=object)

        return WeldSignals(
            path=Path(self.scenario.name),
            stamp_ns=stamps,
            time_s=(stamps - stamps[0]) * 1e-9,
            depth_mm=numbers(lambda row: row.values.get("depth", nan)),
            torque_nm=numbers(lambda row: row.values.get("torque", nan)),
            temperature_c=numbers(lambda row: row.values.get("thermocouple", nan)),
            reference_depth_mm=numbers(lambda row: row.reference.depth_mm),
            reference_temperature_c=numbers(lambda row: row.reference.temperature_c),
            force_kn=numbers(lambda row: row.applied.force_kn),
            speed_rpm=numbers(lambda row: row.applied.speed_rpm),
            command_source=texts(lambda row: row.source),
            command_reason=texts(lambda _: ""),
            command_latency_s=np.full(n, nan),
            actual_controller=texts(lambda row: row.selected),
            actual_mode=texts(lambda _: "auto"),
            proposals={name: _proposal_signals(host) for name, host in self._hosted.items()},
            statuses={name: self._status_signals(name, host) for name, host in self._hosted.items()},
            drives=DriveSignals(numbers(lambda row: row.drives.force_kn), numbers(lambda row: row.drives.speed_rpm)),
            truth=_group(TruthSignals, [row.truth for row in rows]),
            attachments={"scenario.yaml": self.scenario.text.encode()},
        )

    def _status_signals(self, name: str, host: _Hosted) -> StatusSignals:
        diagnoses = [proposal.diagnosis for proposal in host.proposals]
        status: StatusSignals = _group(
            StatusSignals,
            diagnoses,
            healthy=np.array([proposal.healthy for proposal in host.proposals], dtype=np.float64),
            selected=np.array([row.source == name for row in self._rows], dtype=np.float64),
            reason=np.array([proposal.reason for proposal in host.proposals], dtype=object),
        )
        names = dict.fromkeys(key for diagnosis in diagnoses for key in diagnosis.disturbances)
        status.disturbances = {
            key: np.array([diagnosis.disturbances.get(key, nan) for diagnosis in diagnoses]) for key in names
        }
        return status


def _proposal_signals(host: _Hosted) -> ProposalSignals:
    return ProposalSignals(
        force_kn=np.array([proposal.command.force_kn for proposal in host.proposals]),
        speed_rpm=np.array([proposal.command.speed_rpm for proposal in host.proposals]),
        healthy=np.array([proposal.healthy for proposal in host.proposals], dtype=np.float64),
        reason=np.array([proposal.reason for proposal in host.proposals], dtype=object),
        latency_s=np.array(host.steps_s),
    )


def _group(kind: Any, sources: list[Any], **known: Any) -> Any:
    """A group of signals from objects whose attributes have the names of its columns."""
    values = dict(known)
    for one in fields(kind):
        if one.name in known or "kind" not in one.metadata:
            continue
        raw = [getattr(source, one.name) for source in sources]
        if one.metadata["kind"] == "number":
            values[one.name] = np.array([float(value) for value in raw])
        else:
            texts = [value if isinstance(value, str) else ",".join(value) for value in raw]
            values[one.name] = np.array(texts, dtype=object)
    return kind(**values)
