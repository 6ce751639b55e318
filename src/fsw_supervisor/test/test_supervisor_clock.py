"""The clock of the measurements steps, repeats or stands.

Commands continue, or a named cause leads to a safe stop.
"""

from itertools import pairwise

import hypothesis.strategies as st
import pytest
from hypothesis import given, settings

from fsw_control.contract import Command
from fsw_supervisor.arbiter import Arbiter
from fsw_supervisor.parameters import SupervisorParameters
from fsw_supervisor.state_machine import Mode
from fsw_supervisor.tick import ProposalInput

STEP_NS = 100_000_000
VALUES = {"depth": 2.66, "torque": 1052.0, "thermocouple": 850.0}
ACTING = Command(78.4, 407.5)


class Stream:
    """Measurements every 0.1 s with any stamps into an arbiter; a controller answers each tick."""

    def __init__(self):
        self.arbiter, self.now_s = Arbiter(SupervisorParameters.from_values({})), 100.0
        self.answers = []  #: time on the steady clock, and decision

    def take(self, decisions):
        self.answers += [(self.now_s, decision) for decision in decisions]

    def pass_until(self, until_s):
        """Let time pass, as the node's timers do."""
        while self.now_s < until_s:
            wakeup_s = self.arbiter.wakeup_s
            due_s = (
                until_s if wakeup_s is None or wakeup_s <= self.now_s else min(wakeup_s, until_s)
            )
            self.now_s = min(due_s, self.now_s + 0.05)
            self.take(self.arbiter.on_time(self.now_s))

    def sample(self, source, stamp_ns):
        if source == "drives":
            self.take(self.arbiter.on_drives(stamp_ns, self.arbiter.applied or ACTING, self.now_s))
        else:
            self.take(self.arbiter.on_sample(source, stamp_ns, VALUES[source], self.now_s))
        tick = self.arbiter.ticks.present
        if (
            tick is not None
            and tick.stamp_ns == stamp_ns
            and not tick.settled
            and source == "thermocouple"
        ):
            proposal = ProposalInput(stamp_ns, "decentral", self.arbiter.applied or ACTING)
            self.take(self.arbiter.on_proposal("decentral", proposal, self.now_s))
            self.take(self.arbiter.on_status("decentral", (), True, self.now_s))

    def measure(self, stamp_ns):
        """One measurement, complete and at once."""
        for source in ("drives", *VALUES):
            self.sample(source, stamp_ns)
        self.pass_until(self.now_s + 0.1)

    def events(self):
        return [(event.who, event.fact.code) for event in self.arbiter.machine.events]


@pytest.fixture
def stream():
    """A weld in auto."""
    stream = Stream()
    for count in range(20):
        stream.measure(10**15 + count * STEP_NS)
    assert stream.arbiter.machine.mode is Mode.AUTO
    return stream


@pytest.mark.requirement("S5")
@pytest.mark.parametrize("back_ticks", [1, 3, 9])
def test_commands_continue_while_the_clock_goes_back_again_and_again(stream, back_ticks):
    """By 0.9 s every 0.9 s: none of 300 measurements was answered."""
    before = len(stream.answers)
    for count in range(300):
        stream.measure(10**15 + 10**6 * (count // back_ticks) + (count % back_ticks) * STEP_NS)
    times_s = [time_s for time_s, _ in stream.answers[before - 1 :]]
    assert len(times_s) > 100
    assert max(after - earlier for earlier, after in pairwise(times_s)) < 1.0


@pytest.mark.requirement("S7")
def test_a_clock_that_stands_is_named_and_leads_to_a_safe_stop(stream):
    stamp_ns, begin_s = stream.arbiter.ticks.present.stamp_ns, stream.now_s
    named_s = stopped_s = None
    for _ in range(50):
        stream.measure(stamp_ns)
        if named_s is None and any(who == "clock" for who, _ in stream.events()):
            named_s = stream.now_s - begin_s
        if stopped_s is None and stream.arbiter.machine.mode is Mode.SAFE_STOP:
            stopped_s = stream.now_s - begin_s
    assert named_s == pytest.approx(1.0, abs=0.2)
    assert stopped_s == pytest.approx(3.0, abs=0.2)
    assert [who for who, _ in stream.events()].count("clock") == 2, "the cause and the stop"
    assert not stream.arbiter.ticks.measuring
    for count in range(20):
        stream.measure(stamp_ns + (100 + count) * STEP_NS)
    assert stream.answers[-1][1].source == "safe_stop", "it is latched"


def test_pause_without_samples_is_not_a_clock_fault(stream):
    stream.pass_until(stream.now_s + 10.0)
    assert ("sensors", "no_measurement") in stream.events()
    assert "clock" not in dict(stream.events())
    assert stream.arbiter.machine.mode is Mode.AUTO


@st.composite
def disturbed_streams(draw):
    """Samples as (arrival, source, stamp).

    The clock steps or stands, samples are late or come twice.
    """
    clock_ns, samples = 10**15, []
    ready_s = dict.fromkeys(("drives", *VALUES), 0.0)
    for count in range(draw(st.integers(20, 60))):
        step = draw(st.sampled_from([0] * 8 + [-1, -3, -9, 9, -11, 40, -40, "odd"]))
        clock_ns += draw(st.integers(-(10**9), 10**9)) if step == "odd" else step * STEP_NS
        clock_ns += STEP_NS
        for source in ready_s:
            late_s = draw(st.sampled_from([0.0] * 6 + [0.05, 0.12, 0.35]))
            ready_s[source] = max(ready_s[source], count * 0.1 + late_s)
            samples.append((ready_s[source], source, clock_ns))
            if draw(st.integers(0, 9)) == 0:
                samples.append(
                    (ready_s[source] + draw(st.sampled_from([0.0, 0.1, 0.3])), source, clock_ns)
                )
    return sorted(samples, key=lambda sample: sample[0])


@pytest.mark.requirement("S5", "S7")
@settings(max_examples=100, deadline=None)
@given(disturbed_streams())
def test_each_stamp_is_answered_once_and_no_silence_is_without_a_cause(samples):
    stream = Stream()
    for count in range(20):
        stream.measure(10**14 + count * STEP_NS)
    stream.arbiter.machine.events.clear()
    begin_s, answered = stream.now_s, {}
    for arrival_s, source, stamp_ns in samples:
        stream.pass_until(begin_s + arrival_s)
        stream.sample(source, stamp_ns)
    for time_s, decision in stream.answers:
        earlier_s = answered.get(decision.stamp_ns, -1.0)
        assert time_s - earlier_s >= 0.4, (
            "answered twice, and not because the clock has repeated the stamp"
        )
        answered[decision.stamp_ns] = time_s
    times_s = [
        begin_s,
        *(time_s for time_s, _ in stream.answers if time_s > begin_s),
        stream.now_s,
    ]
    if max(after - earlier for earlier, after in pairwise(times_s)) > 1.1:
        assert {who for who, _ in stream.events()} & {"clock", "sensors"}
