"""The closed loop in one process, without middleware: plant, controllers and selection."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields, replace
from math import nan
from operator import attrgetter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from fsw_analysis.weld_signals import (
    DriveSignals,
    FloatArray,
    ProposalSignals,
    StatusSignals,
    TextArray,
    TruthSignals,
    WeldSignals,
    experiment_time_s,
)
from fsw_control.command_gate import answer
from fsw_control.contract import Command, Controller, Limits, Measurement, Proposal, Reference
from fsw_control.ramps import ReferencePlan, stair
from fsw_control.reason import Reason
from fsw_control.schema.models import InputError
from fsw_control.sensors import OPTIONAL, REQUIRED, SENSORS
from fsw_control.validity import SensorGuard
from fsw_control.weld import TICK_NS, TICK_S
from fsw_model import STEP_S
from fsw_model.heat_profile import HeatProfile
from fsw_plant import PlantEmulator, Truth
from fsw_scenario.plants import OwnPlant, Plant, plant_of
from fsw_scenario.scenario import Scenario, start_reference
from fsw_scenario.timeline import SWITCH_TIMEOUT_S, OpenLoopController, references, switches
from fsw_scenario.weld_programme import READING_AGE_TICKS, PhaseMachine
from fsw_scenario.weld_programme_course import Course, HeatAhead
from fsw_supervisor import Arbiter, Decision, ProposalInput, SupervisorParameters

#: ticks between progress reports
_PROGRESS_TICKS = 100


class OfflineSupervisor:
    """Decides every tick like the supervisor of a lockstep graph, with default parameters.

    It starts with the controller ``selected``. Controllers that are not in its parameter
    ``fallbacks`` follow after those that are.
    """

    def __init__(self, controllers: Mapping[str, Controller], selected: str) -> None:
        fallbacks = dict.fromkeys([*SupervisorParameters().fallbacks, *controllers])
        settings = SupervisorParameters.from_values(
            {"controller": selected, "fallbacks": list(fallbacks)}
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
        depth_deviation_mm: float = nan,
    ) -> Decision:
        """Command that answers a tick, given the samples by sensor (mm, N m, degC)."""
        arbiter = self._arbiter
        self._now_s += TICK_S
        decisions = arbiter.on_drives(stamp_ns, drives, self._now_s)
        arbiter.on_depth_deviation(stamp_ns, depth_deviation_mm)
        arbiter.ticks.enter(values)  # all at once: half the time of on_sample for each
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


class _Programme:
    """Set-points by tick; on a canister a phase may end early, when its temperature is reached."""

    def __init__(self, scenario: Scenario, heat: HeatAhead | None = None) -> None:
        self._heat_ahead = heat
        self._course = Course(references(scenario, start_reference(scenario.plant)))
        self._machine = PhaseMachine(scenario.phases, scenario.n_ticks)
        self._announced, self._n_ticks = scenario.announced, scenario.n_ticks
        self._shown: deque[float] = deque(maxlen=READING_AGE_TICKS + 1)
        self.reference = self._course.coming.popleft()[1]  #: in force
        self._announce()

    def _announce(self) -> None:
        held = self._machine.held
        planned = [((tick + held) * TICK_NS, point) for tick, point in stair(self._course.coming)]
        self.plan = ReferencePlan(planned) if self._announced else None
        self._heat = self._heat_ahead.plan(held * TICK_NS * 1e-9) if self._heat_ahead else None

    def over(self, tick: int) -> bool:
        """Whether the scenario ends before a tick of the process."""
        return tick - self._machine.held > self._n_ticks

    def begin(self, tick: int) -> Reference:
        """Set-points at a tick, with the announced ones."""
        coming = self._course.coming
        while coming and coming[0][0] <= tick - self._machine.held:
            self.reference = coming.popleft()[1]
        if self.plan is None and self._heat is None:
            return self.reference
        after = self.plan.after(tick * TICK_NS, self.reference) if self.plan else ()
        return replace(self.reference, coming=after, heat=self._heat)

    def end(self, tick: int, plant: PlantEmulator | OwnPlant, shown_c: float) -> int:
        """Follow the thermocouple at a tick and move the tool; returns the programme's tick."""
        machine = self._machine
        self._shown.append(shown_c)
        if machine.follow(tick, self._shown[0]):
            self._course.resume(self.reference, machine.tick, warm=True)
            self._announce()
        if machine.held and not isinstance(plant, OwnPlant):
            plant.follow_programme(machine.tick * STEP_S, standing=False)
        return machine.tick


class _Tick(NamedTuple):
    """Record of a tick, with the proposal and computing time of each controller."""

    stamp_ns: int
    values: dict[str, float]
    drives: Command
    reference: Reference
    answers: dict[str, tuple[Proposal, float]]
    applied: Command
    source: str
    reason: Reason
    active: str
    mode: str
    truth: Truth | None


