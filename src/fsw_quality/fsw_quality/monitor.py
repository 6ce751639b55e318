"""The watch within a weld: takes what is measured and commanded at each tick, tells what is about to go wrong and why.

It commands nothing. Everything that it compares is measured or commanded; the emulator's truth is not among it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite, nan
from typing import NamedTuple

from fsw_control import weld
from fsw_control.sensors import REQUIRED
from fsw_control.weld import TICK_S
from fsw_model import ModelParameters, nominal
from fsw_quality.diagnosis import Finding, Limits, diagnose, load_limits
from fsw_quality.noise import NoiseWatch
from fsw_quality.residuals import ModelResiduals
from fsw_quality.watches import LEARN_S, DriveWatch, InnovationWatch, LoopWatch, ModelWatch, SensorWatch

PROCESSES = tuple(load_limits())
#: seconds in succession for which a figure is beyond its limit before that counts, and back before it no longer does
_ON_S, _OFF_S, _BACK = 3, 10, 0.8
#: ticks without a usable sample after which everything is learnt anew
_LOST = 50
#: the drives: name, least change of the command that must show, bounds, largest step
_DRIVES = (
    ("force", 0.1, weld.FORCE_MIN_KN, weld.FORCE_MAX_KN, weld.FORCE_STEP_KN),
    ("speed", 0.5, weld.SPEED_MIN_RPM, weld.SPEED_MAX_RPM, weld.SPEED_STEP_RPM),
)
#: samples that can be no measured values: the model has no meaning beyond (depth mm, torque N m, temperature degC)
_RANGES = ((0.3, 6.0), (0.0, 4000.0), (300.0, 1200.0))


class Sample(NamedTuple):
    """A tick as the monitor sees it; NaN where a value did not come."""

    time_s: float
    depth_mm: float
    torque_nm: float
    temperature_c: float
    #: inputs that act, as the drives report them
    force_kn: float
    speed_rpm: float
    #: the command for the step that ended at this tick
    command_force_kn: float
    command_speed_rpm: float
    reference_depth_mm: float
    reference_temperature_c: float
    source: str = ""  #: who commands


@dataclass(slots=True)
class _Count:
    """How long a figure has been beyond its limit, or back."""

    beyond: int = 0
    back: int = 0
    active: bool = False

    def look(self, value: float, limit: float, known: bool) -> None:
        self.beyond = self.beyond + 1 if value > limit else 0
        self.back = self.back + 1 if value < _BACK * limit else 0
        if self.beyond >= _ON_S:
            self.active = True
        elif self.back >= _OFF_S or (known and value == 0.0):  # nothing is left to tell
            self.active = False


class Monitor:
    """The watch of one weld.

    The limits are those of the ``process``, one of ``PROCESSES``, unless others are given; the parameters those of the
    model that the controllers have, the paper's by default.
    """

    def __init__(
        self, process: str = "paper", parameters: ModelParameters | None = None, limits: Limits | None = None
    ) -> None:
        self._limits = limits or load_limits()[process]
        self._parameters = parameters or nominal()
        self.figures: dict[str, float] = {}  #: newest of each
        self.findings: list[Finding] = []
        self.restarts = -1  #: how often it began anew
        self.restart()

    def restart(self) -> None:
        """Forget the weld: another begins, or time has jumped."""
        dead_time_s = self._parameters.dead_time_s
        self._residuals = ModelResiduals(self._parameters)
        self._model = ModelWatch(dead_time_s)
        self._sensors = [SensorWatch(name) for name in REQUIRED]
        self._drives = [DriveWatch(*one) for one in _DRIVES]
        self._loops = [LoopWatch("depth", 0.0), LoopWatch("temperature", dead_time_s)]
        self._innovations = [InnovationWatch(name) for name in ("torque", "depth", "heat")]
        self._noises = {name: NoiseWatch() for name in ("torque", "depth", "heat")}
        self._counts: dict[str, _Count] = {}
        self._tick, self._lost, self._begun_s, self._time_s = 0, 0, nan, nan
        self._points, self._points_s = (nan, nan), nan
        self._source = ""
        self._told: dict[str, dict[str, float]] = {}
        self._shown: dict[str, float] = {}
        self.figures, self.findings = {}, []
        self.restarts += 1

    @property
    def learning(self) -> bool:
        """Whether the weld's own normal values are still being learnt."""
        return not self._time_s - self._begun_s > LEARN_S

    def step(self, now: Sample) -> None:
        """Take a tick; once a second the figures and findings are new."""
        inputs = (now.force_kn, now.speed_rpm, now.command_force_kn, now.command_speed_rpm)
        values = (now.depth_mm, now.torque_nm, now.temperature_c)
        usable = all(low <= value <= high for value, (low, high) in zip(values, _RANGES, strict=True))
        if not (usable and all(map(isfinite, inputs))):
            self._lost += 1
            return
        if self._lost > _LOST or not 0.0 < now.time_s - self._time_s < _LOST * TICK_S:
            if isfinite(self._time_s):
                self.restart()
            self._begun_s = self._points_s = now.time_s
        self._lost, self._time_s = 0, now.time_s
        self._take(now)
        self._tick += 1
        if self._tick % round(1.0 / TICK_S) == 0:
            self._second(now.time_s)

    def _take(self, now: Sample) -> None:
        points = now.reference_depth_mm, now.reference_temperature_c
        if points != self._points:
            self._points, self._points_s = points, now.time_s
        if now.source != self._source:
            self._source, self._points_s = now.source, now.time_s
            for drive in self._drives:
                drive.forget()
            for sensor in self._sensors:
                sensor.forget(now.time_s - self._begun_s)
        for sensor, value in zip(self._sensors, (now.depth_mm, now.torque_nm, now.temperature_c), strict=True):
            sensor.push(value)
        self._drives[0].push(now.command_force_kn, now.force_kn)
        self._drives[1].push(now.command_speed_rpm, now.speed_rpm)
        self._loops[0].push(now.depth_mm - now.reference_depth_mm)
        self._loops[1].push(now.temperature_c - now.reference_temperature_c)
        found = self._residuals.step(now.depth_mm, now.torque_nm, now.temperature_c, now.force_kn, now.speed_rpm)
        self._model.push(found)
        for innovation, value in zip(self._innovations, (found.torque_nm, found.depth_mm, found.heat_c), strict=True):
            innovation.push(value)
        if self.learning:
            for noise, value in zip(
                self._noises.values(), (found.torque_nm, found.depth_mm, found.heat_c), strict=True
            ):
                noise.push(value)

    @property
    def correlations_s(self) -> dict[str, float]:
        """Times over which the noise of a sensor is correlated, as learnt at the begin of the weld; none if white."""
        noises = (self._noises[name].noise for name in ("depth", "torque", "heat"))
        return {name: one.correlation_s for name, one in zip(REQUIRED, noises, strict=True) if one.correlation_s}

    def _learn_noise(self) -> None:
        for one in self._noises.values():
            one.learn()
        noises = {name: one.noise for name, one in self._noises.items()}
        heated_c = self._residuals.heated_c(noises["torque"])
        self._model.noisy(noises, heated_c)
        self._loops[0].noisy(noises["depth"], 0.0)
        self._loops[1].noisy(noises["heat"], heated_c)

    def _second(self, time_s: float) -> None:
        since_s, calm_s = time_s - self._begun_s, time_s - self._points_s
        turn, told = self._tick // round(1.0 / TICK_S), self._told
        if since_s <= LEARN_S and turn % 5 == 0:
            self._learn_noise()
        self._model.second(since_s)
        self._model.estimate()
        told["model"] = self._model.figures()
        for sensor in self._sensors:
            told[f"sensor {sensor.name}"] = sensor.figures(since_s)
        if turn % 2:  # what costs more, in turns
            for drive in self._drives:
                told[f"drive {drive.name}"] = drive.figures(calm_s)
        else:
            for innovation in self._innovations:
                told[f"innovation {innovation.name}"] = innovation.figures(
                    since_s, calm_s, self._noises[innovation.name].noise
                )
        if turn % 5 == 0:
            normal = self._sensors[0].normal, self._sensors[2].normal
            for loop, noise in zip(self._loops, normal, strict=True):
                told[f"loop {loop.name}"] = loop.figures(calm_s, noise)
        self.figures = {name: value for figures in told.values() for name, value in figures.items()}
        for name, limit in self._limits.limits.items():
            if name in self.figures or name in self._counts:
                count = self._counts.setdefault(name, _Count())
                count.look(self.figures.get(name, 0.0), limit, name in self.figures)
        active = {name: count.active for name, count in self._counts.items()}
        self.findings = []
        if any(active.values()):
            self.findings = diagnose(self._kept(active), self._limits, active, self._words())

    def _kept(self, active: Mapping[str, bool]) -> dict[str, float]:
        """The figures; one whose alarm is there and that is not known just now, as an alarm last showed it."""
        self._shown |= self.figures
        return {name: value for name, value in self._shown.items() if name in self.figures or active.get(name)}

    def _words(self) -> Mapping[str, float]:
        levels, gains = self._model.levels, self._model.gains
        words = {
            "torque": levels.get("torque", nan),
            "heat": levels.get("heat", nan),
            "depth": 60.0 * levels.get("depth", nan),
            "ratio": self._model.torque_ratio,
            "dead_time": gains["heat"].dead_time_s,
            "nominal_dead_time": self._parameters.dead_time_s,
            "period_depth": self._loops[0].period_s,
            "period_temperature": self._loops[1].period_s,
        }
        for name, gain in gains.items():
            words |= {f"{name}_gain": gain.gain, f"{name}_error": 2.0 * gain.error}
        return words

    @property
    def gains(self) -> dict[str, tuple[float, float]]:
        """Gains relative to the model's that are excited enough to be known, each with its standard error."""
        found = {name: (one.gain, one.error) for name, one in self._model.gains.items() if one.excited}
        if isfinite(self._model.torque_ratio):
            found["torque"] = self._model.torque_ratio, nan
        return found
