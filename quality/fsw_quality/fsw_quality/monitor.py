"""The watch within a weld.

Sensors and drives first, then the process, by the likelihood of its residuals.

It commands nothing. Everything that it compares is measured or commanded; the emulator's truth is
not among it.
"""

from __future__ import annotations

from math import isfinite, nan
from typing import NamedTuple

import numpy as np

from fsw_analysis.weld_signals import FloatArray
from fsw_control import weld
from fsw_control.sensors import REQUIRED
from fsw_control.weld import TICK_S
from fsw_model import ModelParameters, nominal
from fsw_quality.diagnosis import Estimate, Finding, NotJudged, WatchCause
from fsw_quality.likelihood import (
    DEPTH_NOISE,
    OFFSET,
    WARMTH,
    Healthy,
    Second,
    Traces,
    default_covariance,
)
from fsw_quality.residuals import DEPTH, HEAT, TORQUE, Gains, ModelResiduals, Values
from fsw_quality.sensor_health import LEARN_S, Detached, DriveWatch, SensorHealth
from fsw_quality.signatures import OF_HEAT, SIZES, Onset, signatures

PROCESSES = "paper", "canister"
_SECOND = round(1.0 / TICK_S)
#: gap after which another weld begins [s]
_GAP_S = 5.0
#: the drives: name, least change of the command that must show, bounds, largest step
_DRIVES = (
    ("force", 0.1, weld.FORCE_MIN_KN, weld.FORCE_MAX_KN, weld.FORCE_STEP_KN),
    ("speed", 0.5, weld.SPEED_MIN_RPM, weld.SPEED_MAX_RPM, weld.SPEED_STEP_RPM),
)
#: what can be no measured value: the model has no meaning beyond (depth mm, torque N m,
#: temperature degC)
_RANGES = ((0.3, 6.0), (0.0, 4000.0), (300.0, 1200.0))
#: sensors that each residual needs
_NEEDS = {TORQUE: (0, 1), DEPTH: (0, 2), HEAT: (1, 2)}
#: onsets that are compared, and the time between two [s] (chosen)
_ONSETS, _EVERY_S = 30, 10
#: Log likelihood ratios are smoothed exponentially over this time [s] (chosen), as on an EWMA
#: chart (Roberts, Technometrics 1, 1959, 239-250): a fault stands, an excursion of a healthy weld
#: does not, and what is far beyond the level is an alarm within seconds
SMOOTHED_S = 20.0
#: level of an alarm: the largest smoothed ratio of any cause exceeds it in one healthy weld of 45
#: minutes in a hundred, causes and times together (``benchmarks/monitor.py --calibrate``)
ALARM = 9.0
#: the estimates are of faults that have been there for at least so long [s]; sizes that they
#: expect, in the largest that does no harm (standard deviation; chosen)
LASTS_S, _EXPECTED = 60.0, 10.0
#: largest ratio that counts in a second: what lasts for a second or two is no alarm (chosen)
_COUNTS = 40.0
#: by which the likeliest cause leads those that are named beside it (chosen: 20 to 1)
_BESIDE = 3.0
#: model and signatures are inexact by this share: of what moves within a second, of the largest
#: size that does no harm, and of a likelihood ratio, so that causes that are nearer cannot be
#: distinguished, either (chosen)
_INEXACT = 0.1
#: share of what the force presses in by which it is inexact; time by which the model's temperature
#: is early or late, and lag of a probe, by which its slope shows in the depth: for a while, and
#: for good [s] (chosen)
_PRESSES, _LATE_S, _PROBE_S, _STAYS_S = 0.03, 0.3, 2.0, 1.0


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


