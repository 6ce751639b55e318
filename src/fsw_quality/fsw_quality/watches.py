"""What is watched within a weld, one class for each kind of thing; each gives figures that grow with the fault."""

from __future__ import annotations

from collections.abc import Mapping
from math import exp, inf, isfinite, nan, sqrt

import numpy as np

from fsw_control.weld import TICK_S
from fsw_quality.monitor_statistics import (
    Window,
    best_delay,
    gain_beside_slope,
    harris_index,
    ljung_box,
    noise_sigma,
    oscillation,
    robust_slope,
)
from fsw_quality.noise import WHITE, Noise
from fsw_quality.residuals import DEPTH_NOISE_MM, JUMP, Gain, GainEstimate, Residuals

#: all chosen: length of the windows, and of the time from which a weld's own normal values are learnt
LEARN_S = 90.0
_SECOND = round(1.0 / TICK_S)
#: length of the windows [s]: of the torque's level, so long that a swing of a minute is none; of other levels; of the
#: depth's slope, and the span of its differences, below a third of it, so that a step is none
_TORQUE_S, _LEVEL_S, _SLOPE_S, _SPAN_S = 60, 20, 75, 24
#: noise of the depth's median over a second [mm], and how well the gain of the depth is known, before the weld and
#: within it (chosen)
_DEPTH_MM, _GAIN_BEFORE, _GAIN_WITHIN = 0.001, 0.1, 0.05
#: a dead time that differs by less is the nominal one
_DEAD_TIME_S = 0.4
#: a swing is worth an alarm from so many standard deviations of the sensor's noise on
_VISIBLE = 3.0
#: after a step of the set-point a loop has settled (chosen)
_SETTLED_S = 60.0
#: correlation of what a noise of the torque seems to heat, behind a lag of 30 s and a washout of 40 s [s]
_HEATED_S = 17.0
#: noise within this ratio of what was learnt is usual (chosen, below the limits)
_USUAL = 1.6


class SensorWatch:
    """Noise and standstill of a sensor's samples."""

    def __init__(self, name: str) -> None:
        self.name, self._window = name, Window(20 * _SECOND)
        self._learnt: list[float] = []
        self._learn_s, self._ratio = LEARN_S, 1.0
        #: noise that was learnt at the begin of the weld, or under this controller; 0 before
        self.normal = 0.0
        self._last, self._same = nan, 0

    def push(self, value: float) -> None:
        """Take a sample."""
        self._same = self._same + 1 if value == self._last else 0
        self._last = value
        self._window.append(value)

    def forget(self, time_s: float) -> None:
        """Another controller commands, whose moves make other samples: learn anew, but for noise that is not usual."""
        if 1.0 / _USUAL < self._ratio < _USUAL:
            self._learnt.clear()
            self._window.clear()
            self._learn_s = time_s + LEARN_S

    def figures(self, time_s: float) -> dict[str, float]:
        """Figures at a second."""
        if not self._window.full:
            return {}
        sigma = noise_sigma(self._window.values())
        if time_s <= self._learn_s:
            self._learnt.append(sigma)
            self.normal = float(np.median(self._learnt))
        if self.normal <= 0.0:  # it has none, as an emulated sensor may: standstill says nothing either
            return {}
        if self._same > _SECOND:  # the other figure tells
            return {f"stuck_{self.name}": TICK_S * self._same}
        self._ratio = max(sigma, 1e-9) / self.normal
        return {
            f"stuck_{self.name}": TICK_S * self._same,
            f"noise_grown_{self.name}": self._ratio,
            f"noise_gone_{self.name}": 1.0 / self._ratio,
        }


class DriveWatch:
    """A drive: what it does of what it is told, and how much it is told to move."""

    def __init__(self, name: str, least: float, low: float, high: float, step: float) -> None:
        self.name, self._least = name, least
        self._low, self._high, self._step = low, high, step
        self._given, self._acting = Window(30 * _SECOND), Window(30 * _SECOND)
        self._limited = Window(60 * _SECOND)
        self._normal: list[float] = []

    def push(self, given: float, acting: float) -> None:
        """Take the command for the step that ended, and where the drive is."""
        last = self._given[-1] if self._given else given
        at_bound = not self._low + 1e-6 < given < self._high - 1e-6
        self._limited.append(float(at_bound or abs(given - last) >= self._step - 1e-6))
        self._given.append(given)
        self._acting.append(acting)

    def forget(self) -> None:
        """Another controller commands: how much it moves is not known yet."""
        self._normal.clear()

    def figures(self, calm_s: float) -> dict[str, float]:
        """Figures at a second; ``calm_s`` is how long the set-points have stood."""
        if not self._given.full:
            return {}
        name, given, acting = self.name, self._given.values(), self._acting.values()
        # it stands still although the command is elsewhere: elsewhere than usual, for a load cell may have an offset
        offset = given - acting
        away = np.abs(offset - np.median(offset))[1:] > self._least
        found = {f"stiction_{name}": float(np.mean(away & (np.abs(np.diff(acting)) < 0.05 * self._least)))}
        moves = np.abs(np.diff(given))
        # no figure where there is no delay, or none can be told: while an alarm is there, the one before stands
        if float(np.sqrt(np.mean(moves**2))) > 0.1 * self._least and (delay := best_delay(given, acting, 15)):
            found[f"lag_{name}"] = TICK_S * delay
        if self._limited.full:
            found[f"saturation_{name}"] = float(self._limited.values().mean())
        if calm_s > 60.0:
            moved = float(np.median(moves)) + 1e-6
            if len(self._normal) < 30:
                self._normal.append(moved)
            else:
                found[f"movement_{name}"] = moved / max(float(np.median(self._normal)), 0.01 * self._least)
        return found


