"""A programme's progress reports, added to the signals of a weld simulated in one process."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fsw_analysis.weld_signals import WeldEvent, WeldSignals
from fsw_scenario.scenario import Scenario
from fsw_scenario.weld_programme import READING_AGE_TICKS, PhaseMachine, Progress, State


def progress(scenario: Scenario, signals: WeldSignals) -> list[Progress]:
    """Progress of the programme at each tick; the player gets thermocouple readings late."""
    machine, reports = PhaseMachine(scenario.phases), []
    shown = signals.temperature_c.tolist()
    readings = [*shown[:1] * READING_AGE_TICKS, *shown]
    for tick in range(1, signals.n_ticks + 1):
        machine.follow(tick, readings[tick - 1])
        reports.append(machine.progress())
    return reports


def with_programme(signals: WeldSignals, scenario: Scenario) -> WeldSignals:
    """Signals with phases, positions and end of the weld as in a bag; unchanged without phases."""
    if not scenario.phases or not signals.n_ticks:
        return signals
    reports = list(zip(signals.time_s.tolist(), progress(scenario, signals), strict=True))
    phases = [(reports[0][1].phase, reports[0][0])]
    for time_s, report in reports:
        if report.phase != phases[-1][0]:
            phases.append((report.phase, time_s))
    events = [*signals.events, *(WeldEvent(time_s, "phase", name) for name, time_s in phases)]
    done = [time_s for time_s, report in reports if report.state is State.DONE]
    events += [WeldEvent(time_s, "weld", str(State.DONE)) for time_s in done[:1]]
    events.sort(key=lambda event: event.time_s)
    places = np.array([(report.angle_deg, report.length_mm) for _, report in reports])
    return replace(
        signals, phases=phases, angle_deg=places[:, 0], travel_mm=places[:, 1], events=events
    )
