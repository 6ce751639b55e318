"""Emulated welds for the benchmark of the monitor.

Healthy plants drawn widely, and plants with a fault.

Nothing of these draws sets a limit of the monitor. The coefficients of the plant differ from the
monitor's model, the probe may lag, noise may be larger or coloured, and any tuning may command.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import yaml

from fsw_control.sensors import SENSORS
from fsw_model import ModelParameters, nominal
from fsw_plant import PlantConfig
from fsw_quality.diagnosis import WatchCause
from fsw_quality.likelihood import default_covariance
from fsw_quality.residuals import COEFFICIENTS as STATES
from fsw_scenario.closed_loop import ClosedLoop
from fsw_scenario.controllers import make_all, name_of
from fsw_scenario.scenario_file import parse

PROCESSES = "paper", "canister"
DURATION_S = 420.0
#: when a fault begins: after the monitor has learnt
FAULT_S = 200.0
#: the NMPC commands six welds of ten
CONTROLLERS = (
    "nmpc:default",
    "nmpc:default",
    "decentral:conservative",
    "nmpc:default",
    "decentral:tight",
    "nmpc:default",
    "nmpc:default",
    "decentral:smith",
    "nmpc:default",
    "decentral:conservative",
)
#: coefficients that differ from the model's, by up to the spread of the weld
COEFFICIENTS = (
    "thermal_gain_c_per_kw",
    "copper_lag_s",
    "tool_lag_s",
    "dead_time_s",
    "softening_per_c",
    "motor_lag_s",
    "depth_gain_mm_per_kn_s",
    "depth_zero_s",
    "depth_pole_slow_s",
    "sliding_friction",
    "sticking_stress_pa",
)
SPREADS = 0.05, 0.1
#: standard error of each when this machine was identified: 2 % by the identification, 2 % from
#: weld to weld
IDENTIFIED = 0.03
NOISES = {
    f"{row.stem}_noise_{row.quantity.suffix}": row.noise
    for row in SENSORS.values()
    if row.required
}
#: the canister of the scenario canister_weld_heat
CANISTER = {
    "process": "canister",
    "start": {"temperature_c": 805.0, "power_kw": 48.0},
    "canister": {
        "lid_mm": 0.0,
        "probe_radius_mm": 25.0,
        "shoulder_share": 0.2,
        "element_mm": 10.0,
        "modes": 128,
    },
}


def changed(**settings):
    """A fault: the plant's settings change when it begins; those of the model by a factor."""

    def act(plant):
        if round(plant.time_s, 1) == FAULT_S:
            given = {name.replace("__", "."): value for name, value in settings.items()}
            given |= {
                name: plant.config[name] * value
                for name, value in given.items()
                if name.startswith("factors.")
            }
            plant.reconfigure(PlantConfig.from_values({**plant.config.values, **given}))

    return act


def sticking(plant):
    """A fault: the force drive sticks, within 0.5 kN."""
    if round(plant.time_s, 1) == FAULT_S:
        plant.core.memory.drive[0].band = 0.5


def load_cell(signals):
    """A fault: the load cell shows 2 kN too much."""
    late = signals.time_s >= FAULT_S
    return replace(
        signals, drives=replace(signals.drives, force_kn=signals.drives.force_kn + 2.0 * late)
    )


def fault(sensor, kind, **values):
    """A fault of a sensor, as an event of the scenario."""
    return {"at_s": FAULT_S, "fault": {"sensor": sensor, "kind": kind, **values}}


def wear(nm_per_min):
    """Tool wear, as an event of the scenario."""
    shape = {
        "channel": "torque",
        "shape": "ramp",
        "amplitude_nm": 10.0 * nm_per_min,
        "duration_s": 600.0,
    }
    return {"at_s": FAULT_S, "disturbance": shape}


