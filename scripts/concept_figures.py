"""Figures of the pages on the controllers, each of a short weld; drawn by draw_figures.py."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from fsw_analysis.figure_style import CONTROLLERS, OTHERS, label_time, legend_below, sheet
from fsw_analysis.figures import Run, page
from fsw_analysis.weld_signals import WeldSignals
from fsw_campaign.welds import with_programme
from fsw_control.contract import Command, Measurement, Proposal, Reference
from fsw_identification.heat_learning import learn
from fsw_lab.learn_command import model_text
from fsw_model import nominal
from fsw_model.heat_profile import HeatProfile
from fsw_nmpc import NmpcController
from fsw_plant.parameters import Actuators
from fsw_scenario.closed_loop import ClosedLoop
from fsw_scenario.controllers import make_all
from fsw_scenario.scenario_file import content_of, load, put, read, text_of

_BAND: dict[str, Any] = {"color": "black", "alpha": 0.15, "linewidth": 0.0, "label": "± 2 σ"}
_DOTTED: dict[str, Any] = {"color": "black", "linestyle": (0, (1, 1))}
_DASHED: dict[str, Any] = {"color": "black", "linestyle": "--", "linewidth": 1.2}


def weld(scenario: str | Path, controller: str) -> Run:
    """A scenario under a controller."""
    loaded = load(str(scenario), [f"controller={controller.partition(':')[0]}"])
    return Run(controller, ClosedLoop(loaded, make_all(loaded, controller, {})).run())


class _Watched(NmpcController):
    """Keeps the plan of the first tick from a time on, with its standard deviations."""

    def __init__(self, at_s: float) -> None:
        super().__init__()
        self._at_s, self.plan, self.deviations = at_s, None, None

    def step(
        self, measurement: Measurement, reference: Reference, applied: Command, dt_s: float
    ) -> Proposal:
        proposal = super().step(measurement, reference, applied, dt_s)
        if self.plan is None and measurement.time_s >= self._at_s:
            self.plan = proposal.diagnosis.plan
            self.deviations = self.plan_deviations(self.plan.time_s)
        return proposal


def nmpc_plan(file: Path, now_s: float = 22.0, ahead_s: float = 15.0) -> None:
    """Plan of the NMPC two seconds after a step of the depth's set-point, and what comes of it."""
    watched = _Watched(now_s)
    scenario = load("reference_tracking", ["controller=nmpc"])
    signals = ClosedLoop(scenario, {"nmpc": watched}).run()
    plan, truth = watched.plan, signals.truth
    shown = (
        ("depth [mm]", truth.depth_mm, plan.depth_mm, signals.reference_depth_mm),
        (
            "temperature [°C]",
            truth.temperature_c,
            plan.temperature_c,
            signals.reference_temperature_c,
        ),
        ("force [kN]", signals.force_kn, plan.force_kn, None),
        ("speed [rpm]", signals.speed_rpm, plan.speed_rpm, None),
    )
    inside = (signals.time_s > now_s - 5.0) & (signals.time_s < now_s + ahead_s)
    time_s, later_s = signals.time_s[inside], now_s + np.array(plan.time_s)
    near = later_s < now_s + ahead_s
    with sheet(9.0, 7.0, file) as figure:
        axes = figure.subplots(4, 1, sharex=True)
        for row, (label, values, planned, set_point) in enumerate(shown):
            axis, middle = axes[row], np.array(planned)[near]
            held = {"drawstyle": "steps-post" if set_point is None else "default"}
            axis.plot(time_s, values[inside], **CONTROLLERS["nmpc"].line, **held, label="weld")
            axis.plot(later_s[near], middle, **_DASHED, **held, label="plan")
            if set_point is not None:
                spread = 2.0 * np.array(watched.deviations[row])[near]
                axis.fill_between(later_s[near], middle - spread, middle + spread, **_BAND)
                axis.step(time_s, set_point[inside], where="post", label="set-point", **_DOTTED)
            axis.axvline(now_s, color="dimgray", linewidth=0.9)
            axis.set_ylabel(label)
            axis.ticklabel_format(axis="y", useOffset=False)
        axes[0].set_title(f"The plan at {now_s:g} s, and the weld", loc="left", fontsize=10.0)
        label_time(axes[-1], now_s + ahead_s)
        figure.align_ylabels()
        legend_below(figure, most=5)


