"""The rules of a judgement as facts: requirement, finding, and the one table of their texts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from enum import StrEnum
from typing import Annotated, Any

from pydantic import Field, Strict

from fsw_analysis.rule_book import SWAPS, Bounds
from fsw_control.coded import Worded
from fsw_control.schema.models import Many, Model
from fsw_control.sensors import SENSORS


class Verdict(StrEnum):
    """Disposition of the weld, the best first."""

    ACCEPT = "accept"
    REVIEW = "review"
    REJECT = "reject"


_ORDER = list(Verdict)


_ABSENT = "({topic} is not in the bag)"


class FactCode(Worded):
    """Findings of the rules, unknowns, and integrity of the bag."""

    NOT_ON_RECORD = "not on record"
    RULES = "{count} rule{s}"
    # complete
    ENDED = "the weld was {state}"
    NO_END = "the end of the weld is not on record"
    NO_PHASE = "no phase of the procedure took place; phases on record: {phases}"
    PHASES = "phases on record: {phases}"
    ANGLE_UNKNOWN = "{phase}: angle not on record"
    BEGINS = "{phase} begins at {angle_deg:.1f} instead of {from_deg:g} deg"
    REACHES = "{phase} reaches {angle_deg:.1f} of {to_deg:g} deg"
    LASTS = "{phase} lasts {time_s:.1f} of {duration_s:g} s"
    # recording
    PROBLEM = "{problem}"
    LOST_UNKNOWN = "whether messages were lost is not on record"
    LOST = "{count} message{s} lost"
    GAPS = "{count} gap{s}, longest {longest_s:.1f} s"
    # limits
    OUTSIDE = "{often}, {time_s:.1f} s, {share:.2%}, longest {longest_s:.1f} s"
    LENGTH = "over {length_mm:.1f} mm"
    BEYOND = "by up to {beyond:.4g}"
    MISSING = "{count} sample{s} missing"
    # equipment
    WELDED_BY = "{procedure} revision {revision}, SHA-256 {sha256:.12}…"
    UNUSABLE = "{count} {flaw}"
    DAY_UNKNOWN = "the day of the weld is not known (simulated time)"
    WELDED_ON = "welded on {day}"
    COMMANDED = "{controller} {time_s:.1f} s"
    NO_COMMAND = "not on record {time_s:.1f} s"
    TUNING = "{sha256:.12}…"
    NAME = "{name}"
    USED = "{used_mm:.0f} mm with this weld"
    USE_UNKNOWN = "use before this weld is not on record"
    # course of the weld
    HELD = "{often}, {time_s:.1f} s"
    SWAPS = "{count} swap{s}, {unwanted} not on request"
    CAUSE_UNKNOWN = "{count} of a cause that is not on record"
    IN_MODE = "{mode} {time_s:.1f} s"
    MODE_UNKNOWN = "not on record at {ticks} ticks"
    TRIPPED = "interlock {interlock}, {state}"
    # unknowns of a weld
    NO_STATES = f"swaps, modes and interlocks {_ABSENT}"
    NO_PROGRESS = f"phases, angles and positions along the weld {_ABSENT}"
    NO_DRIVES = f"force and speed as the drives measure them {_ABSENT}"
    NO_MONITOR = f"what a monitor would have found: none was recorded {_ABSENT}"
    NO_ALARMS = (
        "whether there were alarms: the operator's page, which reports them, "
        f"was not recorded {_ABSENT}"
    )
    DAMAGE = "{problem}: what was there is not known"
    MACHINE_NOT_COMPARED = (
        "whether it was the machine of the procedure, {id}: none was given to the recorder"
    )
    NOT_GIVEN = "{keys}: not given to the recorder (parameter custom_data)"
    NO_VERSIONS = "software versions (versions.json is not in the bag)"
    NO_PROCEDURE = (
        "by which procedure the weld ran (none is attached to the bag, nor reported by {node})"
    )
    # integrity of the bag
    UNPROVEN = "no {file}: whether the files are what was recorded is not known"
    NOT_AS_LISTED = "not as {file} has it: {problem}"
    AS_LISTED = "{count} files as {file} has them"
    LISTED_LATER = "{count} files as {file} has them, hashed after the recording"
    SIGNATURE_UNCHECKED = "the signature of {file} cannot be checked: {problem}"
    SIGNATURE_INVALID = "the signature of {file} is not valid: {problem}"
    SIGNED = "{file} signed by {signer}"
    UNSIGNED = "{file} is not signed"


#: by name of a rule: title where it decides, requirement, and figure without findings
_WORDS = {
    "all": ("good", "every rule is kept", ""),
    "complete": ("programme not completed", "{programme}", "all"),
    "recording": ("record incomplete", "bag intact, without gaps", "intact"),
    "procedure": (
        "welded by another procedure",
        "welded by {procedure} revision {revision}, SHA-256 {sha256:.12}…",
        "",
    ),
    "sensor": (
        "sensor {subject} not usable throughout",
        "{subject} on record and usable{due}",
        "yes",
    ),
    "controller": (
        "commands from a source that is not permitted",
        "commands of {controllers} only",
        "",
    ),
    "tuning": (
        "controller {subject} with another tuning",
        "{subject}: parameters {sha256:.12}…",
        "",
    ),
    "tool": ("another tool than specified", "tool {id}", ""),
    "machine": ("another machine than specified", "{id}", ""),
    "tool_life": ("tool beyond its life", "tool used for at most {life_mm:g} mm", ""),
    "hold": ("programme held too long", "programme held for at most {limit_s:g} s", "never"),
    "swaps": ("controller changed", "{permitted}", ""),
    "mode": ("not in automatic control throughout", "auto throughout", "yes"),
    "interlocks": ("interlock tripped", "no trip", "none"),
    "essential": ("{variable} beyond an essential limit", "{limit}", "always inside"),
    "quality": ("{variable} outside its quality limit", "{limit}", "always inside"),
    "set-point": ("{variable} outside the permitted range", "{limit}", "always inside"),
}
_NOT_THROUGHOUT = "{variable} not on record throughout"
VARIABLES = {
    **{row.signal: row.label.lower() for row in SENSORS.values()},
    "force_kn": "force",
    "speed_rpm": "speed",
    "power_kw": "power",
    "traverse_mm_per_min": "traverse speed",
    "depth_error_mm": "depth error",
    "temperature_error_c": "temperature error",
    "set_point_depth_mm": "set-point of the depth",
    "set_point_temperature_c": "set-point of the temperature",
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
    def title(self) -> str:
        """The rule that decides, in a few words."""
        codes = {fact.code for fact in self.facts}
        lacks = FactCode.MISSING in codes and FactCode.BEYOND not in codes
        words = _NOT_THROUGHOUT if lacks and "variable" in self.data else _WORDS[self.name][0]
        variable = VARIABLES.get(self.subject, "")
        text = words.format(subject=self.subject, variable=variable)
        return text[:1].upper() + text[1:]

    @property
    def words(self) -> str:
        """The requirement, in words."""
        data = _plain(self.data) | _derived(self.name, self.data)
        return _WORDS[self.name][1].format_map(data | {"subject": self.subject})

    @property
    def figure(self) -> str:
        """The findings, in words."""
        return "; ".join(fact.words for fact in self.facts) or _WORDS[self.name][2]


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
    plain["s"] = "" if data.get("count") == 1 else "s"  # of a plural
    return plain