class Case(NamedTuple):
    """What is wrong with a weld; by default nothing."""

    causes: tuple[str, ...] = ("",)  #: that name it, of ``WatchCause`` in small letters
    event: dict[str, Any] | None = None  #: of the scenario
    act: Callable[[Any], Any] | None = None  #: on the plant
    shown_by: str = ""  #: output whose set-point has to move before it shows
    size: float | None = None  #: what a clairvoyant looks for: it knows cause, size and onset
    aim_s: float | None = None  #: to be named within; of gains: after the set-point has moved

    @property
    def cause(self) -> WatchCause:
        """The first of its causes."""
        return WatchCause[self.causes[0].upper()]


def drifting(sensor, unit, per_s, aim_s=None):
    """A sensor that drifts by so much a second."""
    event = fault(sensor, "drift", **{f"magnitude_{unit}": per_s})
    return Case((f"{sensor}_drift",), event, size=per_s, aim_s=aim_s)


SENSORS = "depth", "torque", "thermocouple"
HEAT_GAIN = changed(factors__thermal_gain_c_per_kw=1.2)
DEAD_TIME = changed(factors__dead_time_s=1.0 + 1.5 / 2.8)
TORQUE_GAIN = changed(factors__sliding_friction=1.2, factors__sticking_stress_pa=1.2)
DEPTH_GAIN = {"causes": ("depth_gain",), "shown_by": "depth_mm", "aim_s": 60.0}
HEAT_SHOWS = {"shown_by": "temperature_c"}
CASES = {
    **{
        f"{sensor} stuck": Case((f"{sensor}_stuck",), fault(sensor, "freeze"), aim_s=3.0)
        for sensor in SENSORS
    },
    "thermocouple detached": Case(
        ("thermocouple_detached",), fault("thermocouple", "drift", magnitude_c=-5.0)
    ),
    "noise of depth tripled": Case(
        ("depth_noise_grown",), act=changed(sensors__depth_noise_mm=0.006)
    ),
    "thermocouple 2 °C/min": drifting("thermocouple", "c", 2.0 / 60.0, aim_s=60.0),
    "depth sensor 0.03 mm/min": drifting("depth", "mm", 0.03 / 60.0),
    "torque sensor 10 N·m/min": drifting("torque", "nm", 10.0 / 60.0),
    "load cell +2 kN": Case(("load_cell_step",), act=load_cell, size=2.0),
    "tool wear 3 N·m/min": Case(("tool_wear",), wear(3.0), size=3.0 / 60.0),
    "tool wear 6 N·m/min": Case(("tool_wear",), wear(6.0), size=6.0 / 60.0),
    "torque gain +20 %": Case(("torque_gain",), act=TORQUE_GAIN, size=0.2, aim_s=60.0),
    "depth gain +20 %": Case(
        act=changed(factors__depth_gain_mm_per_kn_s=1.2), size=0.2, **DEPTH_GAIN
    ),
    "depth gain -20 %": Case(
        act=changed(factors__depth_gain_mm_per_kn_s=0.8), size=-0.2, **DEPTH_GAIN
    ),
    "heat gain +20 %": Case(("heat_gain",), act=HEAT_GAIN, size=0.2, aim_s=60.0, **HEAT_SHOWS),
    "dead time +1.5 s": Case(("dead_time",), act=DEAD_TIME, size=1.5, **HEAT_SHOWS),
    "force drive sticks, 0.5 kN": Case(("force_sticks", "force_lags"), act=sticking),
    "drives 0.5 s late": Case(
        ("force_lags", "speed_lags"), act=changed(actuators__dead_time_ticks=5)
    ),
}


def plant_of(process, random, seed):
    """Settings of a plant, drawn."""
    plant = {"seed": seed, **(CANISTER if process == "canister" else {})}
    spread = float(random.choice(SPREADS))
    plant["factors"] = {
        name: float(1.0 + random.uniform(-spread, spread)) for name in COEFFICIENTS
    }
    factor, correlation_s = (
        float(random.choice([1.0, 1.0, 3.0])),
        float(random.choice([0.0, 0.0, 1.0, 5.0])),
    )
    plant["sensors"] = {name: factor * value for name, value in NOISES.items()}
    plant["sensors"] |= {
        f"{name}_noise_correlation_s": correlation_s for name in ("depth", "torque", "temperature")
    }
    plant["sensors"]["temperature_lag_s"] = float(random.choice([0.0, 0.0, 2.0]))
    return plant


