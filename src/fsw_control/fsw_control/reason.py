"""Why a command must not be applied, or why the supervisor is in its state: a code with arguments.

The texts for people are made here, from one table, and never parsed.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from fsw_control.coded import Coded
from fsw_control.stop import StopCause


class ReasonCode(Coded):
    """Kind of a reason; numbered as in ``Reason.msg``, which says what each means."""

    NONE = 0
    OTHER = 1, "{detail}"
    NO_SET_POINT = 2, "no set-point yet"
    INVALID_SENSOR = 3, "invalid sensor: {sensors}"
    RAISED = 4, "controller raised {detail}"
    BAD_COMMAND = 5, "command is {detail}"  # of earlier versions
    WAITING_FOR_SENSORS = 6, "waiting for valid sensors: {sensors}"
    NOT_WELDING = 7, "waiting: depth and temperature are not those of a weld"
    NO_REFERENCE = 8, "no usable reference"
    BLIND = 9, "no valid {sensors} for more than {limit_s:g} s"
    OUT_OF_BOUNDS = 10, "the applied command is more than a move outside the bounds"
    SOLVER = 11, "solver: {detail}"
    CAUTION = 12, "adapting with caution: {detail}"  # of earlier versions
    FORCE_HELD = 13, "no valid {sensors}, force held"
    OVERFLOW = 14, "samples beyond all range, loops start again"
    HORIZON = 15, "another horizon cannot be made: {detail}"
    NOT_FINITE = 16, "{subject} is not finite"
    OUT_OF_RANGE = 17, "{subject} is outside its limits"
    JUMP = 18, "{subject} jumps by more than a move"
    REJOINING = 19, "started in mid-weld: the heat is not known yet"
    SLEWING = 21, "slewing after a swap"
    FOREIGN = 22, "the controller has followed a foreign command"
    INCOMPLETE = 23, "the measurement lacks {sensors}"
    NO_SAMPLES = 24, "only the drives' feedback has arrived, no sensor sample"
    STALLED = 25, "the arbiter was stalled"
    NO_MEASUREMENT = 30, "starting: waiting for measurements"
    COMMAND_UNKNOWN = 31, "starting: the command in force is not known yet"
    WAITING_FOR_CONTROLLER = 32, "starting: waiting for {subject}"
    ACTIVE_BEFORE = 33, "{subject} was active before"
    CONFIGURED = 34, "{subject} is configured to start with"
    SUBSTITUTED = 35, "{subject} has no usable proposal, a fallback has"
    ABANDONED = 36, "{subject} was active before and has no usable proposal"
    GAP = 37, "measurements are back after a gap"
    REQUESTED = 38, "request for {subject}"
    REQUESTED_BEFORE = 39, "{subject} was requested of the leader before"
    FAILED = 40, "{subject} failed"
    NO_FALLBACK = 41, "no fallback is ready"
    STORM = 42, "too many swaps in {limit_s:g} s"
    READY_AGAIN = 43, "{subject} is ready again"
    TIMEOUT = 44, "{subject} for {limit_s:g} s"
    STOPPED_BEFORE = 45, "a safe stop was in force before the restart"
    STOP_HEARD = 46, "a safe stop is in force: {subject}"
    INTERLOCKS = 47, "interlock tripped: {interlocks}"
    CLOCK_STOPPED = 48, "measurements arrive, but their stamps have not advanced for {limit_s:g} s"
    NO_PROPOSAL = 50, "no proposal at the deadline"
    NO_PROPOSAL_YET = 51, "no proposal yet"
    LATE = 52, "late: {limit_ms:.0f} ms after the measurement"
    OUTDATED = 53, "late: answers a measurement {limit_ms:.0f} ms older than the last"
    OTHER_SOURCE = 54, "proposal names the source {subject!r}"
    UNHEALTHY = 55, "the controller says it is unhealthy, without a reason"
    NAMESAKE = 56, "two controllers of this name propose"
    UNKNOWN_CONTROLLER = 57, "it is unknown"
    SENSOR_REQUIRED = 58, "requires the sensor {sensors}"
    UNKNOWN = 255, "reason not on record"


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
        stops = StopCause.__members__ if self.code is ReasonCode.STOP_HEARD else {}
        stop = stops.get(self.subject.upper())
        own = self.code.words.format(
            sensors=", ".join(self.sensors),
            interlocks=", ".join(self.interlocks),
            limit_s=self.limit_s,
            limit_ms=1e3 * self.limit_s,
            detail=self.detail,
            subject=stop.words if stop else self.subject,
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
        own = ReasonCode(head.code), tuple(head.sensors), float(head.limit), head.detail
        return cls(*own, head.subject, tuple(head.interlocks), because or None)

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


class Lack(Coded):
    """Conditions that prevent a selection; numbered as in ``ControllerHealth.msg``.

    The words are the predicate of a sentence about the controller.
    """

    NONE = 0
    UNKNOWN = 1, "is unknown"
    INHIBITED = 2, "is inhibited: {why}"
    AMBIGUOUS = 3, "is ambiguous: two controllers of this name propose"
    UNUSABLE = 4, "is not usable: {why}"
    LEFT = 5, "has left the graph"
    WARMING = 6, "is not ready: {good} of {required} good proposals in a row"
    BLIND = 7, "requires the sensor {sensors}"

    @classmethod
    def _missing_(cls, value: object) -> Lack:
        return cls.UNUSABLE


class Readiness(NamedTuple):
    """What a controller lacks: nothing, if it may be selected."""

    lack: Lack = Lack.NONE
    reason: Reason = Reason()  #: if inhibited or unusable
    sensors: tuple[str, ...] = ()  #: that it requires, if blind
    good: int = 0  #: good proposals in a row
    required: int = 0  #: good proposals in a row for it to be ready

    @property
    def why(self) -> str:
        """What it lacks, in words without its name; empty if nothing."""
        whole, colon, why = self.predicate.partition(": ")
        return why if colon else whole

    @property
    def predicate(self) -> str:
        """The same as the predicate of a sentence about it."""
        sensors = ", ".join(self.sensors)
        return self.lack.words.format(
            why=self.reason.words, sensors=sensors, good=self.good, required=self.required
        )

    def words(self, name: str) -> str:
        """What controller ``name`` lacks; empty if nothing."""
        return "" if self.lack is Lack.NONE else f"{name} {self.predicate}"