class LoopWatch:
    """Error of a controlled value: whether it oscillates, and whether it could be smaller."""

    #: samples of the error that make one, and how many are looked at
    EVERY, SIZE = 5, 240

    def __init__(self, name: str, dead_time_s: float) -> None:
        self.name = name
        self._delay = max(1, round(dead_time_s / (self.EVERY * TICK_S)) + 1)
        self._window, self._sum, self._n = Window(self.SIZE), 0.0, 0
        self._noise, self._brought = WHITE, 0.0
        self.period_s = nan

    def push(self, error: float) -> None:
        """Take the error; NaN without a set-point."""
        if not isfinite(error):
            return
        self._sum, self._n = self._sum + error, self._n + 1
        if self._n == self.EVERY:
            self._window.append(self._sum / self._n)
            self._sum, self._n = 0.0, 0

    def noisy(self, noise: Noise, brought: float) -> None:
        """Noise of the value is this if it is coloured; ``brought`` is what another's brings (standard deviation)."""
        self._noise, self._brought = noise, brought

    def figures(self, calm_s: float, noise: float) -> dict[str, float]:
        """Figures, once the whole window is of a loop that has settled; ``noise`` is the sensor's, if it is white."""
        step_s = self.EVERY * TICK_S
        if not self._window.full or calm_s < self.SIZE * step_s + _SETTLED_S:
            return {}
        errors = self._window.values()
        swing = oscillation(errors, step_s)
        self.period_s = swing.period_s
        sigma = self._noise.sigma or noise
        found = {f"oscillation_{self.name}": swing.regularity if swing.amplitude > _VISIBLE * sigma else 0.0}
        # a loop whose error is the sensor's noise cannot be better
        least = sigma**2 * self._noise.share_of_mean(self.EVERY) + self._brought**2
        at_best = float(errors.var()) < 4.0 * least
        found[f"poor_control_{self.name}"] = 0.0 if at_best else 1.0 - harris_index(errors, self._delay)
        return found


class InnovationWatch:
    """Residual of an equation less its running mean: whether it is as small and as white as when the weld began."""

    _FOLLOW = 1.0 - exp(-TICK_S / 2.0)

    def __init__(self, name: str) -> None:
        self.name, self._window = name, Window(30 * _SECOND)
        self._mean = self._last = nan
        self._normal = inf
        self._learnt: list[tuple[float, float]] = []

    def push(self, residual: float) -> None:
        """Take a residual."""
        if not isfinite(self._mean):
            self._mean = self._last = residual
        # an edge of the workpiece is no change of the process
        if (residual - self._last) ** 2 > 2.0 * JUMP**2 * self._normal:
            self._mean += residual - self._last
        self._last = residual
        self._window.append(residual - self._mean)
        self._mean += self._FOLLOW * (residual - self._mean)

    def figures(self, time_s: float, calm_s: float, noise: Noise) -> dict[str, float]:
        """Figures at a second; after a step of a set-point the error of a gain has a colour, which its figure tells.

        The colour that the noise has from the begin of the weld on is taken out: of each value, the share that is kept
        of the one before.
        """
        if not self._window.full:
            return {}
        values = self._window.values()
        if time_s <= LEARN_S:
            centred = values - values.mean()
            self._learnt.append((float(values.var()), float(centred[1:] @ centred[:-1]) / values.size))
            return {}
        if not self._learnt:
            return {}
        powers, products = np.array(self._learnt).T
        self._normal = float(np.median(powers))
        normal = float(np.median((1.0 + noise.autocorrelation**2) * powers - 2.0 * noise.autocorrelation * products))
        if normal <= 0.0:
            return {}
        if noise.autocorrelation:
            values = values[1:] - noise.autocorrelation * values[:-1]
        found = {f"innovation_size_{self.name}": float(values.var()) / normal}
        if calm_s > _SETTLED_S:
            found[f"innovation_colour_{self.name}"] = ljung_box(values)
        return found


