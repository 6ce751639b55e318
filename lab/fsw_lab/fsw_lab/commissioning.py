"""The steps of commissioning, their state and what they are judged by; no ROS, no clock."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

import numpy as np

from fsw.console import write_text
from fsw_analysis.report import table
from fsw_control import weld
from fsw_control.cause import Severity
from fsw_control.contract import Limits
from fsw_control.parameters import describe
from fsw_control.schema.models import InputError, Many, Model
from fsw_model import ModelParameters
from fsw_plant.parameters import PlantParameters
from fsw_scenario.scenario import Scenario
from fsw_tuning.identification_design import AIMS, SAFE_C, SAFE_MM, plant_factors
from fsw_tuning.margins import GAIN_ACCURACY, texts


class Step(NamedTuple):
    """What a step does, and whether it moves the drives beyond what the controllers do."""

    text: str
    moves: bool = False


#: In their order; each needs all before it.
STEPS = {
    "check": Step("listen to sensors, drives and supervisor"),
    "experiment": Step("step the set-points for identification, and record", moves=True),
    "identify": Step("estimate the model from the experiment"),
    "tune": Step("search for tunings of the model, under bounds of robustness"),
    "apply": Step("give the tuning to the running controller, without a bump", moves=True),
    "accept": Step(
        "step the set-points once more, and compare with what the model predicts", moves=True
    ),
}
Verdict = Literal["open", "done", "failed", "refused"]


class Row(Model):
    """A quantity, its value, what is permitted, and whether it is."""

    what: str
    value: str
    limit: str
    good: bool


class Outcome(Model):
    """How a step went."""

    verdict: Verdict = "open"
    at: str = ""
    """date and time"""
    note: str = ""
    rows: Many[Row] = ()


class Course(Model):
    """What was done so far: the file by which commissioning is left and taken up again."""

    outcomes: dict[str, Outcome] = {}

    def of(self, step: str) -> Outcome:
        """The outcome of a step."""
        return self.outcomes.get(step, Outcome())

    @property
    def next(self) -> str | None:
        """The first step that is not done; None when all are."""
        return next((step for step in STEPS if self.of(step).verdict != "done"), None)

    def after(self, step: str, outcome: Outcome) -> Course:
        """The course when a step has ended like this; what follows it is open again."""
        before = list(STEPS)[: list(STEPS).index(step)]
        return Course(outcomes={name: self.of(name) for name in before} | {step: outcome})


def outcome_of(rows: Sequence[Row], at: str, note: str = "") -> Outcome:
    """Done when all rows are good."""
    return Outcome(
        verdict="done" if all(row.good for row in rows) else "failed",
        at=at,
        note=note,
        rows=tuple(rows),
    )


@dataclass(slots=True)
class Session:
    """Leads through the steps.

    ``ask`` gets a question and returns the answer; ``carry_out`` has a function for each step,
    which returns its outcome or raises an error of a command; ``save`` gets every new course.
    """

    course: Course
    carry_out: Mapping[str, Callable[[], Outcome]]
    ask: Callable[[str], str]
    say: Callable[[str], object]
    save: Callable[[Course], object]
    errors: tuple[type[Exception], ...] = ()
    #: description of what a step is about to move
    warning: Callable[[str], str] = field(default=lambda _: "")

    def run(self, once: bool = False) -> bool:
        """Ask and carry out until all is done, or the operator leaves.

        Returns whether all is done.

        ``once``: leave after the first step that is not done.
        """
        while (step := self.course.next) is not None:
            answer = self._answer(step)
            if answer == "quit":
                break
            if answer == "no":
                self._end(step, Outcome(verdict="refused"))
                break
            if answer in STEPS:
                self._end(answer, Outcome())
                continue
            try:
                outcome = self.carry_out[step]()
            except self.errors as error:
                outcome = Outcome(verdict="failed", note=" ".join(str(error).split()))
            self._end(step, outcome)
            if outcome.verdict != "done" and once:
                break
        return self.course.next is None

    def _answer(self, step: str) -> str:
        self.say(f"\n{list(STEPS).index(step) + 1}. {step}: {STEPS[step].text}")
        if STEPS[step].moves:
            self.say(self.warning(step))
        earlier = [name for name in STEPS if self.course.of(name).verdict == "done"]
        choices = ["yes", "no", "quit", *earlier]
        while True:
            given = self.ask(f"   {', '.join(choices)}? ").strip().lower()
            matching = [choice for choice in choices if given and choice.startswith(given)]
            if len(matching) == 1 or given in matching:
                return given if given in matching else matching[0]

    def _end(self, step: str, outcome: Outcome) -> None:
        self.course = self.course.after(step, outcome)
        self.save(self.course)
        for row in outcome.rows:
            self.say(f"   {'  ' if row.good else '! '}{row.what}: {row.value} ({row.limit})")
        if outcome.verdict != "open":
            self.say(f"   {step}: {outcome.verdict}{f', {outcome.note}' if outcome.note else ''}")


# ---------------------------------------------------------------- check


@dataclass(slots=True)
class Heard:
    """What was heard of the running graph, by topic; times of the stamps in s."""

    time_s: Sequence[float]
    depth_mm: Sequence[float]
    torque_nm: Sequence[float]
    temperature_c: Sequence[float]
    #: differences between what the drives report and what is commanded
    force_kn: Sequence[float]
    speed_rpm: Sequence[float]
    #: set-points in force, depth and temperature; None: none
    reference: tuple[float, float] | None
    mode: str
    controller: str
    ready: Sequence[str]
    interlocks: Mapping[str, Severity]  #: that warn or are tripped
    #: of the ticks in which no controller commanded: why
    held: Sequence[str]


#: noise that a sensor may have, about ten times the emulator's (chosen): depth, torque,
#: temperature
_NOISE = {"depth_mm": (0.02, "mm"), "torque_nm": (20.0, "N m"), "temperature_c": (1.0, "degC")}
#: how far an output may be from its set-point before the experiment
_REST_MM, _REST_C = 0.02, 2.0
#: share of the samples that may be missing
_LOST = 0.1
#: share of the ticks that the controller must command (chosen)
_COMMANDED = 0.99


def check_rows(heard: Heard, needed: Sequence[str]) -> list[Row]:
    """Sensors, drives and supervisor; ``needed``: controllers that must be ready."""
    limits, gaps = Limits(), np.diff(heard.time_s)
    period_s = float(np.median(gaps)) if gaps.size else np.nan
    lost = max(0.0, 1.0 - weld.TICK_S / float(gaps.mean())) if gaps.size else 1.0
    missing = [name for name in needed if name not in heard.ready]
    trouble = ", ".join(f"{name} {level.word}" for name, level in heard.interlocks.items())
    ready, good_tick = (
        f"ready: {', '.join(needed)}",
        abs(period_s - weld.TICK_S) < 0.05 * weld.TICK_S,
    )
    rows = [
        _row("mode", f"{heard.mode}, {heard.controller}", "auto", heard.mode == "auto"),
        _row("controllers", ", ".join(heard.ready) or "none", ready, not missing),
        _row("interlocks", trouble or "none", "none", not heard.interlocks),
        _row("tick", f"{period_s:.3f} s", f"{weld.TICK_S:g} s", good_tick),
        _row(
            "samples lost", f"{100.0 * lost:.1f} %", f"at most {100.0 * _LOST:g} %", lost <= _LOST
        ),
        _commanded("a controller", len(heard.time_s), heard.held),
    ]
    for name, (most, unit) in _NOISE.items():
        noise = _noise(getattr(heard, name))
        what, limit = f"noise, {name.split('_')[0]}", f"above 0, at most {most:g}"
        rows.append(_row(what, f"{noise:.3g} {unit}", limit, 0.0 < noise <= most))
    wanted = (weld.DEPTH_MM, weld.TEMPERATURE_C)
    there = "none" if heard.reference is None else "{:g} mm, {:g} degC".format(*heard.reference)
    at_rest = heard.reference is not None and np.allclose(heard.reference, wanted, atol=1e-6)
    rows.append(_row("set-points", there, "{:g} mm, {:g} degC".format(*wanted), at_rest))
    for name, middle, most, unit in (
        ("depth", wanted[0], _REST_MM, "mm"),
        ("temperature", wanted[1], _REST_C, "degC"),
    ):
        off = _mean(getattr(heard, f"{name}_{unit.lower().replace('deg', '')}")) - middle
        rows.append(
            _row(f"{name}, off", f"{off:+.3g} {unit}", f"at most {most:g}", abs(off) <= most)
        )
    for name, most, unit in (
        ("force", limits.force_step_kn, "kN"),
        ("speed", limits.speed_step_rpm, "rpm"),
    ):
        off = _mean(getattr(heard, f"{name}_{unit.lower()}"))
        what = f"{name}, off its command"
        rows.append(_row(what, f"{off:+.3g} {unit}", f"at most {most:g}", abs(off) <= most))
    return rows


def _commanded(by: str, ticks: int, held: Sequence[str]) -> Row:
    """How many of the ticks were commanded; ``held``: of the others, why."""
    share = 1.0 - min(len(held) / ticks, 1.0) if ticks else 0.0
    why = f", {Counter(held).most_common(1)[0][0]}" if held else ""
    commanded = f"{100.0 * share:.1f} %{why}"
    return _row(
        f"commanded by {by}", commanded, f"at least {100.0 * _COMMANDED:g} %", share >= _COMMANDED
    )


def _row(what: str, value: str, limit: str, good: Any) -> Row:
    return Row(what=what, value=value, limit=limit, good=bool(good))


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values)) if len(values) else np.nan


def _noise(values: Sequence[float]) -> float:
    """Standard deviation of white noise, by the differences, so that slow changes do not count."""
    return float(np.std(np.diff(values)) / np.sqrt(2.0)) if len(values) > 2 else np.nan


# ---------------------------------------------------------------- experiment


def check_experiment(scenario: Scenario) -> None:
    """InputError unless a scenario only steps set-points, near the operating point."""
    if scenario.open_loop or scenario.phases:
        raise InputError(
            f"{scenario.name}: commissioning takes steps of set-points, no commands and no phases"
        )
    for event in scenario.events:
        wanted = event.reference
        if wanted is None or wanted.sine is not None:
            raise InputError(
                f"{scenario.name}: the event at {event.at_s:g} s is no step of a set-point"
            )
        depth_mm, temperature_c = (
            wanted.depth_mm or weld.DEPTH_MM,
            wanted.temperature_c or weld.TEMPERATURE_C,
        )
        if (
            abs(depth_mm - weld.DEPTH_MM) > SAFE_MM
            or abs(temperature_c - weld.TEMPERATURE_C) > SAFE_C
        ):
            raise InputError(
                f"{scenario.name}: at {event.at_s:g} s {depth_mm:g} mm, {temperature_c:g} degC is "
                f"further than {SAFE_MM:g} mm, {SAFE_C:g} degC from the operating point"
            )


@dataclass(slots=True)
class Guard:
    """Ends an experiment that leaves its bounds.

    By three samples in succession, so that one spike does not.
    """

    depth_mm: float = SAFE_MM
    temperature_c: float = SAFE_C
    _outside: dict[str, int] = field(default_factory=dict)

    def take(self, sensor: str, value: float) -> str:
        """Why to end, with a sample of a sensor, by the stem of its names; empty: go on."""
        bounds = {
            "depth": (weld.DEPTH_MM, self.depth_mm, "mm"),
            "temperature": (weld.TEMPERATURE_C, self.temperature_c, "degC"),
        }
        if sensor not in bounds:
            return ""
        middle, most, unit = bounds[sensor]
        outside = not abs(value - middle) <= most  # NaN, too
        self._outside[sensor] = self._outside.get(sensor, 0) + 1 if outside else 0
        if self._outside[sensor] < 3:
            return ""
        return (
            f"{sensor} {value:.4g} {unit} is further than {most:g} {unit} from {middle:g} {unit}"
        )


# ---------------------------------------------------------------- identify, tune, accept

#: A parameter must be known to so many times what a designed experiment aims for (chosen).
_KNOWN = 5.0


def identify_rows(parameters: ModelParameters, deviations: Mapping[str, float]) -> list[Row]:
    """Standard deviations of what tuning depends on; parameters that the emulator refuses."""
    rows = []
    for name in (
        "thermal_gain_c_per_kw",
        "copper_lag_s",
        "dead_time_s",
        "depth_gain_mm_per_kn_s",
        "softening_per_c",
    ):
        value, most = getattr(parameters, name), _KNOWN * AIMS[name]
        share = deviations.get(name, np.inf) / abs(value)
        text = f"{value:.4g} ± {100.0 * share:.2g} %"
        rows.append(_row(name, text, f"known to {100.0 * most:.2g} %", share <= most))
    for key, factor in plant_factors(parameters).items():
        low, high = describe(PlantParameters)[key].range or (-np.inf, np.inf)
        if (
            not low <= factor <= high
        ):  # tuning could not try such a process, and no machine is known to be one
            limit = f"{low:g} to {high:g}; repeat the experiment, with longer steps"
            rows.append(
                _row(key.removeprefix("factors."), f"{factor:.2g} of nominal", limit, False)
            )
    return rows


def tune_rows(
    robust: Mapping[str, Mapping[str, float]], bounds: Mapping[str, Mapping[str, float]]
) -> list[Row]:
    """Margins and noise of each tuning against the bounds of the search."""
    return [
        _row(f"{name}: {key}", f"{figures[key]:.3g}", f"at most {bound:g}", figures[key] <= bound)
        for name, figures in robust.items()
        for key, bound in bounds[name].items()
    ]


def margin_rows(
    measured: Mapping[str, float], least: Mapping[str, float], model: ModelParameters
) -> list[Row]:
    """Margins of the NMPC's loops against those of the tight PI."""
    words, limits = texts(measured, model), texts(least, model)
    return [
        _row(
            f"nmpc: margin, {key.removesuffix('_s').replace('_', ', ')}",
            words[key],
            f"at least {limits[key]}, that of decentral:tight",
            measured[key] * GAIN_ACCURACY >= least[key],
        )
        for key in measured
    ]


