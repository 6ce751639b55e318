"""Reads a campaign file and checks all of it before anything runs."""

from __future__ import annotations

import copy
import hashlib
import re
from collections.abc import Mapping, Sequence
from dataclasses import fields
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field, WithJsonSchema, model_validator

from fsw_analysis.procedure import Procedure
from fsw_analysis.rule_book import RuleBook, default
from fsw_analysis.weld_signals import TruthSignals
from fsw_campaign.distributions import Distribution, Sampler, draw, values, weld_seed
from fsw_control.contract import Controller
from fsw_control.schema.models import (
    InputError,
    Many,
    Model,
    Name,
    Whole,
    content_of,
    needs_one,
    read_text,
    shipped_names,
    validate,
)
from fsw_control.schema.ranges import Range
from fsw_plant.event_schema import TIME_S
from fsw_recorder.signature import Purpose, TrustedKey, signer_of
from fsw_scenario import scenario_file
from fsw_scenario.controllers import make_all, name_of, short, source_of
from fsw_scenario.scenario import Scenario

_SHIPPED = Path(__file__).parent / "campaigns"
#: keys of a scenario that are not parameters of the weld
_NOT_DRAWN = ("name", "description", "controller", "figures")
#: signals that a limit may be for: errors against the set-points, and numbers of the truth
ERRORS = {"depth_error_mm": "depth_mm", "temperature_error_c": "temperature_c"}
SIGNALS = (
    *ERRORS,
    *(row.name for row in fields(TruthSignals) if re.search(r"_(mm|c|kn|rpm|nm|kw)$", row.name)),
)


def _signal(name: str) -> str:
    if name not in SIGNALS:
        raise ValueError(f"is not a signal; known: {', '.join(SIGNALS)}")
    return name


