#!/usr/bin/env python3
"""Known heat: gain of a profile learned from earlier welds of a type, and cost of a wrong one.

usage: heat.py [--quick] [--minutes N] [--json FILE]

The canisters are those of the campaign `canisters`; no weld that is measured made a profile.
"""

import tempfile
import time
from dataclasses import replace
from functools import cache, partial
from itertools import product
from math import hypot
from pathlib import Path
from typing import NamedTuple

import _benchmark
import numpy as np
import pandas as pd

from fsw_analysis.phase_kpi import compute
from fsw_campaign.definition import load
from fsw_campaign.welds import with_programme
from fsw_control import weld
from fsw_control.weld import TICK_S
from fsw_identification.heat_learning import learn
from fsw_lab.learn_command import model_text
from fsw_model import nominal
from fsw_plant.parameters import Actuators
from fsw_scenario import scenario_file
from fsw_scenario.closed_loop import ClosedLoop
from fsw_scenario.controllers import make_all
from fsw_scenario.weld_programme import spans
from fsw_tuning.standard_cases import cut_joint_line

#: welds of the campaign whose wall, rim and lid, and whose machine and tool, the types have; no
#: two have the same walls, rims and lids
TYPES = (0, 1, 4, 5)
OF_TYPE = (
    *(f"plant.canister.{name}" for name in ("wall_mm", "rim_mm", "lid_mm")),
    *(f"plant.canister.{name}" for name in ("tool_share", "shoulder_share")),
    "plant.factors.tool_lag_s",
    "plant.factors.dead_time_s",
    "plant.actuators.lag_s",
)
#: what the drawing of a type says, and its discretisation: all that a weld that is computed before
#: the first one has of it; copper, losses, machine and tool are nominal
DRAWN = tuple(
    f"plant.canister.{name}"
    for name in ("wall_mm", "rim_mm", "lid_mm", "lid_from_mm", "element_mm", "modes")
)
#: welds of the campaign that have all else (copper, losses, ambient, process, noise): those that
#: teach, and those that are measured
TAUGHT, MEASURED = range(100, 104), range(500, 525)
LEARNED = (1, 4)  #: welds that a profile is learned from
#: ends of the joint line [deg]: of a whole weld, and of most, which have a ninth of it
WHOLE_DEG, SHORT_DEG = 380.0, 60.0
WHOLE = (
    500,
    501,
)  #: of the measured welds, those that are also welded as a whole, of the first type
PHASES = ("start", "downward", "joint_line", "overlap", "parking")
#: columns that say which phase of which canister
PLACE = ["kind", "canister", "phase"]
#: controllers without and with the machine's model, and with what they know of the heat
RIVALS = ("decentral:tight", "nmpc:default")
CONTROLLERS = (*RIVALS, "model", "computed", *(f"learned from {n}" for n in LEARNED))
MOST_COST = 1.1  #: that a wrong profile may have
#: a phase is inside its limits in the process window and within these errors, but for some seconds
#: (chosen)
DEPTH_MM, TEMPERATURE_C, AT_MOST_S = weld.QUALITY_DEPTH_MM, 10.0, 5.0
NEAR_RPM = 0.3  #: of the end of its range, where the spindle counts as saturated
#: a weld that shows what the spindle can give, and the share of both limits by which its
#: set-points are raised (chosen: the rest is for the errors of the loop)
HOTTEST, RAISED = "hottest", 0.9


class Task(NamedTuple):
    """A weld to be measured."""

    kind: int  #: index of its type
    canister: int | None  #: weld of the campaign; none: computed from the drawing
    label: str
    end_deg: float = SHORT_DEG
    model: str = ""  #: model file; none: the paper's
    profile: object = None


class Raised:
    """A controller with both set-points raised.

    No weld inside the limits is much hotter or deeper.
    """

    def __init__(self, controller):
        self._controller = controller

    def __getattr__(self, name):
        return getattr(self._controller, name)

    def step(self, measurement, reference, applied, dt_s):
        """One tick."""
        coming = tuple(point._replace(**higher(point)) for point in reference.coming)
        raised = replace(reference, coming=coming, **higher(reference))
        return self._controller.step(measurement, raised, applied, dt_s)


def higher(set_points):
    """Set-points that many limits higher."""
    return {
        "depth_mm": set_points.depth_mm + RAISED * DEPTH_MM,
        "temperature_c": set_points.temperature_c + RAISED * TEMPERATURE_C,
    }


@cache
def campaign():
    """The campaign of the canisters."""
    return load("canisters")