class ProcessWatch:
    """Likelihood of the faults of sensors and process that the model shows."""

    def __init__(
        self, parameters: ModelParameters, covariance: FloatArray, known_heat: bool
    ) -> None:
        self._p = parameters
        self._known_heat = known_heat
        self._faults = list(SIZES)
        self._judged = np.array([known_heat or fault not in OF_HEAT for fault in self._faults])
        self._harmless, self._largest = np.array([SIZES[fault] for fault in self._faults]).T
        self.residuals = ModelResiduals(parameters, known_heat)
        self.healthy = Healthy(parameters, covariance, known_heat)
        self._begin_again()
        self._ticks: list[FloatArray] = []
        self._withheld = [False] * 3
        self._moved_c, self._seconds = 0.0, 0
        self._last = np.zeros(0)
        self._before: tuple[Gains, FloatArray] | None = None

    def _begin_again(self) -> None:
        """Forget the faults: what was measured so far is no evidence of any."""
        self._traces = Traces(self.healthy.n_states, _ONSETS, len(self._faults))
        self._onsets: list[Onset] = []
        self._pinned = -1
        self._ratios = np.zeros(len(self._faults))  # smoothed, by fault

    def tick(self, values: Values, usable: list[bool]) -> None:
        """Take the values of a tick; those that are not usable have been replaced."""
        residuals = self.residuals.step(values)
        self._last = residuals.copy()
        for i, sensors in _NEEDS.items():
            if not all(usable[sensor] for sensor in sensors):
                residuals[i] = nan
        self._ticks.append(residuals)

    def second(self, time_s: float, noises: FloatArray, learning: bool) -> None:
        """A second is over; ``noises`` are those of the sensors (standard deviations)."""
        of_ticks, self._ticks = np.array(self._ticks), []
        present = np.isfinite(of_ticks[:, :, 0]).sum(axis=0)
        means = np.array(
            [
                of_ticks[np.isfinite(of_ticks[:, i, 0]), i].mean(axis=0)
                if present[i]
                else of_ticks[0, i]
                for i in range(3)
            ]
        )
        # of the tick before this second: within it, a controller answers the noise that is in the
        # means
        gains, sensitivities = self._before or (
            self.residuals.gains(),
            self.residuals.sensitivities(means),
        )
        self._before = self.residuals.gains(), self.residuals.sensitivities(self._last)
        spread = np.array(
            [
                [noises[1], gains.nm_per_mm * noises[0]],
                [noises[0], gains.mm_per_c * noises[2]],
                [noises[2], 0.0],
            ]
        )
        variances = (spread**2).sum(axis=1) / np.maximum(present, 1)
        second = Second(means[:, 0], sensitivities, variances, gains.nm_per_mm, self._moves(gains))
        for i in range(3):
            if self._withheld[i] and present[i]:
                self.healthy.doubt(i)
                self._begin_again()
            self._withheld[i] = not present[i]
        if learning:
            self.healthy.step(second)
            return
        if self.healthy.learnt is None:
            self.healthy.learn()
        if self._seconds % _EVERY_S == 0 or not self._onsets:
            self._begin(Onset(time_s - 1.0, gains))
        self._seconds += 1
        onsets = [*self._onsets, *self._onsets[:1] * (_ONSETS - len(self._onsets))]
        self._traces.signatures = signatures(
            self._p, self._faults, onsets, time_s, gains, second.sensitivities
        )
        self._traces.signatures[:, len(self._onsets) :] = 0.0
        self.residuals.edges_mm += self.healthy.step(second, self._traces)

    def _moves(self, before: Gains) -> dict[int, float]:
        """Variance that the states gain in a second, because the model moves inexactly or late."""
        now = self.residuals.gains()
        pressed_mm = now.creep_mm + now.slow_mm - before.creep_mm - before.slow_mm
        moved_c, moved_before_c = now.heated_c - before.heated_c, self._moved_c
        self._moved_c = moved_c
        late_c = _LATE_S * (moved_c - moved_before_c)
        inexact = (_INEXACT * moved_c) ** 2 + late_c**2
        return {
            WARMTH: inexact,
            # what a lag of the probe makes of it in the depth: for good, as far as the filter has
            # put it down to the press or to an edge, and for a while
            OFFSET: (_PRESSES * pressed_mm) ** 2 + (_STAYS_S * before.mm_per_c) ** 2 * inexact,
            DEPTH_NOISE: (_PROBE_S * before.mm_per_c * late_c) ** 2,
        }

    def _begin(self, onset: Onset) -> None:
        """Add an onset.

        It replaces the one with the nearest neighbours for its age, no alarm's.
        """
        if len(self._onsets) < _ONSETS:
            self._onsets.append(onset)
            return
        order = np.argsort([onset.time_s for onset in self._onsets])
        times = np.array([self._onsets[i].time_s for i in order])
        apart = (times[2:] - times[:-2]) / (onset.time_s - times[1:-1])
        apart[order[1:-1] == self._pinned] = np.inf
        place = int(order[1 + int(np.argmin(apart))])
        self._onsets[place] = onset
        self._traces.begin(place)

    def gains(self) -> dict[str, tuple[float, float]]:
        """Gains relative to the model's, each with its standard error.

        That of the heat only where it is known.
        """
        gains = self.healthy.gains(self.residuals.gains().process_nm)
        return {name: gain for name, gain in gains.items() if name != "heat" or self._known_heat}

    def information(self, cause: WatchCause, onset_s: float) -> float:
        """Inverse variance of a fault's size, measured since the onset nearest to a time."""
        nearest = int(np.argmin([abs(onset.time_s - onset_s) for onset in self._onsets]))
        return float(self._traces.power[nearest, self._faults.index(cause)])

    @property
    def ratio(self) -> float:
        """Smoothed log likelihood ratio of the likeliest harmful fault.

        What an alarm is decided by.
        """
        return float(self._ratios.max())

    def estimates(self, time_s: float) -> list[Estimate]:
        """Size of each fault, if it alone has been there for a minute or longer.

        Shorter at the begin.
        """
        if not self._onsets:
            return [Estimate(fault, reason=NotJudged.LEARNING) for fault in self._faults]
        ages_s = time_s - np.array([onset.time_s for onset in self._onsets])
        lasts_s = min(LASTS_S, ages_s.max())
        possible = np.flatnonzero(ages_s >= lasts_s)
        sizes, errors = self._traces.averages(_EXPECTED * self._harmless, possible)
        # a ratio goes with the square of the size
        errors = np.sqrt(errors**2 + _INEXACT**2 * (self._harmless**2 + 0.25 * sizes**2))
        power = self._traces.power[possible[np.argmin(ages_s[possible])]]
        # whose ratio to the largest that does no harm is expected to be that of an alarm
        alarms = self._harmless + np.sqrt(2.0 * ALARM / np.maximum(power, 1e-12))
        alarms[alarms > self._largest] = np.inf
        return [
            Estimate(cause, float(size), float(error), float(alarm))
            if judged
            else Estimate(cause, reason=NotJudged.HEAT_UNKNOWN)
            for cause, judged, size, error, alarm in zip(
                self._faults, self._judged, sizes, errors, alarms, strict=True
            )
        ]

    def findings(self, sick: bool) -> list[Finding]:
        """The likeliest fault, if it is an alarm; none while a sensor is sick."""
        sizes, errors = self._traces.sizes()
        sizes = np.clip(sizes, -self._largest, self._largest)
        ratios = self._traces.ratios(sizes)
        onsets = ratios.argmax(axis=0)
        likeliest = onsets, np.arange(len(self._faults))
        best = ratios[likeliest]
        best[~self._judged] = 0.0
        small = self._traces.ratios(np.clip(sizes, -self._harmless, self._harmless))
        beyond = np.clip((ratios - small)[likeliest], 0.0, np.maximum(best, 0.0))
        beyond *= (not sick) * _COUNTS / max(float(beyond.max()), _COUNTS)
        self._ratios += (beyond - self._ratios) / SMOOTHED_S
        # an alarm that is there stays for longer
        alarm = not sick and self.ratio >= (0.5 if self._pinned >= 0 else 1.0) * ALARM
        cause = int(np.argmax(self._ratios))
        onset = int(onsets[cause])
        self._pinned = onset if alarm else -1
        if not alarm:
            return []
        near = best[cause] - max(_BESIDE, _INEXACT * best[cause])
        beside = tuple(
            self._faults[i] for i in np.argsort(-best) if i != cause and best[i] > max(near, 0.0)
        )
        return [
            Finding(
                self._faults[cause],
                True,
                float(sizes[onset, cause]),
                float(errors[onset, cause]),
                float(self._ratios[cause]),
                beside,
            )
        ]