class ClosedLoop:
    """Runs a scenario offline, with controllers by name; an open-loop scenario needs none.

    All controllers are always ready, as in the graph: each is stepped at every tick and tracks the
    applied command. With several, or with sensor faults in the scenario, the supervisor's arbiter
    selects, including fallback, inhibition and interlocks, so that the trajectory equals that of
    the graph in lockstep. Otherwise a single controller is studied without supervisor: its
    proposal is limited and applied, and the last command is held while it is unhealthy.

    With the ``heat`` of a type of weld controllers know beforehand how much of it comes. A user's
    ``plant`` replaces the emulated one.

    Raises
    ------
    fsw_control.schema.models.InputError
        If the scenario selects a controller that is not there, or has no phases by which the heat
        would go.
    """

    def __init__(
        self,
        scenario: Scenario,
        controllers: Mapping[str, Controller] | None = None,
        heat: HeatProfile | None = None,
        plant: Plant | None = None,
    ) -> None:
        self.scenario = scenario
        self._heat = None if heat is None else HeatAhead(heat, scenario.phases)
        self.plant = plant_of(scenario) if plant is None else OwnPlant(plant, scenario)
        start = self.plant.applied
        self._controllers: dict[str, Controller] = dict(controllers or {})
        if scenario.open_loop:
            self._controllers[OpenLoopController.name] = OpenLoopController(scenario, start)
        missing = [name for name in scenario.controllers if name not in self._controllers]
        if missing:
            raise InputError(
                f"{scenario.name}: controller {', '.join(missing)} is not available; "
                f"available: {', '.join(self._controllers) or 'none'}"
            )
        for controller in self._controllers.values():
            controller.reset(start)

    @property
    def _first(self) -> str:
        return OpenLoopController.name if self.scenario.open_loop else self.scenario.controller

    @property
    def selected(self) -> Controller:
        """Controller that the scenario starts with."""
        return self._controllers[self._first]

    def run(self, progress: Callable[[float], None] | None = None) -> WeldSignals:
        """Run to the end and return the same signals as a bag of the weld.

        ``progress`` is called now and then with the share done, 0 to 1. InputError with the reason
        at the first tick if the controller that was selected proposed nothing that could be
        applied: figures of a held command are none. For a part of the weld, and without a
        supervisor, the signals' problems have a remark.
        """
        scenario, plant, limits = self.scenario, self.plant, Limits()
        programme, swaps = _Programme(scenario, self._heat), deque(switches(scenario).items())
        applied, tick = plant.applied, 0
        first = self._first
        faulty = any(event.fault is not None for event in scenario.events)
        supervised = faulty or len(self._controllers) > 1
        supervisor = OfflineSupervisor(self._controllers, first) if supervised else None
        (active, mode), reason = (first, "auto"), Reason()
        guard = SensorGuard()
        ticks: list[_Tick] = []
        while not programme.over(tick := tick + 1):
            reference = programme.begin(tick)
            reading = plant.measure()
            stamp_ns, values, drives = reading.stamp_ns, reading.values, reading.drives
            measurement = guard.measure(stamp_ns * 1e-9, values, drives)
            answers = {
                name: _timed_answer(controller, measurement, reference, applied)
                for name, controller in self._controllers.items()
            }
            if supervisor is None:
                proposal, _ = answers[first]
                source = first if proposal.healthy else "hold"
                applied = limits.clip(proposal.command if proposal.healthy else applied, applied)
            else:
                proposals = {name: proposal for name, (proposal, _) in answers.items()}
                decision = supervisor.decide(
                    stamp_ns,
                    values,
                    drives,
                    proposals,
                    nan if reading.fused is None else reading.fused.deviation_mm,
                )
                applied, source, reason = decision.command, decision.source, decision.reason
                active, mode = supervisor.state
            passed = programme.end(tick, plant, values.get("thermocouple", nan))
            while supervisor is not None and swaps and swaps[0][0] <= passed + 1:
                supervisor.switch(swaps.popleft()[1])
            decided = (reference, answers, applied, source, reason, active, mode)
            truth = None if isinstance(plant, OwnPlant) else plant.truth()
            ticks.append(_Tick(stamp_ns, values, drives, *decided, truth))
            plant.apply(applied, stamp_ns, source)
            plant.step()
            if progress is not None and tick % _PROGRESS_TICKS == 0:
                progress(passed / scenario.n_ticks)
        if ticks and not any(row.answers[first][0].healthy for row in ticks):
            why = Reason.of(ticks[0].answers[first][0].reason).words
            raise InputError(
                f"{scenario.name}: {first} proposed nothing usable "
                f"at any of {len(ticks)} ticks: {why}"
            )
        signals = self._signals(ticks)
        if supervisor is None and (remark := unhealthy(signals, first)):
            signals.problems.append(remark)  # the figures are partly those of a held command
        return signals

    def _signals(self, ticks: Sequence[_Tick]) -> WeldSignals:
        stamps = np.array([tick.stamp_ns for tick in ticks], dtype=np.int64)
        emulated = None if isinstance(self.plant, OwnPlant) else self.plant
        sensors = emulated.core.sensors if emulated else ()
        statuses, problems = {}, []
        for name in self._controllers:
            try:
                statuses[name] = _status_signals(ticks, name)
            # a user's diagnosis may hold anything
            except (TypeError, ValueError, AttributeError) as error:
                problems.append(f"{name}: its diagnostics cannot be read: {error}")
        return WeldSignals(
            path=Path(self.scenario.name),
            stamp_ns=stamps,
            time_s=experiment_time_s(stamps),
            **_sensors(ticks, REQUIRED),
            optional=_sensors(ticks, [name for name in sensors if name in OPTIONAL]),
            reference_depth_mm=_numbers(tick.reference.depth_mm for tick in ticks),
            reference_temperature_c=_numbers(tick.reference.temperature_c for tick in ticks),
            force_kn=_numbers(tick.applied.force_kn for tick in ticks),
            speed_rpm=_numbers(tick.applied.speed_rpm for tick in ticks),
            command_source=_texts(tick.source for tick in ticks),
            command_reason=_texts(tick.reason.words for tick in ticks),
            command_latency_s=_numbers(nan for _ in ticks),
            actual_controller=_texts(tick.active for tick in ticks),
            actual_mode=_texts(tick.mode for tick in ticks),
            proposals={name: _proposal_signals(ticks, name) for name in self._controllers},
            statuses=statuses,
            problems=problems,
            drives=_group(DriveSignals, [tick.drives for tick in ticks]),
            truth=_group(TruthSignals, [tick.truth for tick in ticks]) if emulated else None,
            attachments={"scenario.yaml": self.scenario.text.encode()},
        )


