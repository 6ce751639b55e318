"""The rules of a judgement as facts: requirement, finding, and the one table of their texts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from enum import StrEnum
from typing import Annotated, Any

from pydantic import Field, Strict

from fsw_analysis.rule_book import SWAPS, Bounds
from fsw_control.coded import Worded
from fsw_control.schema.models import Many, Model


class Verdict(StrEnum):
    """Disposition of the weld, the best first."""

    ACCEPT = "accept"
    REVIEW = "review"
    REJECT = "reject"


_ORDER = list(Verdict)


_ABSENT = "({topic} is not in the bag)"


class FactCode(Worded):
    """Findings of the rules, unknowns, and integrity of the bag."""

    NOT_ON_RECORD = "not_on_record", "not on record"
    RULES = "rules", "{count} rules"
    # complete
    ENDED = "ended", "the weld was {state}"
    NO_END = "no_end", "the end of the weld is not on record"
    NO_PHASE = (
        "no_phase",
        "no phase of the procedure took place; phases on record: {phases}",
    )
    PHASES = "phases", "phases on record: {phases}"
    ANGLE_UNKNOWN = "angle_unknown", "{phase}: angle not on record"
    BEGINS = "begins", "{phase} begins at {angle_deg:.1f} instead of {from_deg:g} deg"
    REACHES = "reaches", "{phase} reaches {angle_deg:.1f} of {to_deg:g} deg"
    LASTS = "lasts", "{phase} lasts {time_s:.1f} of {duration_s:g} s"
    # recording
    PROBLEM = "problem", "{problem}"
    LOST_UNKNOWN = "lost_unknown", "whether messages were lost is not on record"
    LOST = "lost", "{count} messages lost"
    GAPS = "gaps", "{count} gaps, longest {longest_s:.1f} s"
    # limits
    OUTSIDE = "outside", "{often}, {time_s:.1f} s, {share:.2%}, longest {longest_s:.1f} s"
    LENGTH = "length", "over {length_mm:.1f} mm"
    BEYOND = "beyond", "by up to {beyond:.4g}"
    MISSING = "missing", "{count} samples missing"
    # equipment
    WELDED_BY = "welded_by", "{procedure} revision {revision}, SHA-256 {sha256:.12}…"
    UNUSABLE = "unusable", "{count} {flaw}"
    DAY_UNKNOWN = "day_unknown", "the day of the weld is not known (simulated time)"
    WELDED_ON = "welded_on", "welded on {day}"
    COMMANDED = "commanded", "{controller} {time_s:.1f} s"
    NO_COMMAND = "no_command", "not on record {time_s:.1f} s"
    TUNING = "tuning", "{sha256:.12}…"
    NAME = "name", "{name}"
    USED = "used", "{used_mm:.0f} mm with this weld"
    USE_UNKNOWN = "use_unknown", "use before this weld is not on record"
    # course of the weld
    HELD = "held", "{often}, {time_s:.1f} s"
    SWAPS = "swaps", "{count} swaps, {unwanted} not on request"
    CAUSE_UNKNOWN = "cause_unknown", "{count} of a cause that is not on record"
    IN_MODE = "in_mode", "{mode} {time_s:.1f} s"
    MODE_UNKNOWN = "mode_unknown", "not on record at {ticks} ticks"
    TRIPPED = "tripped", "interlock {interlock}, {state}"
    # unknowns of a weld
    NO_STATES = "no_states", f"swaps, modes and interlocks {_ABSENT}"
    NO_PROGRESS = "no_progress", f"phases, angles and positions along the weld {_ABSENT}"
    NO_DRIVES = "no_drives", f"force and speed as the drives measure them {_ABSENT}"
    NO_MONITOR = "no_monitor", f"what a monitor would have found: none was recorded {_ABSENT}"
    NO_ALARMS = (
        "no_alarms",
        "whether there were alarms: the operator's page, which reports them, "
        f"was not recorded {_ABSENT}",
    )
    DAMAGE = "damage", "{problem}: what was there is not known"
    MACHINE_NOT_COMPARED = (
        "machine_not_compared",
        "whether it was the machine of the procedure, {id}: none was given to the recorder",
    )
    NOT_GIVEN = "not_given", "{keys}: not given to the recorder (parameter custom_data)"
    NO_VERSIONS = "no_versions", "software versions (versions.json is not in the bag)"
    NO_PROCEDURE = (
        "no_procedure",
        "by which procedure the weld ran (none is attached to the bag, nor reported by {node})",
    )
    # integrity of the bag
    UNPROVEN = "unproven", "no {file}: whether the files are what was recorded is not known"
    NOT_AS_LISTED = "not_as_listed", "not as {file} has it: {problem}"
    AS_LISTED = "as_listed", "{count} files as {file} has them"
    LISTED_LATER = "listed_later", "{count} files as {file} has them, hashed after the recording"
    SIGNATURE_UNCHECKED = (
        "signature_unchecked",
        "the signature of {file} cannot be checked: {problem}",
    )
    SIGNATURE_INVALID = "signature_invalid", "the signature of {file} is not valid: {problem}"
    SIGNED = "signed", "{file} signed by {signer}"
    UNSIGNED = "unsigned", "{file} is not signed"


#: by name of a rule, its requirement, and the text without findings
_WORDS = {
    "all": ("every rule is kept", ""),
    "complete": ("{programme}", "all"),
    "recording": ("bag intact, without gaps", "intact"),
    "procedure": ("welded by {procedure} revision {revision}, SHA-256 {sha256:.12}…", ""),
    "sensor": ("{subject} on record and usable{due}", "yes"),
    "controller": ("commands of {controllers} only", ""),
    "tuning": ("{subject}: parameters {sha256:.12}…", ""),
    "tool": ("tool {id}", ""),
    "machine": ("{id}", ""),
    "tool_life": ("tool used for at most {life_mm:g} mm", ""),
    "hold": ("programme held for at most {limit_s:g} s", "never"),
    "swaps": ("{permitted}", ""),
    "mode": ("auto throughout", "yes"),
    "interlocks": ("no trip", "none"),
    "essential": ("{limit}", "always inside"),
    "quality": ("{limit}", "always inside"),
    "set-point": ("{limit}", "always inside"),
}


class Fact(Model):
    """A finding of a rule: a code with its fields."""

    code: Annotated[FactCode, Strict(False)]
    data: dict[str, Any] = Field(default_factory=dict)

    @classmethod
    def of(cls, code: FactCode, **data: Any) -> Fact:
        """Return the fact with these fields."""
        return cls(code=code, data=data)

    @property
    def words(self) -> str:
        """The fact in words."""
        return self.code.words.format_map(_plain(self.data))


class Rule(Model):
    """A rule, its findings in this weld, and the disposition that follows from it alone."""

    name: str
    subject: str = ""
    """its subject: a variable, a sensor, a controller; empty if there is only one"""
    data: dict[str, Any] = Field(default_factory=dict)
    """the requirement: limits, names, hashes"""
    facts: Many[Fact] = ()
    """the findings"""
    verdict: Annotated[Verdict, Strict(False)]

    @property
    def words(self) -> str:
        """The requirement, in words."""
        data = _plain(self.data) | _derived(self.name, self.data)
        return _WORDS[self.name][0].format_map(data | {"subject": self.subject})

    @property
    def figure(self) -> str:
        """The findings, in words."""
        return "; ".join(fact.words for fact in self.facts) or _WORDS[self.name][1]


def decide(rules: Sequence[Rule]) -> Rule:
    """First rule with the worst verdict; for an accepted weld, that all rules are kept."""
    deciding = max(rules, key=lambda rule: _ORDER.index(rule.verdict))
    if deciding.verdict is not Verdict.ACCEPT:
        return deciding
    count = Fact.of(FactCode.RULES, count=len(rules))
    return Rule(name="all", facts=(count,), verdict=Verdict.ACCEPT)


def _derived(name: str, data: Mapping[str, Any]) -> dict[str, str]:
    """Parts of the text that depend on the given fields."""
    if name == "complete":
        phases = ", ".join(data["phases"])
        return {"programme": f"phases {phases}" if phases else "the programme"}
    if name == "sensor":
        due = data.get("calibration_due")
        return {"due": f", calibrated until {due}" if due else ""}
    if name == "swaps":
        return {"permitted": SWAPS[data["on_request"]]}
    return {"limit": Bounds(**data).words} if "variable" in data else {}


def _plain(data: Mapping[str, Any]) -> dict[str, Any]:
    plain = {
        key: (", ".join(item) or "none") if isinstance(item, list) else item
        for key, item in data.items()
    }
    if "times" in data:
        plain["often"] = "once" if data["times"] == 1 else f"{data['times']} times"
    return plain