def scenario_of(kind, canister, end_deg, controller):
    """A weld of a canister, its joint line cut short."""
    values = {} if canister is None else campaign().parameters(canister)
    of_type = campaign().parameters(TYPES[kind])
    content = scenario_file.content_of(scenario_file.text_of("canister_weld_heat"), "heat")
    cut_joint_line(content, end_deg)
    known = DRAWN if canister is None else OF_TYPE
    changes = values | {name: of_type[name] for name in known} | {"controller": controller}
    for path, value in changes.items():
        scenario_file.put(content, path, value, "heat")
    return scenario_file.read(content, "heat")


def signals_of(task):
    """Make a weld; returns scenario and signals."""
    label = task.label if task.label in RIVALS else "nmpc"
    name = label.partition(":")[0]
    scenario = scenario_of(task.kind, task.canister, task.end_deg, name)
    parameters = {name: {"model_file": task.model}} if task.model else {}
    controllers = make_all(scenario, label, parameters)
    if task.label == HOTTEST:
        controllers = {name: Raised(controller) for name, controller in controllers.items()}
    return scenario, ClosedLoop(scenario, controllers, task.profile).run()


def taught(task):
    """Signals of a weld that teaches, with the tool's path."""
    scenario, signals = signals_of(task)
    return with_programme(signals, scenario)


def phase_rows(scenario, signals):
    """Figures of each phase, from the truth."""
    truth = signals.truth
    wrong_c = truth.temperature_c - signals.reference_temperature_c
    wrong_mm = np.abs(truth.depth_mm - signals.reference_depth_mm)
    low_c, high_c = weld.QUALITY_TEMPERATURE_MIN_C, weld.QUALITY_TEMPERATURE_MAX_C
    cold = (wrong_c < -TEMPERATURE_C) | (truth.temperature_c < low_c)
    outside = cold | (wrong_c > TEMPERATURE_C) | (truth.temperature_c > high_c)
    outside |= wrong_mm > DEPTH_MM
    fast = signals.speed_rpm > weld.SPEED_MAX_RPM - NEAR_RPM
    parts = [  # a tick earlier: the set-point at a boundary is that of the later phase
        (name, begin_s - TICK_S, end_s - TICK_S)
        for name, begin_s, end_s in spans(scenario.phases, signals.n_ticks * TICK_S)
    ]
    for (phase, begin_s, end_s), errors in zip(parts, compute(signals, "", parts), strict=False):
        inside = (signals.time_s > begin_s + 1e-6) & (signals.time_s <= end_s + 1e-6)
        temperature, depth = errors.in_force_temperature_c, errors.in_force_depth_mm
        if temperature is None or depth is None:
            continue
        outside_s = float(outside[inside].sum() * TICK_S)
        yield {
            "phase": phase,
            "seconds": float(inside.sum() * TICK_S),
            "temperature_peak_c": float(np.abs(wrong_c[inside]).max()),
            "depth_peak_mm": float(wrong_mm[inside].max()),
            "temperature_sigma_c": hypot(temperature.mean, temperature.sigma),
            "depth_sigma_mm": hypot(depth.mean, depth.sigma),
            "moved_rpm": float(np.abs(np.diff(signals.speed_rpm[inside])).sum()),
            "fastest_s": float(fast[inside].sum() * TICK_S),
            "cold_s": float(cold[inside].sum() * TICK_S),
            "outside_s": outside_s,
            "good": outside_s <= AT_MOST_S,
        }


def measured(task):
    """A row for each phase of a weld, with the figures of the phases from downward on together."""
    scenario, signals = signals_of(task)
    phases = [row for row in phase_rows(scenario, signals) if row["phase"] in PHASES]
    later = phases[1:]
    squares = sum(row["seconds"] * row["temperature_sigma_c"] ** 2 for row in later)
    weld_figures = {
        **{name: getattr(task, name) for name in ("kind", "canister", "label", "end_deg")},
        "rms_c": float(np.sqrt(squares / sum(row["seconds"] for row in later))),
        "later_fastest_s": sum(row["fastest_s"] for row in later),
    }
    return [weld_figures | row for row in phases]


def mirrored(profile):
    """A profile from its end to its begin."""
    return profile.changed(
        heat_kw=profile.heat_kw[::-1], deviation_kw=profile.deviation_kw[::-1], type="mirrored"
    )


def tasks_of(kind, canister, profiles, models):
    """The welds of a canister: all controllers, and wrong profiles."""
    model, own = models[kind], profiles[kind, LEARNED[-1]]
    yield from (Task(kind, canister, label) for label in RIVALS)
    yield Task(kind, canister, "model", SHORT_DEG, model)
    yield Task(kind, canister, "computed", SHORT_DEG, model, profiles[kind, "computed"])
    for n in LEARNED:
        yield Task(kind, canister, f"learned from {n}", SHORT_DEG, model, profiles[kind, n])
    others = [profiles[other, LEARNED[-1]] for other in models if other != kind]
    for profile in (*others, mirrored(own)):
        wrong = profile.changed(model=own.model)  # or it would be refused
        yield Task(kind, canister, f"wrong: {profile.type}", SHORT_DEG, model, wrong)