def _timed_answer(
    controller: Controller, measurement: Measurement, reference: Reference, applied: Command
) -> tuple[Proposal, float]:
    began = time.perf_counter()
    proposal = answer(controller, measurement, reference, applied, STEP_S)
    return proposal, time.perf_counter() - began


def unhealthy(signals: WeldSignals, name: str) -> str:
    """How often, and why first, a controller's proposals could not be applied; else empty."""
    proposal = signals.proposals[name]
    ticks = np.flatnonzero(proposal.healthy == 0.0)
    if not ticks.size:
        return ""
    first, commanded = int(ticks[0]), float(np.mean(signals.command_source == name))
    return (
        f"{name} is unhealthy in {ticks.size} of {signals.n_ticks} ticks and commanded "
        f"{commanded:.1%} of them, first at tick {first + 1} "
        f"({signals.time_s[first]:.1f} s): {proposal.reason[first]}"
    )


def _proposal_signals(ticks: Sequence[_Tick], name: str) -> ProposalSignals:
    answers = [tick.answers[name] for tick in ticks]
    signals: ProposalSignals = _group(
        ProposalSignals,
        [proposal.command for proposal, _ in answers],
        healthy=_numbers(proposal.healthy for proposal, _ in answers),
        reason=_texts(Reason.of(proposal.reason).words for proposal, _ in answers),
        latency_s=_numbers(seconds for _, seconds in answers),
    )
    return signals


def _status_signals(ticks: Sequence[_Tick], name: str) -> StatusSignals:
    proposals = [tick.answers[name][0] for tick in ticks]
    diagnoses = [proposal.diagnosis for proposal in proposals]
    keys = dict.fromkeys(key for diagnosis in diagnoses for key in diagnosis.disturbances)
    status: StatusSignals = _group(
        StatusSignals,
        diagnoses,
        healthy=_numbers(proposal.healthy for proposal in proposals),
        selected=_numbers(tick.source == name for tick in ticks),
        reason=_texts(Reason.of(proposal.reason).words for proposal in proposals),
        disturbances={
            key: _numbers(row.disturbances.get(key, nan) for row in diagnoses) for key in keys
        },
    )
    return status


def _group(kind: Any, sources: Sequence[Any], **known: Any) -> Any:
    """A group of signals from objects with attributes named like its columns, plus known ones."""
    missing = [column for column in fields(kind) if column.name not in known]
    columns = zip(*map(attrgetter(*(column.name for column in missing)), sources), strict=True)
    for column, values in zip(missing, columns, strict=True):
        if column.metadata["kind"] == "number":
            known[column.name] = _numbers(values)
        else:
            known[column.name] = _texts(
                value if isinstance(value, str) else ",".join(value) for value in values
            )
    return kind(**known)


def _sensors(ticks: Sequence[_Tick], names: Iterable[str]) -> dict[str, Any]:
    """Sensor samples by signal."""
    return {
        SENSORS[name].signal: _numbers(tick.values.get(name, nan) for tick in ticks)
        for name in names
    }


def _numbers(values: Iterable[float]) -> FloatArray:
    return np.fromiter(values, dtype=np.float64)


def _texts(values: Iterable[str]) -> TextArray:
    return np.array(list(values), dtype=object)
