"""Reads a campaign file and checks all of it before anything runs."""

from __future__ import annotations

import copy
import hashlib
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fsw_analysis.weld_signals import TruthSignals
from fsw_campaign.distributions import SAMPLERS, Distribution, draw, values, weld_seed
from fsw_campaign.errors import CampaignError
from fsw_control.contract import Controller
from fsw_control.ranges import Range
from fsw_plant.event_schema import DURATION_S
from fsw_plant.place import Place
from fsw_scenario import scenario_file
from fsw_scenario.controllers import make_all, name_of, short, source_of
from fsw_scenario.scenario import Scenario, ScenarioError

_SHIPPED = Path(__file__).parent / "campaigns"
_KEYS = ("name", "description", "scenario", "controllers", "welds", "seed", "sampler", "distributions", "limits")
_LIMIT_KEYS = ("min", "max", "at_most_s")
#: signals that a limit may be for: errors against the set-points, and numbers of the truth
ERRORS = {"depth_error_mm": "depth_mm", "temperature_error_c": "temperature_c"}
SIGNALS = (*ERRORS, *(one.name for one in fields(TruthSignals) if re.search(r"_(mm|c|kn|rpm|nm|kw)$", one.name)))
_WELDS = Range(1, 10_000_000, "welds")
_SEED = Range(0, 2**32 - 1, "")
_NUMBER = Range(-1e9, 1e9, "")


@dataclass(frozen=True, slots=True)
class Limit:
    """A weld is inside while the signal is, but for ``at_most_s`` in total; None: no bound."""

    signal: str
    low: float | None
    high: float | None
    at_most_s: float


@dataclass(frozen=True, slots=True)
class Entrant:
    """A controller of the campaign: what rows call it, its label and its parameters, as of ``controllers.make``."""

    label: str
    controller: str
    parameters: Mapping[str, Any]

    @property
    def name(self) -> str:
        """Name without variant."""
        return name_of(self.controller)


@dataclass(frozen=True)
class Campaign:
    """A scenario, controllers, and distributions of the scenario's parameters.

    Attributes
    ----------
    name, description : str
    scenario : dict
        Content of the scenario file.
    entrants : tuple of Entrant
    welds : int
        Of each controller; weld ``i`` has the same plant and the same noise under all controllers.
    seed : int
    sampler : str
        One of ``SAMPLERS``.
    distributions : tuple of Distribution
    limits : tuple of Limit
        Of a good weld.
    """

    name: str
    description: str
    scenario: dict[str, Any]
    entrants: tuple[Entrant, ...]
    welds: int
    seed: int
    sampler: str
    distributions: tuple[Distribution, ...]
    limits: tuple[Limit, ...]
    text: str

    @property
    def digest(self) -> str:
        """Digest of all that decides the results, users' controllers included, but for our software."""
        own = (source_of(one.controller) for one in self.entrants)
        return hashlib.sha256(b"".join([self.text.encode(), *own])).hexdigest()[:16]

    @cached_property
    def shares(self) -> NDArray[np.float64]:
        """Points of the sampler, shape (welds, number of distributions)."""
        return draw(self.distributions, self.welds, self.seed, self.sampler)

    def parameters(self, index: int) -> dict[str, Any]:
        """Values of a weld, by path in the scenario: those drawn, and the seed of the noise unless it is drawn."""
        return {"plant.seed": weld_seed(self.seed, index), **values(self.distributions, self.shares[index].tolist())}

    def weld(self, parameters: Mapping[str, Any], entrant: Entrant) -> Scenario:
        """Scenario of a weld.

        Raises
        ------
        ScenarioError
            If it is not a valid one.
        """
        content = copy.deepcopy(self.scenario)
        for path, value in {**parameters, "controller": entrant.name}.items():
            scenario_file.put(content, path, value, "distributions")
        return scenario_file.read(content, self.name)

    def controllers(self, scenario: Scenario, entrant: Entrant) -> dict[str, Controller]:
        """Make the controllers of a weld, by name.

        Raises
        ------
        ScenarioError
            If one is not known or refuses its parameters.
        """
        return make_all(scenario, entrant.controller, {entrant.name: entrant.parameters})


def shipped() -> list[str]:
    """Names of the campaigns that come with the package."""
    return sorted(path.stem for path in _SHIPPED.glob("*.yaml"))


