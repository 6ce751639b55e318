"""All tuning of the NMPC as data, with the presets ``paper`` and ``default``."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from math import isfinite

from fsw_nmpc.corridor import KINDS
from fsw_nmpc.shape import Shape

PRESETS: dict[str, dict[str, float | str]] = {
    # (28)-(37) of the paper
    "paper": {
        "corridor": "recentred",
        "corridor_depth_s": 5.0,
        "corridor_temperature_s": 5.0,
        "dead_band_depth_mm": 2e-3,
        "dead_band_temperature_c": 0.1,
        "weight_depth_per_mm": 100.0,
        "weight_temperature_per_c": 1.0,
        "square_depth_per_mm2": 0.0,
        "square_temperature_per_c2": 0.0,
        "move_force_per_kn": 1.0,
        "move_speed_per_rpm": 0.01,
        "move_force_square": 0.0,
        "move_speed_square": 0.0,
    },
    "default": {},
}

_POSITIVE = tuple(
    f"{output}_{name}"
    for output in ("depth", "temperature")
    for name in ("acceleration", "slow_speed", "time_s", "top_speed", "ramp_speed", "pass_speed", "haste")
)


@dataclass(frozen=True, slots=True)
class Tuning:
    """Weights, dead-bands and corridors of the cost.

    Attributes
    ----------
    corridor : str
        ``shaped``: jumps are worked off as fast as the handles can follow, see ``fsw_nmpc.shape``; ``continuing``: the
        filtered set-point goes on by itself, so a disturbance is met at once; ``recentred``: as in the paper, the
        corridor starts at the measurement in every cycle.
    corridor_depth_s, corridor_temperature_s : float
        Time constants of the first-order set-point corridors (``continuing`` and ``recentred``).
    dead_band_depth_mm, dead_band_temperature_c : float
        Half widths of the dead-bands.
    weight_depth_per_mm, weight_temperature_per_c : float
        L1 weights outside the dead-band, per output point.
    square_depth_per_mm2, square_temperature_per_c2 : float
        Quadratic weights on the deviation from the corridor's centre, per output point.
    move_force_per_kn, move_speed_per_rpm : float
        L1 weights on the moves of an interval.
    move_force_square, move_speed_square : float
        Quadratic weights on the moves of an interval, per kN^2 and per (3 rpm)^2.
    interval_weighting : float
        0: every output point counts the same, as in the paper; 1: in proportion to its interval's length over 0.1 s;
        between: the length to this power.
    depth_acceleration, depth_slow_speed, depth_time_s, depth_top_speed, depth_ramp_speed, depth_pass_speed, depth_haste
        Shape of the depth's corridor, in mm and s, see :class:`fsw_nmpc.shape.Shape`.
    temperature_acceleration, temperature_slow_speed, temperature_time_s, temperature_top_speed, temperature_ramp_speed
        Shape of the temperature's corridor, in degC and s.
    temperature_pass_speed, temperature_haste, temperature_delay_s : float
        Likewise; the delay is the dead time.
    """

    corridor: str = "shaped"
    corridor_depth_s: float = 5.0
    corridor_temperature_s: float = 5.0
    dead_band_depth_mm: float = 3e-4
    dead_band_temperature_c: float = 0.02
    weight_depth_per_mm: float = 58.0
    weight_temperature_per_c: float = 0.87
    square_depth_per_mm2: float = 3000.0
    square_temperature_per_c2: float = 0.06
    move_force_per_kn: float = 0.5
    move_speed_per_rpm: float = 0.024
    move_force_square: float = 0.75
    move_speed_square: float = 0.5
    interval_weighting: float = 0.0
    depth_acceleration: float = 0.0152
    depth_slow_speed: float = 0.004
    depth_time_s: float = 5.5
    depth_top_speed: float = 0.05
    depth_ramp_speed: float = 0.004
    depth_pass_speed: float = 0.02
    depth_haste: float = 1.8
    temperature_acceleration: float = 0.93
    temperature_slow_speed: float = 0.4
    temperature_time_s: float = 7.3
    temperature_top_speed: float = 2.6
    temperature_ramp_speed: float = 0.5
    temperature_pass_speed: float = 0.5
    temperature_haste: float = 1.0
    temperature_delay_s: float = 2.8

    def __post_init__(self) -> None:
        if self.corridor not in KINDS:
            raise ValueError(f"tuning 'corridor' is {self.corridor!r}: must be {', '.join(KINDS[:-1])} or {KINDS[-1]}")
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name != "corridor" and not (isfinite(value) and value >= 0.0):
                raise ValueError(f"tuning {field.name!r} is {value!r}: must be a finite number >= 0")
        for name in _POSITIVE:
            if getattr(self, name) <= 0.0:
                raise ValueError(f"tuning {name!r} is {getattr(self, name)!r}: must be positive")

    @property
    def depth_shape(self) -> Shape:
        """How a jump of the depth's set-point or disturbance is worked off."""
        return Shape(
            self.depth_acceleration,
            self.depth_slow_speed,
            self.depth_time_s,
            self.depth_top_speed,
            self.depth_ramp_speed,
            self.depth_pass_speed,
            self.depth_haste,
        )

    @property
    def temperature_shape(self) -> Shape:
        """How a jump of the temperature's set-point or disturbance is worked off."""
        return Shape(
            self.temperature_acceleration,
            self.temperature_slow_speed,
            self.temperature_time_s,
            self.temperature_top_speed,
            self.temperature_ramp_speed,
            self.temperature_pass_speed,
            self.temperature_haste,
            self.temperature_delay_s,
        )

    @classmethod
    def preset(cls, name: str) -> Tuning:
        """A named set, see ``PRESETS``.

        Raises
        ------
        ValueError
            If there is no such preset.
        """
        if name not in PRESETS:
            raise ValueError(f"tuning preset {name!r} is unknown; known: {', '.join(PRESETS)}")
        return replace(cls(), **PRESETS[name])  # type: ignore[arg-type]
