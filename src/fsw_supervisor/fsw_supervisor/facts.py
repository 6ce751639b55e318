"""Log events and answers of the supervisor: codes with their fields, and the table of texts."""

from __future__ import annotations

from fsw_control.coded import Answer as Answer
from fsw_control.coded import Fact as Fact
from fsw_control.coded import Worded


class Code(Worded):
    """Kind of a fact."""

    # controllers
    JOINED = "controller {controller} has joined"
    LEFT = "controller {controller} has left the graph"
    READY = "controller {controller} is ready"
    SILENT = "controller {controller} has not proposed in time"
    DOUBLED = (
        "{controller} proposes more than once per tick: are there two controllers of this name?"
    )
    REFUSED = (
        "proposal of {controller} refused: {reason.words}: {force_kn:.3f} kN, {speed_rpm:.2f} rpm"
    )
    READMITTED = "readmitted by {who}: {controllers}"
    RECOVERED = "controller {controller} is readmitted after good shadow ticks"
    FAILED = "{reason.words}"
    FOREIGN_COMMAND = "a foreign writer commands {force_kn:g} kN, {speed_rpm:g} rpm as {source!r}"
    # sensors and interlocks
    SENSOR_INVALID = "sensor {sensor} is invalid: {flaw}"
    SENSOR_VALID = "sensor {sensor} is valid again"
    SENSOR_ACKNOWLEDGED = "{who} has acknowledged that sensor {sensor} shows {value:.4g}"
    INTERLOCK = "{interlock} is {level.word}: {quantity} {value:.4g}"
    SENSOR_JUMPED = "{interlock} is trip: {quantity} {value:.4g}, last good {last_good:.4g}"
    SENSOR_BLIND = "{interlock} is trip: invalid ({flaw}) for {limit_s:g} s in sum"
    CLEARED = "{interlock} is ok"
    NOTHING_MEASURED = "nothing has been measured yet"
    # ticks and modes
    NO_MEASUREMENT = "no measurement for {limit_s:g} s"
    CLOCK_STANDS = "stamps have not advanced for {limit_s:g} s"
    STALLED = "was stalled for {time_s:.3f} s"
    TIME_BACK = "time went back: continuing from there"
    GAP = "{reason.words}"
    TAKING_OVER = "taking over at {force_kn:.3f} kN, {speed_rpm:.3f} rpm from {origin.words}"
    FROM_DRIVES = "the drives' feedback"
    FROM_COMMAND = "the last command seen"
    FROM_PROPOSAL = "the proposal of {controller}"
    FROM_OPERATOR = "the operator's values"
    FROM_BOTH = "the drives and {controller}"
    MODE = "{before} -> {mode}: {reason.words}"
    MODE_WITH = "{before} -> {mode} ({controller}): {reason.words}"
    SWAP = "{before} -> {controller}: {reason.words}"
    LEADS = "leads in {mode}: {ticks} ticks went unanswered"
    STANDBY = "on standby: another supervisor leads"
    STOP_ACKNOWLEDGED = "{who} has acknowledged the safe stop"
    # requests, and their answers
    SWITCH_ANSWERED = "switch to {controller}: {answer.words}"
    MODE_REFUSED = "mode {mode}: {answer.words}"
    ACKNOWLEDGE_REFUSED = "acknowledge: {answer.words}"
    UNKNOWN_CONTROLLER = "unknown controller {controller!r}; known: {known}"
    UNKNOWN_MODE = "unknown mode {mode!r}; known: {known}"
    UNKNOWN_STRICTNESS = "strictness {strictness} is neither BEST_EFFORT (1) nor STRICT (2)"
    ON_STANDBY = "this supervisor is on standby now; send the request again"
    OTHER_LEADS = "another supervisor leads"
    SUPERSEDED = "superseded by a request for {controller}"
    MODE_CHANGED = "the mode has become {mode}"
    ACTIVE_ALREADY = "{controller} is active already"
    NOT_READY = "{controller} {readiness.predicate}"
    TOO_SOON = "the last swap was only {elapsed_s:.1f} s ago"
    SELECTED = "{controller} is selected; the mode is {mode}: applied when auto begins"
    ACCEPTED = "accepted: {controller} is applied from the next tick on"
    APPLIED = "{controller} is applied"
    NOT_APPLIED = "swapped, but {controller} is not applied yet"
    SWAP_FAILED = "swapped, but {reason.words}"
    NO_MEASUREMENT_YET = "no measurement has arrived for the swap"
    TIMED_OUT = "timed out: {reason.words}"
    CAUSE_PRESENT = "the cause is still present: {causes}"
    CAUSE_UNKNOWN = "{causes}, so it is unknown whether the cause is gone"
    ACKNOWLEDGE_FIRST = "acknowledge the safe stop first (fsw/acknowledge, fsw.py acknowledge)"
    BAD_VALUES = "{refusal.words}"
    MODE_ALREADY = "{mode} already"
    MODE_NEXT = "{mode} from the next command on"
    AUTO_NEXT = "auto from the next command on, with {controller}"
    NO_STOP = "there is no safe stop to acknowledge"
    STOP_UNCONFIRMED = "the machine has not confirmed the safe stop; ask again"
    ACKNOWLEDGED = "acknowledged; now request a mode"
    UNCONFIRMED = (
        "requested, but not confirmed by the machine within {wait_s:g} s ({answer.words})"
    )
