"""From the node's parameters (``nmpc.yaml``) to what the controller is made of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

from fsw_control import Limits
from fsw_control.parameters import load, validate
from fsw_nmpc.estimator import EstimatorTuning
from fsw_nmpc.horizon import paper_grid
from fsw_nmpc.tuning import Tuning

#: choices of ``blocks``: the ramps of :func:`fsw_nmpc.horizon.default_block_lengths`, or a move in every interval
BLOCKS = (20, len(paper_grid()) - 1)


@dataclass(frozen=True, slots=True)
class Settings:
    """Everything that can be chosen at the node, checked."""

    tuning: Tuning
    estimator: EstimatorTuning
    limits: Limits
    solver: str
    blocks: int
    max_iterations: int
    plan_reuse: int
    model: str

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Settings:
        """Settings from parameter values; what is missing has its default.

        Raises
        ------
        ValueError
            If a value is unknown or out of range, or if values contradict each other.
        """
        v = validate(load("fsw_nmpc", "nmpc.yaml"), values)
        if v["blocks"] not in BLOCKS:
            raise ValueError(f"blocks: {v['blocks']} must be {' or '.join(map(str, BLOCKS))}")
        for name in ("force", "speed"):
            if not v[f"{name}_min"] < v[f"{name}_max"]:
                raise ValueError(f"{name}_min must be below {name}_max")
        tuning = Tuning.preset(v["preset"])
        if v["corridor"] != "preset":
            tuning = replace(tuning, corridor=v["corridor"])
        return cls(
            tuning=replace(tuning, **_given(v, "", Tuning)),
            estimator=EstimatorTuning(**_given(v, "estimator.", EstimatorTuning)),
            limits=Limits(
                v["force_min"], v["force_max"], v["speed_min"], v["speed_max"], v["force_step"], v["speed_step"]
            ),
            solver=v["solver"],
            blocks=v["blocks"],
            max_iterations=v["max_iterations"],
            plan_reuse=v["plan_reuse"],
            model=v["model"],
        )


def _given(values: Mapping[str, Any], prefix: str, kind: type[Tuning] | type[EstimatorTuning]) -> dict[str, Any]:
    """The numbers among the fields of ``kind`` that are not left to the preset."""
    named = {field.name: values.get(prefix + field.name) for field in fields(kind)}
    return {name: value for name, value in named.items() if isinstance(value, float) and value >= 0.0}
