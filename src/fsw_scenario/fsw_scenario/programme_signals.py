"""What the player of a programme reports, added to the signals of a weld that was simulated in this process."""

from __future__ import annotations

from collections import deque
from dataclasses import replace

import numpy as np

from fsw_analysis.weld_events import WeldEvent
from fsw_analysis.weld_signals import WeldSignals
from fsw_scenario.scenario import Scenario
from fsw_scenario.weld_programme import READING_AGE_TICKS, PhaseMachine, State


def with_programme(signals: WeldSignals, scenario: Scenario) -> WeldSignals:
    """The signals with phases, positions and the end of the weld, as a bag has them; as they are without phases."""
    if not scenario.phases or not signals.n_ticks:
        return signals
    machine = PhaseMachine(scenario.phases)
    shown: deque[float] = deque(maxlen=READING_AGE_TICKS + 1)
    phases: list[tuple[str, float]] = []
    places = np.empty((signals.n_ticks, 2))
    for row, (time_s, shown_c) in enumerate(zip(signals.time_s.tolist(), signals.temperature_c.tolist(), strict=True)):
        now = machine.progress()
        if not phases or phases[-1][0] != now.phase:
            phases.append((now.phase, time_s))
        places[row] = now.angle_deg, now.length_mm
        shown.append(shown_c)
        machine.follow(row + 1, shown[0])
    events = [*signals.events, *(WeldEvent(time_s, "phase", name) for name, time_s in phases)]
    if machine.state is State.DONE:
        events.append(WeldEvent(float(signals.time_s[-1]), "weld", str(machine.state)))
    events.sort(key=lambda event: event.time_s)
    return replace(signals, phases=phases, angle_deg=places[:, 0], travel_mm=places[:, 1], events=events)
