"""Cases, and processes that differ from the model."""

from __future__ import annotations

import random
from collections.abc import Mapping
from pathlib import Path

from fsw_control.sensors import REQUIRED, SENSORS
from fsw_model import nominal


def own_case(name: str) -> str:
    """The scenario file of a case of this study."""
    return str(Path(__file__).parent / "cases" / f"{name}.yaml")


REST, BELOW_NOISE, INPUT_DISTURBANCES = map(
    own_case, ("rest", "below_noise", "input_disturbances")
)
#: Cases that no controller was tuned on: own ones, and scenarios shipped with fsw_scenario.
VALIDATION_CASES = (
    own_case("other_sizes"),
    INPUT_DISTURBANCES,
    "ramp_and_sine",
    "simultaneous_events",
    "quick",
    "saturation",
)

DEAD_TIME_S = nominal().dead_time_s
#: Processes that differ from the model: factors on its parameters, and the plant's own parameters.
SWEEP: dict[str, dict[str, float | str]] = {
    "nominal": {},
    "canister": {"process": "canister"},  # heat conduction instead of (16); warm at the start
    **{
        f"thermal gain × {k:g}": {"factors.thermal_gain_c_per_kw": k} for k in (0.5, 0.7, 1.4, 2.0)
    },
    **{f"depth gain × {k:g}": {"factors.depth_gain_mm_per_kn_s": k} for k in (0.5, 0.7, 1.4, 2.0)},
    **{
        f"torque × {k:g}": {"factors.sliding_friction": k, "factors.sticking_stress_pa": k}
        for k in (0.5, 0.7, 0.85, 1.15, 1.4, 2.0)
    },
    **{f"softening × {k:g}": {"factors.softening_per_c": k} for k in (0.5, 0.7, 1.4, 2.0)},
    **{f"thermal lag × {k:g}": {"factors.copper_lag_s": k} for k in (0.5, 2.0)},
    **{f"tool lag × {k:g}": {"factors.tool_lag_s": k} for k in (0.5, 2.0)},
    **{f"dead time {s:g} s": {"factors.dead_time_s": s / DEAD_TIME_S} for s in (1.8, 3.8)},
    "drive lag 0.3 s": {"actuators.lag_s": 0.3},
    "torque drop 0.6 N m/rpm": {
        "sensors.torque_drop_nm_per_rpm": 0.6
    },  # of the sensor only, as in Fig. 5
    **{f"loop latency {k / 10:g} s": {"actuators.dead_time_ticks": k} for k in (1, 3)},
}
#: Processes of the count of wins, in addition to the nominal one.
FIXED = (
    *(f"{gain} gain × {k:g}" for gain in ("thermal", "depth") for k in (0.5, 0.7, 1.4, 2.0)),
    "torque × 0.85",
    "softening × 0.5",
    "softening × 2",
    "thermal lag × 0.5",
    "thermal lag × 2",
    "dead time 1.8 s",
    "dead time 3.8 s",
    "drive lag 0.3 s",
    "loop latency 0.1 s",
)
#: parameters of the sensors' noise
CORRELATIONS = tuple(f"sensors.{SENSORS[name].stem}_noise_correlation_s" for name in REQUIRED)
#: Noise of the nominal size that is correlated, and a lag of the thermocouple's probe. No
#: controller knows of them. The times are chosen.
SENSING: dict[str, dict[str, float]] = {
    "white, no lag": {},
    **{f"correlated {s:g} s": dict.fromkeys(CORRELATIONS, s) for s in (1.0, 5.0)},
    **{f"lag {s:g} s": {"sensors.temperature_lag_s": s} for s in (1.0, 3.0)},
}
SENSING["correlated 5 s, lag 3 s"] = SENSING["correlated 5 s"] | SENSING["lag 3 s"]
#: Ranges of the factors of the random processes.
RANDOM: dict[str, tuple[float, float]] = {
    "factors.thermal_gain_c_per_kw": (0.7, 1.4),
    "factors.copper_lag_s": (0.7, 1.4),
    "factors.tool_lag_s": (0.5, 2.0),
    "factors.depth_gain_mm_per_kn_s": (0.7, 1.4),
    "factors.depth_zero_s": (0.8, 1.25),
    "factors.sliding_friction": (0.9, 1.1),
    "factors.softening_per_c": (0.5, 2.0),
    "factors.dead_time_s": (1.8 / DEAD_TIME_S, 3.8 / DEAD_TIME_S),
}
#: The same with sensors that differ, too.
RANDOM_SENSING = RANDOM | {
    **dict.fromkeys(CORRELATIONS, (0.0, 5.0)),
    "sensors.temperature_lag_s": (0.0, 3.0),
}

#: Ranges of the factors of other models, for which each controller is tuned.
MODELS = {
    "thermal_gain_c_per_kw": (0.6, 1.7),
    "depth_gain_mm_per_kn_s": (0.6, 1.7),
    "copper_lag_s": (0.5, 2.0),
    "tool_lag_s": (0.5, 2.0),
    "depth_zero_s": (0.5, 2.0),
    "depth_pole_slow_s": (0.5, 2.0),
    "dead_time_s": (1.8 / DEAD_TIME_S, 4.0 / DEAD_TIME_S),
}


def random_factors(
    count: int, spans: Mapping[str, tuple[float, float]] = RANDOM, seed: int = 2026
) -> list[dict[str, float]]:
    """Factors of `count` processes, drawn independently and uniformly."""
    generator = random.Random(seed)
    return [{name: generator.uniform(*span) for name, span in spans.items()} for _ in range(count)]