class ModelWatch:
    """Residuals, second by second: their levels and slopes against those at the begin of the weld, and the gains."""

    _NAMES = ("torque", "model_torque", "heat", "pressed", "sunk")

    def __init__(self, dead_time_s: float) -> None:
        self._unsure = dict.fromkeys(("torque", "heat", "depth"), 0.0)
        self._seconds = {name: Window(round(LEARN_S)) for name in self._NAMES}
        self._ticks = {name: Window(_SECOND) for name in self._NAMES}
        offsets = (0.0, -1.0, -0.5, 0.5, 1.0, 1.5, 2.0, 3.0)
        self._nominal_s = dead_time_s
        self.heat = GainEstimate(tuple(dead_time_s + one for one in offsets), 0.7, 0.15, 40.0)
        self.depth = GainEstimate((0.0,), 0.02, DEPTH_NOISE_MM, 15.0)
        self.levels: dict[str, float] = {}  #: of torque [N m] and heat [degC], slope of depth [mm/s]; NaN before
        self._normal: dict[str, float] = {}
        #: of the weld, so that a step of a set-point is no drift: measured over model torque less 1, and the depth's
        self._torque_share, self._depth_gain = 0.0, 1.0
        self.torque_ratio = nan  #: measured torque of the process over the model's
        self.gains: dict[str, Gain] = {}

    def push(self, now: Residuals) -> None:
        """Take the residuals of a tick."""
        values = now.torque_nm, now.model_torque_nm, now.heat_c, now.pressed_mm, now.sunk_mm
        for window, value in zip(self._ticks.values(), values, strict=True):
            window.append(value)
        self.heat.step(now.heated_c, now.rise_c)
        self.depth.step(now.pressed_mm, now.sunk_mm)

    def second(self, time_s: float) -> None:
        """A second is over: its medians count."""
        for name, window in self._ticks.items():
            self._seconds[name].append(float(np.median(window.values())))
        torque, model, heat, pressed, sunk = (self._seconds[name].values() for name in self._NAMES)
        shares = torque / model
        if shares.size >= _LEVEL_S:  # before, the begin of the weld counts
            self.torque_ratio = 1.0 + float(np.median(shares[-_LEVEL_S:]))
        if time_s <= LEARN_S:
            self._torque_share = float(np.median(shares))
            self._depth_gain = gain_beside_slope(sunk, pressed, 1.0, _GAIN_BEFORE, _DEPTH_MM)
            self._normal = {
                "torque": float(np.median(torque - self._torque_share * model)),
                "heat": float(np.median(heat)),
                "depth": robust_slope(sunk - self._depth_gain * pressed, 1.0, _SPAN_S),
            }
            self.levels = dict.fromkeys(self._normal, nan)
            return
        sunk, pressed = sunk[-_SLOPE_S:], pressed[-_SLOPE_S:]
        gain = gain_beside_slope(sunk, pressed, self._depth_gain, _GAIN_WITHIN, _DEPTH_MM)
        now = {
            "torque": float(np.median((torque - self._torque_share * model)[-_TORQUE_S:])),
            "heat": float(np.median(heat[-_LEVEL_S:])),
            "depth": robust_slope(sunk - gain * pressed, 1.0, _SPAN_S),
        }
        self.levels = {name: value - self._normal[name] for name, value in now.items()}

    def noisy(self, noises: Mapping[str, Noise], heated: float) -> None:
        """Noise of the residuals is this, and that of the torque seems to heat: by coloured noise all is less sure."""
        torque, depth, heat = noises["torque"], noises["depth"], noises["heat"]
        slope = sum(1.0 / (n - _SPAN_S) ** 2 for n in (_SLOPE_S, LEARN_S))  # of the means of its first and last span
        self._unsure = {
            "torque": sqrt(torque.variance_of_mean(_TORQUE_S) + torque.variance_of_mean(LEARN_S)),
            "heat": sqrt(heat.variance_of_mean(_LEVEL_S) + heat.variance_of_mean(LEARN_S) + 2.0 * heated**2),
            "depth": sqrt(2.0 * depth.variance_of_mean(_SPAN_S) * slope),
        }
        self.depth.noisy(depth.as_one, 0.0)
        # what the noise seems to heat is as slow as the washout lets through
        self.heat.noisy(2.0 * _HEATED_S / TICK_S if heated else heat.as_one, heated)

    def estimate(self) -> None:
        """Estimate the gains."""
        self.gains = {"heat": self.heat.estimate(), "depth": self.depth.estimate()}

    def figures(self) -> dict[str, float]:
        """Figures at a second."""
        found = {
            f"drift_{name}": max(abs(value) - 2.0 * self._unsure[name], 0.0)
            for name, value in self.levels.items()
            if isfinite(value)
        }
        if "drift_depth" in found:
            found["drift_depth"] *= 60e3  # um/min
        if isfinite(self.torque_ratio):
            found["gain_torque"] = 100.0 * abs(self.torque_ratio - 1.0)
        for name, gain in self.gains.items():
            if gain.excited:
                found[f"gain_{name}"] = 100.0 * max(abs(gain.gain - 1.0) - 2.0 * gain.error, 0.0)
        heat = self.gains.get("heat")
        if heat is not None and heat.excited:
            found["dead_time"] = heat.worse if abs(heat.dead_time_s - self._nominal_s) > _DEAD_TIME_S else 0.0
        return found
