"""From figures beyond their limits to causes, in the operator's words, and how sure each is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files
from typing import Any, Literal

from fsw_schema.models import Many, Model
from fsw_schema.yaml_text import load_yaml

#: a residual below this share of its limit is exonerated: it fits
EXONERATED = 0.5
#: the figures of the residuals
RESIDUALS = {"torque": "drift_torque", "depth": "drift_depth", "heat": "drift_heat"}
#: figures that follow from another cause, by the begin of the names: they tell nothing beside one
_FOLLOWS = ("innovation", "movement", "poor_control")
#: gains are wrong while a sensor drifts, and less sure than they seem while its noise has grown
_GAINS = ("gain", "dead_time")

Answer = Literal["yes", "no", "any"]


class _Text(Model):
    cause: str
    advice: str


class _Pattern(_Text):
    residuals: dict[str, Answer]
    kind: str


class _Texts(Model):
    patterns: Many[_Pattern]
    figures: dict[str, _Text]


class Limits(Model):
    """Limits of the figures on a process."""

    limits: dict[str, float]
    known_heat: bool
    """whether the model says how much power holds a temperature, so that the heat's residual tells causes apart"""


@dataclass(frozen=True, slots=True)
class Finding:
    """An alarm of the monitor."""

    kind: str  #: of the cause: short, stable
    cause: str
    advice: str
    confidence: float  #: 0.5 at the limit, towards 1 far beyond it, shared between the causes that are named
    figure: str  #: the figure that is furthest beyond its limit
    value: float
    limit: float

    @property
    def of_sensor(self) -> bool:
        """Whether a measurement is blamed, so that what is computed from it is wrong, too."""
        return self.kind.endswith(("sensor", "thermocouple"))


def _content(name: str) -> Any:
    return load_yaml(files("fsw_quality").joinpath(name).read_text(encoding="utf-8"))


_TEXTS = _Texts.model_validate(_content("monitor_texts.yaml"))


def load_limits() -> dict[str, Limits]:
    """The limits of all processes, from ``monitor_limits.yaml``."""
    return {name: Limits.model_validate(one) for name, one in _content("monitor_limits.yaml").items()}


def diagnose(
    figures: Mapping[str, float], limits: Limits, active: Mapping[str, bool], words: Mapping[str, float]
) -> list[Finding]:
    """Findings of the figures whose alarm is ``active``; ``words`` has numbers for the texts."""
    ratios = {name: value / limits.limits[name] for name, value in figures.items() if name in limits.limits}
    beyond = {name for name in ratios if active.get(name)}
    found = []
    if residuals := beyond & set(RESIDUALS.values()):
        found.append(_of_residuals(residuals, ratios, figures, limits, words))
    if any(one.of_sensor for one in found) or any(name.startswith("noise_grown") for name in beyond):
        beyond = {name for name in beyond if not name.startswith(_GAINS)}
    rest = sorted(beyond - residuals, key=lambda name: -ratios[name])
    own = [name for name in rest if not name.startswith(_FOLLOWS)]
    for name in own if found or own else rest[:1]:
        found.append(_of_figure(name, ratios[name], figures[name], limits.limits[name], words))
    return found


def _of_residuals(
    beyond: set[str],
    ratios: Mapping[str, float],
    figures: Mapping[str, float],
    limits: Limits,
    words: Mapping[str, float],
) -> Finding:
    """The cause whose pattern the residuals have; a residual between exonerated and beyond fits both ways."""
    told = {name: "yes" if figure in beyond else "no" for name, figure in RESIDUALS.items()}
    if not limits.known_heat:
        del told["heat"]

    def fits(pattern: _Pattern) -> bool:
        return all(answer in ("any", told.get(name)) for name, answer in pattern.residuals.items())

    pattern = next((one for one in _TEXTS.patterns if fits(one)), _TEXTS.patterns[-1])
    figure = max(beyond, key=lambda name: ratios[name])
    unsure = "any" in pattern.residuals.values()
    others = [name for name in RESIDUALS.values() if name not in beyond]
    doubtful = sum(unsure or ratios.get(name, EXONERATED) >= EXONERATED for name in others)
    causes = 1 + doubtful + pattern.cause.count(", or ")
    return Finding(
        pattern.kind,
        pattern.cause.format(**words),
        pattern.advice,
        _sureness(ratios[figure]) / causes,
        figure,
        figures[figure],
        limits.limits[figure],
    )


def _of_figure(name: str, ratio: float, value: float, limit: float, words: Mapping[str, float]) -> Finding:
    key, part = (name, "") if name in _TEXTS.figures else name.rsplit("_", 1)
    text = _TEXTS.figures[key]
    numbers = dict(words)
    if f"period_{part}" in words:
        numbers["period"] = words[f"period_{part}"]
    said = {"name": part, "value": value}
    return Finding(
        name,
        text.cause.format(**numbers, **said),
        text.advice.format(**numbers, **said),
        _sureness(ratio),
        name,
        value,
        limit,
    )


def _sureness(ratio: float) -> float:
    return 1.0 - 0.5 / max(ratio, 1.0)
