"""The weld so far, judged by the rules that its record is judged by."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isnan, nan
from pathlib import Path
from typing import Any

import numpy as np

from fsw_analysis.course import OVER, UnusableSamples
from fsw_analysis.events import of_programme_states, of_states
from fsw_analysis.headline import gap_mark, page_account
from fsw_analysis.judgement import Account, gap_verdict, judge
from fsw_analysis.rule_book import RuleBook
from fsw_analysis.weld_signals import DriveSignals, WeldEvent, WeldSignals, experiment_time_s
from fsw_control.sensors import OPTIONAL, REQUIRED, SENSORS
from fsw_control.units import NANOSECONDS
from fsw_hmi.frames import COLUMNS, SIGNALS
from fsw_hmi.hub import KEPT
from fsw_hmi.limits import programme_aims
from fsw_hmi.weld_view import Row

_STATE = ("actual_controller", "actual_mode", "reason", "cause", "by")
_UNSEEN = "the begin of the weld was before this page ran"


class LiveWeld:
    """Collects rows and reports of a weld; another programme that begins is another weld."""

    def __init__(self, book: RuleBook) -> None:
        self.book = book
        self._state: tuple[Any, ...] | None = None
        self._progress: Mapping[str, Any] | None = None
        self.forget()

    def forget(self) -> None:
        """Another weld begins."""
        self._stamps_ns: list[int] = []
        #: of ``COLUMNS`` after the time, then what the programme has
        self._rows: list[tuple[float, ...]] = []
        self._texts: list[tuple[str, str, str]] = []  #: source, controller, mode
        self._phases: list[tuple[int, Any]] = []
        self._states: list[tuple[int, Any]] = []
        self._programme: list[tuple[int, Any]] = []
        self._problems: list[str] = []
        self._unusable = UnusableSamples()
        self._first, self._only_end = True, False

    def on_state(self, leader: str, state: Mapping[str, Any]) -> None:
        """Take what the supervisor reports, as the page gets it, and its identity."""
        controller, mode, *rest = (state[name] for name in _STATE)
        interlocks = tuple((lock["name"], lock["level"]) for lock in state["interlocks"])
        self._state = controller, mode, leader, interlocks, *rest

    def on_progress(self, progress: Mapping[str, Any]) -> bool:
        """Take what the programme reports; returns whether another weld begins by it."""
        before, self._progress = self._progress, progress
        begins = before is None or (before["state"] in OVER and progress["state"] not in OVER)
        if not begins:
            return False
        self.forget()
        self._only_end = progress["state"] in OVER
        if progress["angle_deg"]:
            self._problems.append(_UNSEEN)
        return True

    def add(self, row: Row, source: str) -> None:
        """Take a tick, with whose command answered it."""
        stamp_ns, values = row.stamp_ns, dict(zip(COLUMNS[1:], row.values, strict=True))
        first, self._first = self._first, False
        # the page subscribes to the sensors when it hears the first tick, whose samples it may
        # miss
        if first and any(isnan(values[SENSORS[name].signal]) for name in REQUIRED):
            return
        progress: Mapping[str, Any] = self._progress or {}
        aims, length_mm = programme_aims(progress), progress.get("length_mm")
        travel_mm = nan if length_mm is None else float(length_mm)
        own = (aims.get("depth_mm", nan), aims.get("temperature_c", nan), travel_mm)
        self._stamps_ns.append(stamp_ns)
        self._rows.append((*row.values, *own))
        state = self._state or ("", "", "", (), "", -1, "")
        self._texts.append((source, state[0], state[1]))
        was_over = bool(self._programme) and self._programme[-1][1] in OVER
        _note(self._states, stamp_ns, state)
        _note(self._programme, stamp_ns, progress.get("state", ""))
        if phase := progress.get("phase", ""):
            _note(self._phases, stamp_ns, phase)
        begin_ns = self._stamps_ns[0]
        begin_s = float(experiment_time_s(np.array([begin_ns]))[0])
        # the record, too, ends with the tick in which the programme ends
        if not (was_over and progress.get("state") in OVER):
            self._unusable.add(begin_s + (stamp_ns - begin_ns) / NANOSECONDS, values)
        if len(self._rows) > 2 * KEPT:  # a plant that runs for days without a programme
            for kept in (self._stamps_ns, self._rows, self._texts):
                del kept[:KEPT]

    def account(self) -> Account | None:
        """The judgement of the weld so far; None before a tick, or if only its end was seen."""
        if not self._rows or self._only_end:
            return None
        running, unusable = (self._progress or {}).get("state") not in OVER, self._unusable
        signals = self._signals()
        return judge(signals, self.book, running=running, recorded=False, unusable=unusable)

    def frame(self, gaps: Sequence[tuple[float, float]] = ()) -> dict[str, Any] | None:
        """The judgement as the page gets it, with the gaps of the recording marked on the weld."""
        account = self.account()
        if account is None:
            return None
        stamp_ns = np.array(self._stamps_ns[:1])
        offset_s = self._stamps_ns[0] / NANOSECONDS - float(experiment_time_s(stamp_ns)[0])
        shown = page_account(account, offset_s, recorded=False)
        for begin_s, end_s in gaps:
            lasts_s = end_s - begin_s
            place = account.course.place(begin_s - offset_s, lasts_s)
            verdict = gap_verdict(lasts_s, self.book)
            shown["marks"].append(gap_mark(begin_s, lasts_s, place, verdict))
        return shown

    def _signals(self) -> WeldSignals:
        stamp_ns = np.array(self._stamps_ns, np.int64)
        time_s = experiment_time_s(stamp_ns)
        shift_s = self._stamps_ns[0] / NANOSECONDS - float(time_s[0])
        names = (*COLUMNS[1:], "programme_depth_mm", "programme_temperature_c", "travel_mm")
        columns = dict(zip(names, np.array(self._rows).T, strict=True))
        source, controller, mode = np.array(self._texts, object).T
        # no programme reports: the set-points in force
        without = ~np.isfinite(columns["programme_depth_mm"])

        def at(entries: list[tuple[int, Any]]) -> list[tuple[float, Any]]:
            return [(stamp / NANOSECONDS - shift_s, value) for stamp, value in entries]

        phases = [(name, time) for time, name in at(self._phases)]
        events = [WeldEvent(time, "phase", name) for name, time in phases]
        programme, state = self._programme, (self._progress or {}).get("state", "")
        if state in OVER and programme[-1][1] != state:  # no tick has come after the end
            programme = [*programme, (self._stamps_ns[-1], state)]
        events += [*of_programme_states(at(programme)), *of_states(at(self._states))]
        return WeldSignals(
            path=Path(),
            stamp_ns=stamp_ns,
            time_s=time_s,
            **{signal: columns[column] for column, signal in SIGNALS.items()},
            optional={(signal := SENSORS[name].signal): columns[signal] for name in OPTIONAL},
            command_source=source,
            command_reason=source,
            command_latency_s=columns["latency_ms"],
            actual_controller=controller,
            actual_mode=mode,
            drives=DriveSignals(columns["force_kn"], columns["speed_rpm"]),
            problems=[*self._problems],
            phases=phases,
            events=sorted(events, key=lambda event: event.time_s),
            programme_depth_mm=np.where(
                without, columns["reference_depth_mm"], columns["programme_depth_mm"]
            ),
            programme_temperature_c=np.where(
                without, columns["reference_temperature_c"], columns["programme_temperature_c"]
            ),
            travel_mm=columns["travel_mm"],
        )


def _note(entries: list[tuple[int, Any]], stamp_ns: int, value: object) -> None:
    """Add a value that is another than the last."""
    if not entries or entries[-1][1] != value:
        entries.append((stamp_ns, value))
