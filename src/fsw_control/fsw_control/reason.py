"""Why a command must not be applied, or why the supervisor is in its state: a code with arguments.

The texts for people are made here, from one table, and never parsed.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from fsw_control.coded import Coded


class ReasonCode(Coded):
    """Kind of a reason; numbered as in ``Reason.msg``, which says what each means."""

    NONE = 0
    OTHER = 1
    NO_SET_POINT = 2
    INVALID_SENSOR = 3
    RAISED = 4
    BAD_COMMAND = 5  # of earlier versions
    WAITING_FOR_SENSORS = 6
    NOT_WELDING = 7
    NO_REFERENCE = 8
    BLIND = 9
    OUT_OF_BOUNDS = 10
    SOLVER = 11
    CAUTION = 12  # of earlier versions
    FORCE_HELD = 13
    OVERFLOW = 14
    HORIZON = 15
    NOT_FINITE = 16
    OUT_OF_RANGE = 17
    JUMP = 18
    REJOINING = 19
    SLEWING = 21
    FOREIGN = 22
    INCOMPLETE = 23
    NO_SAMPLES = 24
    STALLED = 25
    NO_MEASUREMENT = 30
    COMMAND_UNKNOWN = 31
    WAITING_FOR_CONTROLLER = 32
    ACTIVE_BEFORE = 33
    CONFIGURED = 34
    SUBSTITUTED = 35
    ABANDONED = 36
    GAP = 37
    REQUESTED = 38
    REQUESTED_BEFORE = 39
    FAILED = 40
    NO_FALLBACK = 41
    STORM = 42
    READY_AGAIN = 43
    TIMEOUT = 44
    STOPPED_BEFORE = 45
    STOP_HEARD = 46
    INTERLOCKS = 47
    CLOCK_STOPPED = 48
    NO_PROPOSAL = 50
    NO_PROPOSAL_YET = 51
    LATE = 52
    OUTDATED = 53
    OTHER_SOURCE = 54
    UNHEALTHY = 55
    NAMESAKE = 56
    UNKNOWN_CONTROLLER = 57
    SENSOR_REQUIRED = 58
    UNKNOWN = 255


_WORDS = {
    ReasonCode.NONE: "",
    ReasonCode.OTHER: "{detail}",
    ReasonCode.NO_SET_POINT: "no set-point yet",
    ReasonCode.INVALID_SENSOR: "invalid sensor: {sensors}",
    ReasonCode.RAISED: "controller raised {detail}",
    ReasonCode.BAD_COMMAND: "command is {detail}",
    ReasonCode.WAITING_FOR_SENSORS: "waiting for valid sensors: {sensors}",
    ReasonCode.NOT_WELDING: "waiting: depth and temperature are not those of a weld",
    ReasonCode.NO_REFERENCE: "no usable reference",
    ReasonCode.BLIND: "no valid {sensors} for more than {limit_s:g} s",
    ReasonCode.OUT_OF_BOUNDS: "the applied command is more than a move outside the bounds",
    ReasonCode.SOLVER: "solver: {detail}",
    ReasonCode.CAUTION: "adapting with caution: {detail}",
    ReasonCode.FORCE_HELD: "no valid {sensors}, force held",
    ReasonCode.OVERFLOW: "samples beyond all range, loops start again",
    ReasonCode.HORIZON: "another horizon cannot be made: {detail}",
    ReasonCode.NOT_FINITE: "{subject} is not finite",
    ReasonCode.OUT_OF_RANGE: "{subject} is outside its limits",
    ReasonCode.JUMP: "{subject} jumps by more than a move",
    ReasonCode.REJOINING: "started in mid-weld: the heat is not known yet",
    ReasonCode.SLEWING: "slewing after a swap",
    ReasonCode.FOREIGN: "the controller has followed a foreign command",
    ReasonCode.INCOMPLETE: "the measurement lacks {sensors}",
    ReasonCode.NO_SAMPLES: "only the drives' feedback has arrived, no sensor sample",
    ReasonCode.STALLED: "the arbiter was stalled",
    ReasonCode.NO_MEASUREMENT: "starting: waiting for measurements",
    ReasonCode.COMMAND_UNKNOWN: "starting: the command in force is not known yet",
    ReasonCode.WAITING_FOR_CONTROLLER: "starting: waiting for {subject}",
    ReasonCode.ACTIVE_BEFORE: "{subject} was active before",
    ReasonCode.CONFIGURED: "{subject} is configured to start with",
    ReasonCode.SUBSTITUTED: "{subject} has no usable proposal, a fallback has",
    ReasonCode.ABANDONED: "{subject} was active before and has no usable proposal",
    ReasonCode.GAP: "measurements are back after a gap",
    ReasonCode.REQUESTED: "request for {subject}",
    ReasonCode.REQUESTED_BEFORE: "{subject} was requested of the leader before",
    ReasonCode.FAILED: "{subject} failed",
    ReasonCode.NO_FALLBACK: "no fallback is ready",
    ReasonCode.STORM: "too many swaps in {limit_s:g} s",
    ReasonCode.READY_AGAIN: "{subject} is ready again",
    ReasonCode.TIMEOUT: "{subject} for {limit_s:g} s",
    ReasonCode.STOPPED_BEFORE: "a safe stop was in force before the restart",
    ReasonCode.STOP_HEARD: "a safe stop is in force: {subject}",
    ReasonCode.INTERLOCKS: "interlock tripped: {interlocks}",
    ReasonCode.CLOCK_STOPPED: (
        "measurements arrive, but their stamps have not advanced for {limit_s:g} s"
    ),
    ReasonCode.NO_PROPOSAL: "no proposal at the deadline",
    ReasonCode.NO_PROPOSAL_YET: "no proposal yet",
    ReasonCode.LATE: "late: {limit_ms:.0f} ms after the measurement",
    ReasonCode.OUTDATED: "late: answers a measurement {limit_ms:.0f} ms older than the last",
    ReasonCode.OTHER_SOURCE: "proposal names the source {subject!r}",
    ReasonCode.UNHEALTHY: "the controller says it is unhealthy, without a reason",
    ReasonCode.NAMESAKE: "two controllers of this name propose",
    ReasonCode.UNKNOWN_CONTROLLER: "it is unknown",
    ReasonCode.SENSOR_REQUIRED: "requires the sensor {sensors}",
    ReasonCode.UNKNOWN: "reason not on record",
}

#: by code of ``StopCause``, which is the subject of a stop that was heard of
_STOPS = {
    "operator": "requested",
    "interlock": "an interlock has tripped",
    "hold_timeout": "force and speed were held for too long",
    "start_timeout": "no controller was ready in time",
    "blind": "a sensor was invalid for too long",
    "watchdog": "no commands reached the machine",
    "restart": "it began before a restart",
    "clock": "stamps did not advance",
}


class Reason(NamedTuple):
    """A reason; false in a condition when there is nothing to explain."""

    code: ReasonCode = ReasonCode.NONE
    sensors: tuple[str, ...] = ()  #: of ``fsw_control.sensors.SENSORS``
    limit_s: float = 0.0  #: time that was exceeded, or a duration
    detail: str = ""  #: what other software says: an error or a solver's status
    subject: str = ""  #: name of a controller, a mode, a cause or a commanded quantity
    interlocks: tuple[str, ...] = ()  #: names of the interlocks
    because: Reason | None = None  #: its cause

    def __bool__(self) -> bool:
        return self.code is not ReasonCode.NONE

    @property
    def words(self) -> str:
        """The reason in words, with its causes; empty if there is nothing to explain."""
        heard = self.code is ReasonCode.STOP_HEARD
        own = _WORDS[self.code].format(
            sensors=", ".join(self.sensors),
            interlocks=", ".join(self.interlocks),
            limit_s=self.limit_s,
            limit_ms=1e3 * self.limit_s,
            detail=self.detail,
            subject=_STOPS.get(self.subject, self.subject) if heard else self.subject,
        )
        return f"{own}: {self.because.words}" if self.because else own

    @property
    def head(self) -> Reason:
        """The reason without its causes."""
        return self._replace(because=None)

    @property
    def chain(self) -> list[Reason]:
        """The reason and its causes, each without the next; empty if there is no reason."""
        return [self.head, *(self.because.chain if self.because else ())] if self else []

    @classmethod
    def of_messages(cls, chain: Sequence[Any]) -> Reason:
        """Return the reason of a list of ``Reason.msg``, each the cause of the one before."""
        if not chain:
            return cls()
        head, because = chain[0], cls.of_messages(chain[1:])
        return cls(
            ReasonCode(head.code),
            tuple(head.sensors),
            float(head.limit),
            head.detail,
            head.subject,
            tuple(head.interlocks),
            because or None,
        )

    @property
    def fields(self) -> dict[str, Any]:
        """The fields of ``Reason.msg``, without its causes."""
        return {
            "code": int(self.code),
            "subject": self.subject,
            "sensors": list(self.sensors),
            "interlocks": list(self.interlocks),
            "limit": self.limit_s,
            "detail": self.detail,
        }

    @classmethod
    def of(cls, output: Reason | str) -> Reason:
        """Return a reason from a controller's output, which may be a text of its own."""
        if isinstance(output, Reason):
            return output
        return cls(ReasonCode.OTHER, detail=output) if output else cls()
