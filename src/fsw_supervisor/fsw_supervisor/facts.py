"""Log events and answers of the supervisor: codes with their fields, and the table of texts."""

from __future__ import annotations

from fsw_control.coded import Answer as Answer
from fsw_control.coded import Fact as Fact
from fsw_control.coded import Worded


class Code(Worded):
    """Kind of a fact."""

    # controllers
    JOINED = "joined", "controller {controller} has joined"
    LEFT = "left", "controller {controller} has left the graph"
    READY = "ready", "controller {controller} is ready"
    SILENT = "silent", "controller {controller} has not proposed in time"
    DOUBLED = (
        "doubled",
        "{controller} proposes more than once per tick: are there two controllers of this name?",
    )
    REFUSED = (
        "refused",
        "proposal of {controller} refused: {reason.words}: {force_kn:.3f} kN, {speed_rpm:.2f} rpm",
    )
    READMITTED = "readmitted", "readmitted by {who}: {controllers}"
    RECOVERED = "recovered", "controller {controller} is readmitted after good shadow ticks"
    FAILED = "failed", "{reason.words}"
    FOREIGN_COMMAND = (
        "foreign_command",
        "a foreign writer commands {force_kn:g} kN, {speed_rpm:g} rpm as {source!r}",
    )
    # sensors and interlocks
    SENSOR_INVALID = "sensor_invalid", "sensor {sensor} is invalid: {flaw}"
    SENSOR_VALID = "sensor_valid", "sensor {sensor} is valid again"
    SENSOR_ACKNOWLEDGED = (
        "sensor_acknowledged",
        "{who} has acknowledged that sensor {sensor} shows {value:.4g}",
    )
    INTERLOCK = "interlock", "{interlock} is {level.word}: {quantity} {value:.4g}"
    SENSOR_JUMPED = (
        "sensor_jumped",
        "{interlock} is trip: {quantity} {value:.4g}, last good {last_good:.4g}",
    )
    SENSOR_BLIND = "sensor_blind", "{interlock} is trip: invalid ({flaw}) for {limit_s:g} s in sum"
    CLEARED = "cleared", "{interlock} is ok"
    NOTHING_MEASURED = "nothing_measured", "nothing has been measured yet"
    # ticks and modes
    NO_MEASUREMENT = "no_measurement", "no measurement for {limit_s:g} s"
    CLOCK_STANDS = "clock_stands", "stamps have not advanced for {limit_s:g} s"
    STALLED = "stalled", "was stalled for {time_s:.3f} s"
    TIME_BACK = "time_back", "time went back: continuing from there"
    GAP = "gap", "{reason.words}"
    TAKING_OVER = (
        "taking_over",
        "taking over at {force_kn:.3f} kN, {speed_rpm:.3f} rpm from {origin.words}",
    )
    FROM_DRIVES = "from_drives", "the drives' feedback"
    FROM_COMMAND = "from_command", "the last command seen"
    FROM_PROPOSAL = "from_proposal", "the proposal of {controller}"
    FROM_OPERATOR = "from_operator", "the operator's values"
    FROM_BOTH = "from_both", "the drives and {controller}"
    MODE = "mode", "{before} -> {mode}: {reason.words}"
    MODE_WITH = "mode_with", "{before} -> {mode} ({controller}): {reason.words}"
    SWAP = "swap", "{before} -> {controller}: {reason.words}"
    LEADS = "leads", "leads in {mode}: {ticks} ticks went unanswered"
    STANDBY = "standby", "on standby: another supervisor leads"
    STOP_ACKNOWLEDGED = "stop_acknowledged", "{who} has acknowledged the safe stop"
    # requests, and their answers
    SWITCH_ANSWERED = "switch_answered", "switch to {controller}: {answer.words}"
    MODE_REFUSED = "mode_refused", "mode {mode}: {answer.words}"
    ACKNOWLEDGE_REFUSED = "acknowledge_refused", "acknowledge: {answer.words}"
    UNKNOWN_CONTROLLER = "unknown_controller", "unknown controller {controller!r}; known: {known}"
    UNKNOWN_MODE = "unknown_mode", "unknown mode {mode!r}; known: {known}"
    UNKNOWN_STRICTNESS = (
        "unknown_strictness",
        "strictness {strictness} is neither BEST_EFFORT (1) nor STRICT (2)",
    )
    ON_STANDBY = "on_standby", "this supervisor is on standby now; send the request again"
    OTHER_LEADS = "other_leads", "another supervisor leads"
    SUPERSEDED = "superseded", "superseded by a request for {controller}"
    MODE_CHANGED = "mode_changed", "the mode has become {mode}"
    ACTIVE_ALREADY = "active_already", "{controller} is active already"
    NOT_READY = "not_ready", "{controller} {readiness.predicate}"
    TOO_SOON = "too_soon", "the last swap was only {elapsed_s:.1f} s ago"
    SELECTED = "selected", "{controller} is selected; the mode is {mode}: applied when auto begins"
    ACCEPTED = "accepted", "accepted: {controller} is applied from the next tick on"
    APPLIED = "applied", "{controller} is applied"
    NOT_APPLIED = "not_applied", "swapped, but {controller} is not applied yet"
    SWAP_FAILED = "swap_failed", "swapped, but {reason.words}"
    NO_MEASUREMENT_YET = "no_measurement_yet", "no measurement has arrived for the swap"
    TIMED_OUT = "timed_out", "timed out: {reason.words}"
    CAUSE_PRESENT = "cause_present", "the cause is still present: {causes}"
    CAUSE_UNKNOWN = "cause_unknown", "{causes}, so it is unknown whether the cause is gone"
    ACKNOWLEDGE_FIRST = (
        "acknowledge_first",
        "acknowledge the safe stop first (fsw/acknowledge, fsw.py acknowledge)",
    )
    BAD_VALUES = "bad_values", "{refusal.words}"
    MODE_ALREADY = "mode_already", "{mode} already"
    MODE_NEXT = "mode_next", "{mode} from the next command on"
    AUTO_NEXT = "auto_next", "auto from the next command on, with {controller}"
    NO_STOP = "no_stop", "there is no safe stop to acknowledge"
    STOP_UNCONFIRMED = "stop_unconfirmed", "the machine has not confirmed the safe stop; ask again"
    ACKNOWLEDGED = "acknowledged", "acknowledged; now request a mode"
    UNCONFIRMED = (
        "unconfirmed",
        "requested, but not confirmed by the machine within {wait_s:g} s ({answer.words})",
    )