class Bounds(Model):
    """Bounds of a number; at least one."""

    min: float | None = None
    max: float | None = None

    @model_validator(mode="after")
    def _check_order(self) -> Bounds:
        if self.min is not None and self.max is not None and self.min >= self.max:
            raise ValueError("needs min below max")
        return needs_one(self, "min", "max")

    def hold(self, numbers: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether each number is inside; NaN is not."""
        low, high = (
            -np.inf if self.min is None else self.min,
            np.inf if self.max is None else self.max,
        )
        return np.asarray((numbers >= low) & (numbers <= high))


class Limit(Bounds):
    """Bounds of a signal.

    A weld is inside if the signal is outside them for at most ``at_most_s`` in total.
    """

    at_most_s: Annotated[float, TIME_S] = 0.0


class Entrant(Model):
    """A controller of the campaign, or its name alone."""

    controller: str
    """as for `--controller`"""
    parameters: dict[str, Any] = {}
    label: str = ""
    """name in the rows; default: the controller's name"""

    @model_validator(mode="before")
    @classmethod
    def _read(cls, content: Any) -> Any:
        content = {"controller": content} if isinstance(content, str) else content
        if isinstance(content, dict) and isinstance(content.get("controller"), str):
            return {"label": short(content["controller"]), **content}
        return content

    @property
    def name(self) -> str:
        """Name without variant."""
        return name_of(self.controller)


def _or_name(schema: dict[str, Any]) -> None:
    schema["items"] = {"anyOf": [{"type": "string"}, schema["items"]]}


#: a name or path, or the thing itself
_NAMED = WithJsonSchema({"anyOf": [{"type": "string"}, {"type": "object"}]})


class Campaign(Model):
    """A scenario, controllers, and distributions of the scenario's parameters."""

    name: Name
    description: Annotated[str, AfterValidator(lambda text: " ".join(text.split()))] = ""
    scenario: Annotated[dict[str, Any], _NAMED]
    """name or path of a scenario, or a scenario itself"""
    entrants: Annotated[
        Many[Entrant], Field(min_length=1, alias="controllers", json_schema_extra=_or_name)
    ]
    welds: Annotated[Whole, Range(1, 10_000_000, "welds")]
    """of each controller; weld ``i`` has the same plant and the same noise under all
    controllers"""
    seed: Annotated[Whole, Range(0, 2**32 - 1, "")] = 1
    sampler: Sampler = "latin_hypercube"
    distributions: dict[str, Distribution] = {}
    """by path in the scenario file, e.g. ``plant.factors.copper_lag_s``"""
    limits: dict[Annotated[str, AfterValidator(_signal)], Limit] = {}
    """of a good weld"""
    procedure: Annotated[dict[str, Any] | None, _NAMED] = None
    """by which the welds are judged: path of a procedure, or a procedure itself; left out: by the
    default rules"""

    @model_validator(mode="after")
    def _check(self) -> Campaign:
        assert self.book
        if len({entrant.label for entrant in self.entrants}) < len(self.entrants):
            raise ValueError("needs a different label for each controller")
        for path in self.distributions:
            if path.partition(".")[0] in _NOT_DRAWN:
                raise ValueError(f"distributions.{path} is not a parameter of the weld")
        return self

    @property
    def text(self) -> str:
        """The campaign as JSON, which :func:`read` takes."""
        return self.model_dump_json(by_alias=True)

    @property
    def digest(self) -> str:
        """Digest of all that decides the results, users' controllers too, but this software."""
        own = (source_of(entrant.controller) for entrant in self.entrants)
        return hashlib.sha256(b"".join([self.text.encode(), *own])).hexdigest()[:16]

    @cached_property
    def book(self) -> RuleBook:
        """By what the welds are judged; InputError if the procedure is not a valid one."""
        return (
            default()
            if self.procedure is None
            else validate(Procedure, self.procedure, "procedure")
        )

    @cached_property
    def shares(self) -> NDArray[np.float64]:
        """Points of the sampler, shape (welds, number of distributions)."""
        return draw(len(self.distributions), self.welds, self.seed, self.sampler)

    def parameters(self, index: int) -> dict[str, Any]:
        """Values of a weld, by path in the scenario.

        Those drawn, and the seed of the noise unless it is drawn.
        """
        return {
            "plant.seed": weld_seed(self.seed, index),
            **values(self.distributions, self.shares[index]),
        }

    def weld(self, parameters: Mapping[str, Any], entrant: Entrant) -> Scenario:
        """Scenario of a weld; InputError if it is not a valid one."""
        content = copy.deepcopy(self.scenario)
        for path, value in {**parameters, "controller": entrant.name}.items():
            scenario_file.put(content, path, value, "distributions")
        return scenario_file.read(content, self.name)

    def controllers(self, scenario: Scenario, entrant: Entrant) -> dict[str, Controller]:
        """Make the controllers of a weld, by name.

        InputError if one is not known or refuses its parameters.
        """
        return make_all(scenario, entrant.controller, {entrant.name: entrant.parameters})


def shipped() -> list[str]:
    """Names of the campaigns that come with the package."""
    return shipped_names(_SHIPPED)


def load(
    source: str | Path,
    welds: int | None = None,
    trusted: Sequence[TrustedKey] | None = None,
    require_signed: bool = False,
) -> Campaign:
    """Read a campaign.

    Parameters
    ----------
    source : str or Path
        Path of a YAML file, or the name of a shipped campaign. The scenario in it is a name, a
        path relative to the file, or a scenario itself, and so is the procedure, which has no
        name.
    welds : int, optional
        Instead of the file's.
    trusted : sequence of TrustedKey, optional
        Keys whose signatures of the procedure count; without them any will do.
    require_signed : bool
        Refuse a procedure that nobody signed.

    Raises
    ------
    fsw_control.schema.models.InputError
        If there is no such campaign, something in it is wrong, or its procedure is not signed as
        it has to be.
    """
    content = content_of(read_text(source, "campaign", _SHIPPED), str(source))
    if isinstance(content, dict):
        if welds is not None:
            content["welds"] = welds
        if isinstance(name := content.get("scenario"), str):
            beside = Path(source).parent / name
            text = scenario_file.text_of(beside if beside.is_file() else name)
            content["scenario"] = scenario_file.content_of(text, name)
        if isinstance(name := content.get("procedure"), str):
            path = Path(source).parent / name
            signer_of(path, Purpose.PROCEDURE, trusted, require_signed)
            content["procedure"] = content_of(read_text(path, "procedure"), name)
        elif require_signed:
            raise InputError(
                f"{source}: has no procedure in a file of its own, which could be signed"
            )
    return read(content, str(source))


def read(content: Any, where: str = "campaign") -> Campaign:
    """Read a campaign from the content of a file, its scenario included.

    Errors as :func:`load`.
    """
    campaign = validate(Campaign, content, where)
    _check_welds(campaign, where)
    return campaign


def _check_welds(campaign: Campaign, where: str) -> None:
    """Make the first weld of every controller, and one with each extreme of each distribution."""
    base = scenario_file.read(copy.deepcopy(campaign.scenario), f"{where}: scenario")
    if base.open_loop:
        raise InputError(
            f"{where}: scenario {base.name} is open-loop; a campaign needs a closed-loop one"
        )
    try:
        for entrant in campaign.entrants:
            campaign.controllers(campaign.weld({}, entrant), entrant)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None
    for path, distribution in campaign.distributions.items():
        for value in distribution.extremes:
            try:
                campaign.weld({path: value}, campaign.entrants[0])
            except InputError as error:
                raise InputError(
                    f"{where}: distributions.{path} = {value!r} cannot be: {error}"
                ) from None
