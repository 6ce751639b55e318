#!/usr/bin/env python3
"""The comparison's set-point steps and disturbances on warm copper of unknown canisters.

usage: warm_copper.py [--quick] [--json FILE]
"""

import tempfile
from pathlib import Path

import _benchmark
import numpy as np
from heat import campaign

import fsw
from fsw_control.weld import TICK_S
from fsw_tuning.standard_cases import (
    CASES,
    CONSERVATIVE,
    DEFAULT,
    DURATION_S,
    REST,
    SMITH,
    TIGHT,
    events,
)

#: canisters of the campaign that no other benchmark welds
CANISTERS = range(600, 620)
#: welding in the lid, at the height of `identify_heat`, before a case begins (chosen: the needed
#: power then changes slowly), and the temperature at its begin, which all canisters reach
WARM_S, AXIAL_MM, START_C = 600.0, 74.35, 780.0
#: at the end of the disturbances, a minute after that of the temperature, for the error there
LAST_S = 5.0
IDENTIFIED = f"{DEFAULT}, identified"
#: with the margins of `decentral:tight`, as on the page of the comparison
CALM = {"temperature_aggressiveness": 0.4}
CALMER = f"{DEFAULT}, " + ", ".join(f"{name} {value:g}" for name, value in CALM.items())
CONTROLLERS = (CONSERVATIVE, TIGHT, SMITH, DEFAULT, CALMER, IDENTIFIED)
LATER = "a minute later"
FIGURES = {
    "tracking": "set-point steps: IAE [°C s]",
    "disturbances": "disturbances: IAE [°C s]",
    LATER: "error a minute after its disturbance [°C]",
}


def weld(index, case, label, parameters):
    """Signals of a case of the comparison on a canister that has been welded for a while."""
    rest = {"depth_mm": REST.depth_mm, "temperature_c": REST.temperature_c}
    content = {
        "name": case,
        "duration_s": WARM_S + DURATION_S[case],
        "plant": campaign().scenario["plant"],
        "events": [
            {"at_s": 1.0, "reference": rest},
            *events(case, WARM_S),
        ],
    }
    warm = {"plant.tool.axial_mm": AXIAL_MM, "plant.start.temperature_c": START_C}
    changes = campaign().parameters(index) | warm
    return fsw.simulate(content, label, parameters=parameters, changes=changes).signals


def errors(signals):
    """IAE of the temperature on warm copper [degC s], and its mean error at the end [degC]."""
    wrong_c = np.abs(signals.truth.temperature_c - signals.reference_temperature_c)
    iae_c_s = TICK_S * wrong_c[signals.time_s > WARM_S].sum()
    return float(iae_c_s), float(wrong_c[-round(LAST_S / TICK_S) :].mean())


def model_of(index):
    """Model file as ``fsw.py identify`` makes it of the experiment on that canister."""
    experiment = fsw.simulate("identify_heat", changes=campaign().parameters(index))
    return fsw.identify(experiment).text


def figures_of(index):
    """Errors on a canister, by controller and figure."""
    of = {}
    with tempfile.TemporaryDirectory() as folder:
        model = Path(folder, "identified.model.yaml")
        model.write_text(model_of(index), encoding="utf-8")
        for title in CONTROLLERS:
            label = title.partition(",")[0]
            own = {IDENTIFIED: {"model_file": str(model)}, CALMER: CALM}.get(title)
            of[title] = {}
            for case in CASES:
                of[title][case], of[title][LATER] = errors(weld(index, case, label, own))
    return of


def measure(quick):
    """Figures of all canisters, and the content of the page."""
    canisters = CANISTERS[:1] if quick else CANISTERS
    rows = _benchmark.each(figures_of, canisters, "canisters:")
    figures = {
        f"{title}: {figure}: {word}": float(of([row[title][figure] for row in rows]))
        for title in CONTROLLERS
        for figure in FIGURES
        for word, of in (("median", np.median), ("worst", max))
    }
    worse = {
        title: sum(row[title]["tracking"] > row[CONSERVATIVE]["tracking"] for row in rows)
        for title in CONTROLLERS
    }
    figures |= {f"{title}: worse than {CONSERVATIVE}": count for title, count in worse.items()}
    shown = {"CONTROLLERS": CONTROLLERS, "CALM": CALM, "FIGURES": FIGURES, "WARM_S": WARM_S}
    names = {
        "conservative": CONSERVATIVE,
        "default": DEFAULT,
        "calmer": CALMER,
        "identified": IDENTIFIED,
    }
    return figures, {**shown, **names, "figures": figures, "worse": worse, "count": len(rows)}


if __name__ == "__main__":
    _benchmark.run(__doc__, "one canister, no page", measure, "warm-copper")