class Monitor:
    """The watch of one weld.

    ``process`` is one of ``PROCESSES``: on a canister the heat is unknown. The parameters are
    those of the model that the controllers have, the paper's by default; the covariance is that of
    :func:`likelihood.default_covariance` unless the model of this machine was identified with one.
    """

    def __init__(
        self,
        process: str = "paper",
        parameters: ModelParameters | None = None,
        covariance: FloatArray | None = None,
    ) -> None:
        self._known_heat = process == "paper"
        self._parameters = parameters or nominal()
        self._covariance = default_covariance() if covariance is None else covariance
        self.restarts = -1  #: how often another weld has begun
        self.restart()

    def restart(self) -> None:
        """Forget the weld: another begins, or time has jumped."""
        self.process = ProcessWatch(self._parameters, self._covariance, self._known_heat)
        self._sensors = [SensorHealth(name) for name in REQUIRED]
        self._detached = Detached()
        self._drives = [DriveWatch(*drive) for drive in _DRIVES]
        self._good, self._shown_c = [nan] * 3, nan
        self._tick, self._begun_s, self._time_s = 0, nan, nan
        self.seconds = 0  #: seconds that were judged
        self.findings: list[Finding] = []
        self.estimates = self.process.estimates(nan)
        self.restarts += 1

    @property
    def learning(self) -> bool:
        """Whether the disturbances of this weld are still being learnt."""
        return not self._time_s - self._begun_s > LEARN_S

    def step(self, now: Sample) -> None:
        """Take a tick; once a second the findings are new."""
        if not isfinite(now.force_kn + now.speed_rpm + now.time_s) or now.time_s == self._time_s:
            return
        if not 0.0 < now.time_s - self._time_s < _GAP_S:
            if isfinite(self._time_s):
                self.restart()
            self._begun_s = now.time_s
        values = now.depth_mm, now.torque_nm, now.temperature_c
        inside = [low <= value <= high for value, (low, high) in zip(values, _RANGES, strict=True)]
        if not all(inside) and not all(map(isfinite, self._good)):
            self._begun_s = nan  # the weld has not begun
            return
        if not isfinite(self._begun_s):
            self._begun_s = now.time_s
        self._time_s = now.time_s
        self._take(now, values, inside)
        self._tick += 1
        if self._tick % _SECOND == 0:
            self._second()

    def _take(self, now: Sample, values: tuple[float, float, float], inside: list[bool]) -> None:
        carried = (
            values[0],
            values[1] - self.process.residuals.expected_nm(now.speed_rpm),
            values[2],
        )
        usable = [
            sensor.push(now.time_s, value if good else nan, carrier)
            for sensor, value, carrier, good in zip(
                self._sensors, values, carried, inside, strict=True
            )
        ]
        usable[2] = usable[2] and not self._detached.present
        if isfinite(values[2]):
            self._shown_c = values[2]
        for i in range(3):
            if usable[i] or not isfinite(self._good[i]):
                self._good[i] = values[i]
        torque = values[1] if usable[1] else nan
        self.process.tick(
            Values(self._good[0], torque, self._good[2], now.force_kn, now.speed_rpm), usable
        )
        if isfinite(now.command_force_kn + now.command_speed_rpm):
            self._drives[0].push(now.command_force_kn, now.force_kn)
            self._drives[1].push(now.command_speed_rpm, now.speed_rpm)

    def _second(self) -> None:
        findings = [finding for sensor in self._sensors for finding in sensor.second()]
        findings += self._detached.second(self._shown_c, self.process.residuals.gains().heated_c)
        for drive in self._drives:
            findings += drive.second()
        noises = np.array([sensor.noise for sensor in self._sensors])
        self.process.second(self._time_s, noises, self.learning)
        sick = any(finding.of_sensor for finding in findings)
        self.findings = findings + ([] if self.learning else self.process.findings(sick))
        self.estimates = self.process.estimates(self._time_s)
        self.seconds += 1

    @property
    def gains(self) -> dict[str, tuple[float, float]]:
        """Gains of this weld relative to the model's, each with its standard error.

        That of the heat where known.
        """
        return self.process.gains()

    @property
    def disturbances(self) -> tuple[float, float, float]:
        """Torque [N m], force [kN], temperature [degC] that the model does not explain."""
        return self.process.healthy.disturbances
