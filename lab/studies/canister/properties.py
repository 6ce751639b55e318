"""Errors of linear models of copper against k(T), c(T) and nonlinear radiation."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from canister.full import FullCanister
from fsw_plant import PlantConfig
from fsw_plant.tool_path import ToolPath
from fsw_scenario import scenario_file
from fsw_scenario.weld_programme import spans

Progress = Callable[[float], None]
#: constant power [kW] and length of a step [s]
POWER_KW, _STEP_S = 47.0, 4.0
#: a mesh and modes that are coarser than the scenario's: all three models have the same
_COARSE = {"element_mm": 12.0, "modes": 64}
#: models of the copper, by the name in the results
MODELS = {
    "real": ("kirchhoff", True),
    "kirchhoff": ("kirchhoff", False),
    "constant": ("constant", False),
}
_SCENARIO = "canister_weld_heat"


def properties(
    minutes: float, progress: Progress | None = None, changes: dict[str, Any] | None = None
) -> dict[str, Any]:
    """Temperatures of the stir zone along the whole weld's path, with constant power from cold.

    Of each step ``at_s``, ``phase`` and, by model, ``stir_zone_c``. ``changes`` are parameters of
    the canister in the place of the scenario's.
    """
    scenario = scenario_file.load(_SCENARIO)
    config = PlantConfig.from_values(scenario.plant)
    assert config.canister is not None
    parameters = config.canister.changed(**{**_COARSE, **(changes or {})})
    path = ToolPath.of(scenario.path, config)
    starts_s = [k * _STEP_S for k in range(round(60.0 * minutes / _STEP_S))]
    result: dict[str, Any] = {
        "power_kw": POWER_KW,
        "reference_c": parameters.reference_c,
        "stir_zone_c": {},
    }
    phases = spans(scenario.phases)
    result["at_s"] = [at_s + _STEP_S for at_s in starts_s]
    result["phase"] = [
        next((n for n, a, b in phases if a < t <= b + 1e-6), phases[-1][0]) for t in result["at_s"]
    ]
    for number, (name, (kind, nonlinear)) in enumerate(MODELS.items()):

        def report(share: float, done: int = number) -> None:
            if progress is not None:
                progress((done + share) / len(MODELS))

        full = FullCanister(parameters.changed(properties=kind), _STEP_S, nonlinear)
        result["stir_zone_c"][name] = _course(full, path, starts_s, report)
    return result


def _course(
    full: FullCanister, path: ToolPath, starts_s: list[float], progress: Callable[[float], None]
) -> list[float]:
    """The stir zone at the ends of the steps; within one the tool is where it is in its middle."""
    state, temperatures_c = full.initial(axial_mm=path.motion(0.0).axial_mm), []
    for k, at_s in enumerate(starts_s):
        middle = path.motion(at_s + 0.5 * _STEP_S)
        state = full.step(state, POWER_KW, middle.traverse_mm_per_s, middle.axial_mm)
        temperatures_c.append(round(full.stir_zone_temperature_c(state), 2))
        progress((k + 1) / len(starts_s))
    return temperatures_c