def draws(process, seed):
    """The random numbers of a weld; the first are its plant's."""
    return np.random.default_rng([seed, PROCESSES.index(process)])


def identified(process, seed) -> tuple[ModelParameters, np.ndarray]:
    """Model and covariance of a weld's own plant, as an identification gives them."""
    model = plant_of(process, draws(process, seed), seed)["factors"]
    errors = IDENTIFIED * np.random.default_rng([seed, len(PROCESSES)]).normal(size=len(model))
    factors = {
        name: value * (1.0 + error)
        for (name, value), error in zip(model.items(), errors, strict=True)
    }
    covariance = default_covariance()
    for name in set(COEFFICIENTS) - {"tool_lag_s"}:  # which stands for the probe's lag, too
        covariance[STATES.index(name), STATES.index(name)] = IDENTIFIED**2
    return nominal().scaled(**factors), covariance


def scenario(process, seed, case, duration_s):
    """A weld with random set-point steps, an unsteady torque, and an edge of the workpiece."""
    random = draws(process, seed)
    plant = plant_of(process, random, seed)
    sine = {
        "amplitude_nm": float(random.uniform(1.0, 5.0)),
        "period_s": float(random.uniform(15.0, 60.0)),
    }
    edge = {
        "channel": "depth",
        "shape": "step",
        "amplitude_mm": float(random.choice([-0.05, 0.05])),
    }
    events = [
        {"at_s": 5.0, "reference": {"depth_mm": 2.66, "temperature_c": 816.4}},
        {"at_s": round(float(random.uniform(120.0, 380.0)), 1), "disturbance": edge},
    ]
    planted = CASES.get(case, Case())
    if planted.causes[0] != "tool_wear":  # its ramp is on the same channel
        events.append({"at_s": 1.0, "disturbance": {"channel": "torque", "shape": "sine", **sine}})
    depth, temperature, at_s = 2.66, 816.4, 5.0
    # one weld in four is left alone
    while seed % 4 and (at_s := at_s + float(random.uniform(30.0, 70.0))) < duration_s - 30.0:
        if random.random() < 0.5:
            depth = 2.66 if depth != 2.66 else 2.66 + float(random.choice([-0.2, 0.1, 0.2]))
            events.append({"at_s": round(at_s, 1), "reference": {"depth_mm": depth}})
        else:
            temperature = (
                816.4 if temperature != 816.4 else 816.4 + float(random.choice([-10.0, 6.0, 10.0]))
            )
            events.append({"at_s": round(at_s, 1), "reference": {"temperature_c": temperature}})
    label = CONTROLLERS[seed % len(CONTROLLERS)]
    events += [planted.event] if planted.event else []
    if (
        planted.event and "fault" in planted.event
    ):  # then a supervisor commands, with a fallback; its switch comes after the end
        fallback = "decentral" if name_of(label) == "nmpc" else "nmpc"
        events.append({"at_s": duration_s - 0.1, "switch": fallback})
    made = parse(
        yaml.safe_dump(
            {
                "name": "monitor",
                "duration_s": duration_s,
                "controller": name_of(label),
                "plant": plant,
                "events": sorted(events, key=lambda event: event["at_s"]),
            }
        ),
        "benchmark",
    )
    return made, label


def weld(process, seed, case, duration_s=DURATION_S):
    """Signals of a weld, and the first set-point move that shows the fault (None: at once)."""
    made, label = scenario(process, seed, case, duration_s)
    planted = CASES.get(case, Case())
    loop = ClosedLoop(made, make_all(made, label, {}))
    if planted.act not in (None, load_cell):
        step = loop.plant.step

        def stepped():
            planted.act(loop.plant)
            step()

        loop.plant.step = stepped
    signals = loop.run()
    if planted.act is load_cell:
        signals = load_cell(signals)
    moves = [
        event.at_s
        for event in made.events
        if planted.shown_by and getattr(event.reference, planted.shown_by, None) is not None
    ]
    return signals, next((at_s for at_s in moves if at_s >= FAULT_S), None), label
