"""Events of a weld as facts; their texts for people are made here and never parsed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from fsw_control.cause import Cause

#: by kind of event
_WORDS = {
    "phase": "phase {subject}",
    "weld": "weld {subject}",
    "swap": "{subject} commands ({why})",
    "mode": "mode {subject} ({why})",
    "takeover": "another supervisor leads",
    "interlock": "interlock {subject}, {state}",
    "interlock over": "interlock {subject}, {state}, is over",
    "operator": "{who}: {subject}: {state}",
    "alarm": "{priority} alarm {state}: {subject}",
    "alarm shelved": "{priority} alarm {state} by {who}, {detail}: {subject}",
    "procedure": "{subject} revision {revision}, SHA-256 {sha256}",
    "deviation": "{detail}",
    "estimate": "monitor: {detail}",
    "finding": "monitor: {detail}",
    "finding over": "monitor: no longer: {detail}",
    "fault": "emulated fault {subject}",
    "fault over": "emulated faults are over",
}


@dataclass(frozen=True, slots=True)
class WeldEvent:
    """Something on the time line of a weld."""

    time_s: float  #: on the clock of `WeldSignals.time_s`
    #: ``phase``, ``weld``, ``swap``, ``mode``, ``takeover``, ``interlock``, ``operator``,
    #: ``alarm``, ``procedure``, ``deviation``, ``finding``, ``estimate`` or ``fault``
    kind: str
    #: the phase, what the weld became, the controller, the mode, the interlock, what was asked
    #: for, what the alarm says, the procedure, what the monitor found or estimated, or the faults
    subject: str = ""
    #: of an interlock ``warn``, ``trip`` or ``unknown``, of a request its outcome, of an alarm what became of
    #: it
    state: str = ""
    is_over: bool = False  #: an interlock or fault ends
    cause: Cause = Cause.UNKNOWN  #: of a swap or a mode
    who: str = ""  #: the operator
    detail: str = ""  #: for people
    data: Mapping[str, str] = field(default_factory=dict)  #: more, by kind

    @property
    def text(self) -> str:
        """The event in words."""
        key = self.kind
        if self.is_over or self.state == "shelved":
            key = f"{self.kind} {'over' if self.is_over else 'shelved'}"
        facts = {
            "subject": self.subject or "no controller",
            "state": self.state,
            "who": self.who,
            "detail": self.detail,
            "why": self._why(),
        }
        words = _WORDS[key].format_map({**self.data, **facts})
        return f"{words}: {self.detail}" if self.kind == "operator" and self.detail else words

    def _why(self) -> str:
        cause = self.who or self.cause.words
        return f"{cause}: {self.detail}" if self.detail else cause