#: figures of the acceptance test: meaning, unit, factor on what the model predicts, what is
#: permitted beyond (chosen)
_ACCEPTED = {
    "iae_depth_mm_s": ("IAE depth", "mm s", 1.3, 0.05),
    "iae_temperature_c_s": ("IAE temperature", "degC s", 1.3, 5.0),
    "overshoot_depth_mm": ("overshoot depth", "mm", 1.0, 0.02),
    "overshoot_temperature_c": ("overshoot temperature", "degC", 1.0, 1.0),
    "peak_temperature_in_depth_step_up_c": ("peak temperature, depth up", "degC", 1.3, 0.5),
    "peak_temperature_in_depth_step_down_c": ("peak temperature, depth down", "degC", 1.3, 0.5),
    "peak_depth_in_temperature_step_mm": ("peak depth, temperature step", "mm", 1.3, 0.02),
}


def accept_rows(
    measured: Mapping[str, Any],
    predicted: Mapping[str, Any],
    commands: Sequence[tuple[str, str]],
    controller: str,
) -> list[Row]:
    """Measured figures against those of the weld that the model predicts; and who commanded.

    ``commands``: source and reason of the command of each tick.
    """
    others = [reason or source for source, reason in commands if source != controller]
    rows = [_commanded(controller, len(commands), others)]
    for key, (title, unit, factor, more) in _ACCEPTED.items():
        value, usual = measured.get(key), predicted.get(key)
        if usual is None:
            continue
        most = factor * usual + more
        text = "unknown" if value is None else f"{value:.3g} {unit}"
        limit = f"at most {most:.3g}, predicted {usual:.3g}"
        rows.append(_row(title, text, limit, value is not None and value <= most))
    return rows


def write_report(course: Course, path: Any, origin: str) -> None:
    """The report in Markdown: every step with its verdict and rows."""
    lines = [f"# Commissioning\n\n{origin}\n"]
    for number, (name, step) in enumerate(STEPS.items(), start=1):
        outcome = course.of(name)
        lines.append(
            f"\n## {number}. {name}: {outcome.verdict}\n\n"
            f"{step.text[0].upper()}{step.text[1:]}. {outcome.at}\n"
        )
        if outcome.note:
            lines.append(f"\n{outcome.note}\n")
        if outcome.rows:
            rows = [
                (row.what, row.value, row.limit, "" if row.good else "not met")
                for row in outcome.rows
            ]
            lines.append(f"\n{table([('', 'found', 'limit', ''), *rows], words=None)}\n")
    write_text(path, "".join(lines))