def hottest(rows, profiles, models):
    """For each canister with a phase outside, a weld that shows if the spindle is to blame."""
    best = [row for row in rows if row["label"] == CONTROLLERS[-1] and not row["good"]]
    for kind, canister in dict.fromkeys((row["kind"], row["canister"]) for row in best):
        known = profiles[kind, LEARNED[-1]]
        yield Task(kind, canister, HOTTEST, SHORT_DEG, models[kind], known)


def whole_tasks(profiles, models):
    """Whole welds of the first type."""
    for canister in WHOLE:
        yield Task(0, canister, "learned from 1", WHOLE_DEG, models[0], profiles[0, "whole"])


def profiles_of(kinds, whole, folder):
    """Profiles by type and number of welds, and each type's model file, from its first weld."""
    chosen = (None, *TAUGHT)
    tasks = [Task(kind, canister, "nmpc:default") for kind in kinds for canister in chosen]
    tasks += [Task(0, TAUGHT[0], "nmpc:default", WHOLE_DEG)] if whole else []
    signals = _benchmark.each(taught, tasks, "taught:")
    known = partial(learn, drive_lag_s=Actuators().lag_s)
    profiles, models = {}, {}
    for i, kind in enumerate(kinds):
        drawn, *of_kind = signals[i * len(chosen) : (i + 1) * len(chosen)]
        welds = [(str(k), f"{k:064d}", weld) for k, weld in enumerate(of_kind)]
        first = known(welds[:1], f"type_{kind}", nominal())
        models[kind] = str(folder / f"type_{kind}.model.yaml")
        Path(models[kind]).write_text(model_text(first), encoding="utf-8")
        learned = {"computed": [("computed", "0" * 64, drawn)]}
        learned |= {n: welds[:n] for n in LEARNED}
        learned |= {"whole": [("whole", "0" * 64, signals[-1])]} if whole and kind == 0 else {}
        for n, each in learned.items():
            made = known(
                each,
                f"type_{kind}",
                model=first.model,
                keep_model=True,
                computed=n == "computed",
            )
            profiles[kind, n] = made.profile
    return profiles, models


def figures_of(welds):
    """Medians by controller and phase, and the worst."""
    by_phase = welds[welds.label.isin(CONTROLLERS)].groupby(["label", "phase"])
    table = by_phase.agg(
        welds=("good", "size"),
        temperature_c=("temperature_sigma_c", "median"),
        worst_c=("temperature_sigma_c", "max"),
        moved_rpm=("moved_rpm", "median"),
        depth_um=("depth_sigma_mm", lambda depth_mm: 1e3 * depth_mm.median()),
        good=("good", "sum"),
    )
    return table.to_dict("index")


def moved(welds):
    """By controller, how far its speed moves in the downward phase, and from there to the end.

    Each with the median [rpm], and the median share in what the preset as shipped moves on the
    same canister.
    """
    table = {label: [] for label in CONTROLLERS}
    for phases in (PHASES[1:2], PHASES[1:]):
        by_weld = welds[welds.phase.isin(phases)].groupby(["kind", "canister", "label"])
        sums = by_weld.moved_rpm.agg(lambda moved_rpm: sum(moved_rpm)).unstack()
        shares = sums.div(sums[RIVALS[-1]], axis=0)
        for label, parts in table.items():
            parts.append({"moved_rpm": sums[label].median(), "share": shares[label].median()})
    return table


def outside(welds, hot):
    """Each phase outside its limits with what is known best.

    Seconds outside, too cold, and at the highest speed.
    """
    best = welds[(welds.label == CONTROLLERS[-1]) & ~welds.good]
    best = best.join(hot.set_index(PLACE).cold_s.rename("hottest_cold_s"), on=PLACE)
    seconds = ["hottest_cold_s", "outside_s", "cold_s", "fastest_s"]
    return best[[*PLACE, *seconds, "temperature_peak_c", "depth_peak_mm"]].to_dict("records")


def comparison(welds):
    """Of each weld its error in that of the same weld without a profile, right or wrong."""
    each = welds[welds.phase == PHASES[0]]
    without = each[each.label == "model"].set_index(["kind", "canister"]).rms_c.rename("without_c")
    each = each[~each.label.isin((*RIVALS, "model"))].join(without, on=["kind", "canister"])
    each["cost"] = each.rms_c / each.without_c
    return each[["label", "kind", "canister", "cost"]]