def nmpc_estimates(file: Path) -> None:
    """Disturbances of the outputs, and what the estimator takes for them."""
    signals = weld("output_disturbances", "nmpc").signals
    estimates, truth = signals.statuses["nmpc"].disturbances, signals.truth
    shown = (
        ("offset of depth [mm]", "depth", "mm", truth.depth_disturbance_mm),
        ("offset of temperature [°C]", "temperature", "c", truth.temperature_disturbance_c),
        ("heat [kW]", "power", "kw", np.zeros(signals.n_ticks)),
    )
    with sheet(9.0, 6.0, file) as figure:
        axes = figure.subplots(3, 1, sharex=True)
        for axis, (label, name, unit, true) in zip(axes, shown, strict=True):
            middle, spread = (
                estimates[f"{name}_{unit}"],
                2.0 * estimates[f"{name}_deviation_{unit}"],
            )
            axis.fill_between(signals.time_s, middle - spread, middle + spread, **_BAND)
            axis.plot(signals.time_s, middle, **CONTROLLERS["nmpc"].line, label="estimate")
            axis.plot(signals.time_s, true, **_DOTTED, label="in the plant")
            axis.set_ylabel(label)
        label_time(axes[-1], float(signals.time_s[-1]))
        figure.align_ylabels()
        legend_below(figure)


def pi_tunings(file: Path) -> None:
    """The tunings of the decentralized controller on the paper's set-point steps."""
    labels = [f"decentral:{name}" for name in ("conservative", "tight", "smith")]
    runs = [weld("reference_tracking", label) for label in labels]
    page(runs, 6, "Set-point steps with the decentralized controller", file)


#: copper, losses and noise of the canisters of the figure of known heat: of the weld that teaches,
#: and of the one that is shown (chosen)
_TAUGHT = {"conductivity_w_per_m_k": 355.0, "heat_capacity_j_per_kg_k": 430.0, "ambient_c": 25.0}
_SHOWN = {"conductivity_w_per_m_k": 370.0, "heat_capacity_j_per_kg_k": 440.0, "ambient_c": 12.0}


def _down_and_along(
    canister: dict[str, float], seed: int, model: str = "", heat: HeatProfile | None = None
) -> WeldSignals:
    """A weld from the lid down and a few degrees along the joint line, with the tool's path."""
    content = content_of(text_of("canister_weld_heat"), "heat")
    del content["phases"][4:], content["events"][2:]
    content["phases"][3]["to_deg"] = 35.0
    content["plant"]["canister"] |= {"element_mm": 12.0, "modes": 64} | canister
    put(content, "plant.seed", seed)
    scenario = read(content | {"controller": "nmpc"}, "heat")
    controllers = make_all(scenario, "nmpc", {"nmpc": {"model_file": model}} if model else {})
    return with_programme(ClosedLoop(scenario, controllers, heat).run(), scenario)


def known_heat(file: Path) -> None:
    """Heat computed and learned beforehand, and the temperature with it and without."""
    lag_s, digest = Actuators().lag_s, "0" * 64
    taught, drawn = (_down_and_along(factors, seed) for factors, seed in ((_TAUGHT, 1), ({}, 2)))
    learned = learn([("taught", digest, taught)], "lid", nominal(), lag_s)
    computed = learn([("drawn", digest, drawn)], "lid", learned.model, lag_s, True, True).profile
    known = (
        ("nothing known", None, OTHERS[3]),
        ("computed", computed, OTHERS[0]),
        ("learned from one weld", learned.profile, CONTROLLERS["nmpc"]),
    )
    with tempfile.TemporaryDirectory() as folder, sheet(9.0, 5.5, file) as figure:
        model = Path(folder) / "model.yaml"
        model.write_text(model_text(learned), encoding="utf-8")
        upper, lower = figure.subplots(2, 1, sharex=True)
        for name, profile, look in known:
            if profile is not None:
                heat_kw = np.array(profile.heat_kw) - profile.heat_kw[0]
                spread, places = 2.0 * np.array(profile.deviation_kw), profile.travel_mm
                upper.fill_between(places, heat_kw - spread, heat_kw + spread, **_BAND)
                upper.plot(places, heat_kw, **look.line, label=name)
            signals = _down_and_along(_SHOWN, 3, str(model), profile)
            moving = signals.travel_mm > 0.0
            wrong_c = signals.truth.temperature_c - signals.reference_temperature_c
            lower.plot(signals.travel_mm[moving], wrong_c[moving], **look.line, label=name)
        upper.set_ylabel("heat since the start [kW]")
        lower.set_ylabel("temperature error [°C]")
        lower.set_xlabel("travelled path [mm]")
        figure.align_ylabels()
        legend_below(figure)
