"""Requirements on figures of merit that are stored already: data of a report, not of the campaign."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf
from pathlib import Path

from fsw_campaign.errors import CampaignError
from fsw_control.ranges import Range
from fsw_plant.place import Place

_SHIPPED = Path(__file__).with_name("quality.yaml")
_NUMBER = Range(-1e12, 1e12, "")


@dataclass(frozen=True, slots=True)
class Requirement:
    """What a weld is asked for, in words and as bounds (low, high) of columns of the dataset."""

    words: str
    bounds: Mapping[str, tuple[float, float]]


def read(file: Path | None, columns: Sequence[str]) -> list[Requirement]:
    """Read a file of requirements, a list of ``words`` and ``limits``.

    Parameters
    ----------
    file : Path or None
        None: the shipped ones, as far as the campaign has their columns.
    columns : sequence of str
        Columns with numbers that there are.

    Raises
    ------
    CampaignError
        If it cannot be read or something in it is wrong.
    """
    shipped, file = file is None, file or _SHIPPED
    try:
        text = file.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise CampaignError(f"cannot read limits {file}: {getattr(error, 'strerror', 'not in UTF-8')}") from None
    at = Place(str(file), failure=CampaignError, whole="list of limits")
    found = []
    for i, entry in enumerate(at.list({"": at.yaml(text)}, "")):
        here = Place(str(file), f"[{i}]", CampaignError)
        here.keys(here.mapping(entry), ("words", "limits"), ("words", "limits"))
        limits = here.inside("limits").mapping(entry["limits"])
        bounds = {}
        for column, bound in limits.items():
            inside = here.inside(f"limits.{column}")
            if column not in columns and not shipped:
                raise inside.error(f"is no figure of this campaign; known: {', '.join(columns)}")
            inside.keys(inside.mapping(bound), ("min", "max"))
            low, high = (inside.optional(bound, key, _NUMBER) for key in ("min", "max"))
            bounds[str(column)] = -inf if low is None else low, inf if high is None else high
        if bounds.keys() <= set(columns):
            found.append(Requirement(" ".join(str(entry["words"]).split()), bounds))
    return found