def overall(compared):
    """Figures of all welds together."""
    wrong = compared[compared.label.str.startswith("wrong")]
    mirror = wrong[wrong.label.str.endswith("mirrored")].cost
    gains, costs = compared[compared.label == f"learned from {LEARNED[-1]}"].cost, wrong.cost
    return {
        "wrong_pairings": len(wrong),
        "wrong_median_cost": float(costs.median()),
        "wrong_worst_cost": float(costs.max()),
        "wrong_above_most": int((costs > MOST_COST).sum()),
        "mirrored_worst_cost": float(mirror.max()),
        "mirrored_above_most": int((mirror > MOST_COST).sum()),
        "learned_median_share_of_error": float(gains.median()),
        "learned_worst_share_of_error": float(gains.max()),
        "learned_worse": int((gains > 1.0).sum()),
    }


def welded(quick, minutes):
    """A row for each phase of all welds, and the profiles.

    No canister is begun after so many minutes.
    """
    until_s = time.monotonic() + 60.0 * minutes
    kinds = tuple(range(2 if quick else len(TYPES)))
    canisters, whole = (MEASURED[:1], False) if quick else (MEASURED, True)
    rows = []

    def weld_all(tasks):
        made = [row for of_weld in _benchmark.each(measured, tasks) for row in of_weld]
        rows.extend(made)
        return made

    with tempfile.TemporaryDirectory() as folder:
        profiles, models = profiles_of(kinds, whole, Path(folder))

        def weld_canister(place):
            canister, kind = place
            if time.monotonic() < until_s:
                made = weld_all(tasks_of(kind, canister, profiles, models))
                weld_all(hottest(made, profiles, models))

        places = list(product(canisters, kinds))
        _benchmark.counted(map(weld_canister, places), places, "canisters:")
        if whole:
            weld_all(whole_tasks(profiles, models))
    return pd.DataFrame(rows), profiles


def content_of(rows, profiles):
    """Figures, and the content of the page."""
    welds, full = rows[rows.end_deg == SHORT_DEG], figures_of(rows[rows.end_deg == WHOLE_DEG])
    hot, welds = welds[welds.label == HOTTEST], welds[welds.label != HOTTEST]
    beyond = pd.MultiIndex.from_frame(hot[hot.cold_s > AT_MOST_S][PLACE])
    in_reach = welds[~pd.MultiIndex.from_frame(welds[PLACE]).isin(beyond)]
    table, far, moves, compared = (
        figures_of(welds),
        outside(welds, hot),
        moved(welds),
        comparison(welds),
    )
    inside = {
        words: of.groupby("label").good.mean().loc[list(CONTROLLERS)].to_dict()
        for words, of in (("inside", welds), ("inside, of those in reach", in_reach))
    }
    figures = overall(compared) | _benchmark.flat(
        {
            (label, f"share of phases {words}"): share
            for words, of in inside.items()
            for label, share in of.items()
        }
        | {
            (label, f"speed moved, {part}"): values
            for label, parts in moves.items()
            for part, values in zip(("downward", "all"), parts, strict=True)
        }
        | {
            (
                f"outside: type {row.pop('kind')}, canister {row.pop('canister')}",
                row.pop("phase"),
            ): row
            for row in map(dict, far)
        }
    )
    flat = _benchmark.flat(
        table | {(f"whole weld: {label}", phase): of for (label, phase), of in full.items()}
    )
    alone = welds[(welds.phase == PHASES[0]) & (welds.label == "model")]
    saturated = alone[alone.later_fastest_s > 10.0].later_fastest_s
    return figures | flat, {
        "figures": figures,
        "errors": table,
        "full": full,
        "phases": PHASES,
        "controllers": CONTROLLERS,
        "losses": compared.sort_values("cost", ascending=False, kind="stable").values.tolist(),
        "inside": inside["inside"],
        "in_reach": inside["inside, of those in reach"][CONTROLLERS[-1]],
        "outside": far,
        "raised": RAISED,
        "at_most_s": AT_MOST_S,
        "moved": moves,
        "rivals": RIVALS,
        "saturated": saturated.tolist(),
        "profiles": {key: profile for key, profile in profiles.items() if key[1] == LEARNED[-1]},
        "most": MOST_COST,
    }


def measure(quick, minutes):
    """Figures, and the content of the page."""
    return content_of(*welded(quick, minutes))


MINUTES = {"type": float, "default": 1e6, "help": "begin no canister later"}

if __name__ == "__main__":
    _benchmark.run(
        __doc__, "two types, one canister each, no page", measure, "heat", {"--minutes": MINUTES}
    )
