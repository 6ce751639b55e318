"""Whether a weld may be added to a heat profile: judged good, of the same type, tool and path."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import sqrt
from pathlib import Path

import numpy as np

from fsw.bags import data_sha256
from fsw_analysis.rules import Verdict
from fsw_analysis.weld_signals import WeldSignals
from fsw_control.coded import Worded
from fsw_control.schema.models import InputError, json_content_of, read_text
from fsw_model.heat_profile import HeatProfile
from fsw_recorder.bag_reader import SUFFIXES
from fsw_scenario.scenario_file import parse

#: what a weld of the same type has in common with the others, of what the recorder notes: not the
#: canister and the lid themselves, which have a number each, but what they are
TYPE = ("canister_type", "lid_type", "tool", "machine")
#: record that the recorder's procedure writes into a bag's folder
RECORD = Path("record") / "record.json"
#: a weld that lacks more than this many of the profile's deviations is of another type (chosen)
_STRANGE = 2.0


class Refusal(Worded):
    """Why a weld is not added."""

    KNOWN = "is in the profile already"
    NO_RECORD = "no record", "has no record by which it is accepted: {detail}"
    OTHER_RECORD = "other record", "{detail} is the record of another weld"
    NOT_ACCEPTED = "not accepted", "its record does not accept it, but says {detail}"
    IDENTITY = "is not of this type: {detail}"
    PATH = "is not of this type: its programme has another path, or none"
    HEAT = "is not of this type: its heat lacks {detail}"


class RefusedWeldError(InputError):
    """A weld that is not added; ``refusal`` says why."""

    def __init__(self, weld: str, refusal: Refusal, detail: object = "") -> None:
        super().__init__(f"{weld}: {refusal.words.format(detail=detail)}")
        self.refusal = refusal


def check_record(bag: Path, profile: HeatProfile) -> None:
    """Refuse a weld that the profile has already, or that its record does not accept."""
    if data_sha256(bag) in {source.sha256 for source in profile.welds}:
        raise RefusedWeldError(bag.name, Refusal.KNOWN)
    file = bag / RECORD
    if not file.is_file():
        raise RefusedWeldError(bag.name, Refusal.NO_RECORD, file)
    try:
        record = json_content_of(read_text(file, "record"), str(file))
        verdict, judged = str(record["verdict"]), {file["sha256"] for file in record["files"]}
    except (KeyError, TypeError):
        raise RefusedWeldError(bag.name, Refusal.NO_RECORD, file) from None
    data = {data_sha256(path) for path in bag.iterdir() if path.name.endswith(SUFFIXES)}
    if not data <= judged:
        raise RefusedWeldError(bag.name, Refusal.OTHER_RECORD, file)
    if verdict != Verdict.ACCEPT:
        raise RefusedWeldError(bag.name, Refusal.NOT_ACCEPTED, verdict)


def check_type(weld: WeldSignals, earlier: Sequence[WeldSignals]) -> None:
    """Refuse a weld of another canister, lid, tool, machine or path than an earlier one."""
    path = _path(weld)
    for other in earlier:
        for key in TYPE:
            if weld.custom.get(key) != other.custom.get(key):
                own, its = (bag.custom.get(key, "none") for bag in (weld, other))
                detail = f"{key} {own}, in {other.path.name} {its}"
                raise RefusedWeldError(weld.path.name, Refusal.IDENTITY, detail)
        if not path or path != _path(other):
            raise RefusedWeldError(weld.path.name, Refusal.PATH)


def _path(weld: WeldSignals) -> list[tuple[float, float, float]]:
    """Angles and length of each phase with travel."""
    text = weld.attachments.get("scenario.yaml", b"").decode(errors="replace")
    if not text:
        return []
    phases = parse(text, f"{weld.path}: scenario.yaml").phases
    return [(row.from_deg, row.to_deg, row.length_mm) for row in phases if row.length_mm > 0.0]


def check_heat(before: HeatProfile, after: HeatProfile) -> None:
    """Refuse a profile whose last weld is further from the others than the profile expects.

    Of the first weld, from what was computed.
    """
    weld, expected_kw = after.welds[-1], sqrt(float(np.mean(np.square(before.deviation_kw))))
    lacks_kw = weld.left_out_kw
    if lacks_kw is None:
        computed_kw = np.interp(after.travel_mm, before.travel_mm, before.heat_kw)
        lacks_kw = float(np.std(np.subtract(after.heat_kw, computed_kw)))
    if lacks_kw > _STRANGE * expected_kw:
        detail = f"{lacks_kw:.2f} kW of the others', expected {expected_kw:.2f}"
        raise RefusedWeldError(weld.weld, Refusal.HEAT, detail)


def earlier_bags(profile: HeatProfile, folder: Path, most: int) -> Mapping[str, Path]:
    """The bags of the profile's last welds, by their data's hash; InputError if one is missing.

    Without those that were computed.
    """
    made = [source for source in profile.welds if not source.computed]
    bags = {source: folder / source.weld for source in made[-most:]}
    lost = [
        source.weld
        for source, bag in bags.items()
        if not bag.exists() or data_sha256(bag) != source.sha256
    ]
    if lost:
        raise InputError(
            f"{folder}: the bags that {profile.type} was learned from are needed; "
            f"missing or changed: {', '.join(lost)}"
        )
    return {source.sha256: bag for source, bag in bags.items()}