def load(source: str | Path, welds: int | None = None) -> Campaign:
    """Read a campaign.

    Parameters
    ----------
    source : str or Path
        Path of a YAML file, or the name of a shipped campaign. The scenario in it is a name, a path relative to the
        file, or a scenario itself.
    welds : int, optional
        Instead of the file's.

    Raises
    ------
    CampaignError
        If there is no such campaign or something in it is wrong.
    """
    file = Path(source)
    if str(source) in shipped() and not file.is_file():
        file = _SHIPPED / f"{source}.yaml"
    try:
        content = Place(str(source), failure=CampaignError).yaml(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise CampaignError(
            f"cannot read campaign {source}: {error.strerror}; give a YAML file or one of {', '.join(shipped())}"
        ) from None
    except UnicodeDecodeError:
        raise CampaignError(f"cannot read campaign {source}: not a text file in UTF-8") from None
    if isinstance(content, dict) and welds is not None:
        content["welds"] = welds
    if isinstance(content, dict) and isinstance(content.get("scenario"), str):
        name = content["scenario"]
        beside = file.parent / name
        try:
            text = scenario_file.text_of(beside if beside.is_file() else name)
            content["scenario"] = scenario_file.content_of(text, name)
        except ScenarioError as error:
            raise CampaignError(f"{source}: {error}") from None
    return read(content, str(source))


def read(content: Any, where: str = "campaign") -> Campaign:
    """Read a campaign from the content of a file, its scenario included; errors as :func:`load`."""
    at = Place(where, failure=CampaignError, whole="campaign")
    if not isinstance(content, dict):
        raise CampaignError(f"{where}: a campaign is a mapping with {', '.join(_KEYS)}; see the shipped ones")
    at.keys(content, _KEYS, required=("name", "scenario", "controllers", "welds"))
    sampler = content.setdefault("sampler", "latin_hypercube")
    numbers = {"welds": at.number(content, "welds", _WELDS), "seed": at.number(content, "seed", _SEED, 1)}
    for key, value in numbers.items():
        if value != int(value):
            raise at.inside(key).error(f"is {value:g}, not a whole number")
    drawn = at.mapping(content.get("distributions") or {})
    limits = at.mapping(content.get("limits") or {})
    campaign = Campaign(
        name=at.word(content, "name"),
        description=" ".join(str(content.get("description", "")).split()),
        scenario=at.inside("scenario").mapping(content["scenario"]),
        entrants=_entrants(at.list(content, "controllers"), at.inside("controllers")),
        welds=int(numbers["welds"]),
        seed=int(numbers["seed"]),
        sampler=at.choice({"sampler": sampler}, "sampler", SAMPLERS),
        distributions=tuple(
            Distribution.read(str(path), entry, at.inside(f"distributions.{path}")) for path, entry in drawn.items()
        ),
        limits=tuple(_limit(str(signal), entry, at.inside(f"limits.{signal}")) for signal, entry in limits.items()),
        text=json.dumps(content, allow_nan=False),
    )
    _check(campaign, at)
    return campaign


def _entrants(entries: list[Any], at: Place) -> tuple[Entrant, ...]:
    found = []
    for i, entry in enumerate(entries):
        here = at.inside(f"[{i}]")
        entry = {"controller": entry} if isinstance(entry, str) else here.mapping(entry)
        here.keys(entry, ("controller", "parameters", "label"), required=("controller",))
        controller = str(entry["controller"])
        parameters = here.inside("parameters").mapping(entry.get("parameters") or {})
        try:
            label = str(entry.get("label", short(controller)))
        except ScenarioError as error:
            raise here.error(f"cannot be: {error}") from None
        found.append(Entrant(label, controller, parameters))
    labels = [one.label for one in found]
    if not labels or len(set(labels)) < len(labels):
        raise at.error("needs at least one controller, and a label of its own for each")
    return tuple(found)


def _limit(signal: str, entry: Any, at: Place) -> Limit:
    if signal not in SIGNALS:
        raise at.error(f"is for no known signal; known: {', '.join(SIGNALS)}")
    at.keys(at.mapping(entry), _LIMIT_KEYS)
    low, high = at.optional(entry, "min", _NUMBER), at.optional(entry, "max", _NUMBER)
    if (low is None and high is None) or (low is not None and high is not None and low >= high):
        raise at.error("needs min or max, and min below max")
    return Limit(signal, low, high, at.number(entry, "at_most_s", Range(0.0, DURATION_S.high, "s"), 0.0))


def _check(campaign: Campaign, at: Place) -> None:
    """Make the first weld of every controller, and one with each extreme value of each distribution."""
    try:
        base = scenario_file.read(copy.deepcopy(campaign.scenario), "scenario")
        if base.open_loop:
            raise CampaignError(f"{at.where}: scenario {base.name} is open-loop; a campaign is about controllers")
        for entrant in campaign.entrants:
            campaign.controllers(campaign.weld({}, entrant), entrant)
    except ScenarioError as error:
        raise CampaignError(f"{at.where}: {error}") from None
    for one in campaign.distributions:
        if one.path.partition(".")[0] in ("name", "description", "controller", "figures"):
            raise at.inside(f"distributions.{one.path}").error("is no parameter of the weld")
        for value in one.extremes:
            try:
                campaign.weld({one.path: value}, campaign.entrants[0])
            except ScenarioError as error:
                raise at.inside(f"distributions.{one.path}").error(f"= {value!r} cannot be: {error}") from None
