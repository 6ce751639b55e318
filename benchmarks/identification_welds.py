"""The welds that identification.py identifies.

With random events, and with noise of other colours.
"""

import random
from dataclasses import replace

import numpy as np
import scipy

import fsw
from fsw_control.parameters import describe
from fsw_identification.statistics import autocorrelation_of
from fsw_plant.parameters import PlantParameters
from fsw_scenario.scenario_file import content_of, text_of

#: smallest and largest amplitudes of disturbances, and of sensor faults (a drift: per second)
AMPLITUDES = {
    "depth": ("mm", 0.02, 0.1),
    "temperature": ("c", 1.0, 5.0),
    "axial_force": ("kn", 0.3, 1.5),
    "torque": ("nm", 10.0, 60.0),
}
FAULTS = {"depth": ("mm", 0.02, 0.1), "thermocouple": ("c", 1.0, 5.0)}
#: correlation times [s] of two parts of the noise, each of half its variance: none is of the
#: method's
MIXED = {"white and 5 s": (0.0, 5.0), "0.5 and 10 s": (0.5, 10.0)}


def disturbance(index):
    """A random event of the scenario's kind: disturbance of any shape, or fault of a sensor."""
    generator = random.Random(index)
    at_s = round(generator.uniform(30.0, 200.0), 1)
    sign = generator.choice((-1.0, 1.0))
    if generator.random() < 0.2:
        sensor = generator.choice(list(FAULTS))
        unit, low, high = FAULTS[sensor]
        kind = generator.choice(("bias", "drift"))
        duration_s = round(generator.uniform(20.0, 80.0), 1)
        size = sign * generator.uniform(low, high) / (1.0 if kind == "bias" else duration_s)
        return {"at_s": at_s, "fault": {"sensor": sensor, "kind": kind, f"magnitude_{unit}": size,
                                        "duration_s": duration_s}}  # fmt: skip
    channel = generator.choice(("depth", "depth", "temperature", "axial_force", "torque"))
    unit, low, high = AMPLITUDES[channel]
    entry = {"channel": channel, "shape": generator.choice(("step", "ramp", "sine", "pulse"))}
    entry[f"amplitude_{unit}"] = sign * generator.uniform(low, high)
    if entry["shape"] != "step":
        entry["duration_s"] = round(generator.uniform(5.0, 80.0), 1)
    if entry["shape"] == "sine":
        entry["period_s"] = round(generator.uniform(10.0, 90.0), 1)
    return {"at_s": at_s, "disturbance": entry}


def welded(name, plant, event=None):
    """A closed-loop weld with these parameters of the plant."""
    content = content_of(text_of(name))
    if event is not None:
        content["events"] = sorted([*content["events"], event], key=lambda entry: entry["at_s"])
    return fsw.simulate(content, "decentral:conservative", plant=plant)


def noisy(segment, correlations_s, seed):
    """A segment with nominal noise, in parts of equal variance with these correlation times."""
    names = ("sensors.depth_noise_mm", "sensors.temperature_noise_c", "sensors.torque_noise_nm")
    sizes = np.array([describe(PlantParameters)[name].default for name in names]) / np.sqrt(
        len(correlations_s)
    )
    generator, measured = np.random.default_rng(seed), segment.measured.copy()
    for correlation_s in correlations_s:
        autocorrelation = autocorrelation_of(correlation_s) if correlation_s else 0.0
        fresh = generator.standard_normal(measured.shape)
        fresh[1:] *= np.sqrt(1.0 - autocorrelation**2)
        measured += sizes * scipy.signal.lfilter([1.0], [1.0, -autocorrelation], fresh, axis=0)
    return replace(segment, measured=measured)
