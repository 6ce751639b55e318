"""Whatever comes in whatever order.

Each tick gets exactly one command, finite, in limits, in rate, of true source.
"""

from __future__ import annotations

import math
from dataclasses import replace

import hypothesis.strategies as st
import pytest
from hypothesis import settings as hypothesis_settings
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from fsw_control.contract import Command
from fsw_control.reason import Reason, ReasonCode
from fsw_control.sensors import REQUIRED
from fsw_supervisor.arbiter import Arbiter
from fsw_supervisor.facts import Code
from fsw_supervisor.parameters import SupervisorParameters
from fsw_supervisor.state_machine import Mode
from fsw_supervisor.tick import Decision, ProposalInput

NAMES = ("decentral", "nmpc", "third")
STEP_NS = 100_000_000
TRIPPING = {"depth": 3.8, "torque": 1700.0, "thermocouple": 920.0}
GOOD = {"depth": 2.66, "torque": 1050.0, "thermocouple": 850.0}

numbers = st.one_of(
    st.floats(55.0, 100.0),
    st.sampled_from([math.nan, math.inf, -math.inf, 0.0, -1e308, 60.0, 95.0, 1e308]),
)
behaviours = st.sampled_from(
    ["good"] * 6
    + [
        "silent",
        "wild",
        "late",
        "old",
        "future",
        "jump",
        "unhealthy",
        "liar",
        "twice",
        "early",
        "edge",
    ]
)
samples = st.sampled_from(["good"] * 8 + ["nan", "missing", "wild", "old", "trip", "trip"])
delays = st.sampled_from([0.0, 0.001, 0.02, 0.05, 0.0799, 0.08, 0.09, 0.15])


SETTINGS = {
    "fallbacks": ("decentral", "nmpc", "third"),
    "readmit_ticks": 3,
    "hold_timeout_s": 0.5,
    "storm_window_s": 2.0,
    "operator_hold_timeout_s": 1.0,
    "start_timeout_s": 1.0,
}


@pytest.mark.requirement("S4", "S5")
class ArbiterMachine(RuleBasedStateMachine):
    """Plays plant, controllers, operator and clock against the arbiter."""

    @initialize(
        transition=st.sampled_from([0.1, 1.0]),
        lockstep=st.booleans(),
        returning=st.booleans(),
        storm=st.integers(0, 4),
        warm=st.integers(1, 4),
        drives=st.booleans(),
        persistence=st.sampled_from([0.1, 0.3]),
    )
    def start(self, transition, lockstep, returning, storm, warm, drives, persistence):
        """Make an arbiter with some settings."""
        drawn = {"force_transition_kn": transition, "return_to_target": returning}
        drawn |= {"storm_swaps": storm, "warm_ticks": warm}
        drawn["interlocks.persistence_s"] = persistence
        self.settings = SupervisorParameters.from_values(SETTINGS | drawn)
        self.arbiter = Arbiter(self.settings, lockstep=lockstep)
        self.drives = Command(78.4, 407.5) if drives else None
        self.now_s = 50.0
        self.stamp_ns = 10**12
        self.offered: dict[tuple[str, int], list[ProposalInput]] = {}
        self.decisions: list[Decision] = []
        self.begun: list[int] = []
        self.manual: Command | None = None
        self.feedback: list[Command] = []
        self.calm = 0
        self.queue: list[tuple[float, str, ProposalInput]] = []

    # ---- one tick

    @rule(
        step_s=st.sampled_from([0.1, 0.1, 0.1, 0.1001, 0.02, 0.4, 1.5]),
        how=st.lists(behaviours, min_size=3, max_size=3),
        when=st.lists(delays, min_size=3, max_size=3),
        seen=st.lists(samples, min_size=3, max_size=3),
        force=numbers,
        speed=numbers,
        asleep=st.sampled_from([False] * 9 + [True]),
        tolerant=st.booleans(),
    )
    def tick(self, step_s, how, when, seen, force, speed, asleep, tolerant):
        """One measurement and what the controllers make of it.

        ``asleep``: the arbiter's timer does not run.
        """
        self.calm = 0 if step_s > 1.0 else self.calm + 1
        self.now_s += step_s
        self.stamp_ns += STEP_NS
        start_s = self.now_s
        self.begun.append(self.stamp_ns)
        if self.drives is not None:
            acting = self.decisions[-1].command if self.decisions else self.drives
            self.feedback = [*self.feedback[-1:], acting]
            self._take(self.arbiter.on_drives(self.stamp_ns, acting, start_s))
        for sensor, kind in zip(REQUIRED, seen, strict=True):
            if kind != "missing":
                value = {"nan": math.nan, "wild": force, "trip": TRIPPING[sensor]}.get(
                    kind, GOOD[sensor]
                )
                stamp = self.stamp_ns - (STEP_NS if kind == "old" else 0)
                self._take(self.arbiter.on_sample(sensor, stamp, value, start_s))
        # A tick that no input has announced does not exist for the arbiter.
        if self.drives is None and all(kind in ("missing", "old") for kind in seen):
            self.begun.pop()
        waiting, self.queue = self.queue, []
        for name, behaviour, delay in zip(NAMES, how, when, strict=True):
            waiting += self._proposals(name, behaviour, start_s + delay, force, speed)
        end_s = start_s + step_s * 0.9
        for at_s, name, proposal in sorted(waiting, key=lambda item: item[0]):
            if at_s > end_s:
                self.queue.append((at_s, name, proposal))
                continue
            if not asleep:
                self._run_timer(at_s)
            self.now_s = max(self.now_s, at_s)
            self.offered.setdefault((name, proposal.stamp_ns), []).append(proposal)
            self._take(self.arbiter.on_proposal(name, proposal, at_s))
            sensors = REQUIRED if tolerant else ()
            self._take(self.arbiter.on_status(name, sensors, name == "nmpc", at_s))
        if not asleep:
            self._run_timer(end_s)
        self.now_s = max(self.now_s, end_s)

    def _proposals(self, name, behaviour, at_s, force, speed):
        before = self.arbiter.applied or Command(78.4, 407.5)
        good = ProposalInput(
            self.stamp_ns, name, Command(min(before.force_kn + 0.5, 95.0), before.speed_rpm)
        )
        edits = {
            "wild": lambda: [replace(good, command=Command(force, speed))],
            "late": lambda: [replace(good, stamp_ns=self.stamp_ns - STEP_NS)],
            "old": lambda: [replace(good, stamp_ns=self.stamp_ns - 5 * STEP_NS)],
            "future": lambda: [replace(good, stamp_ns=self.stamp_ns + 50 * STEP_NS)],
            "early": lambda: [good, replace(good, stamp_ns=self.stamp_ns + STEP_NS)],
            "jump": lambda: [
                replace(good, command=Command(before.force_kn - 1.5, before.speed_rpm))
            ],
            "edge": lambda: [
                replace(
                    good,
                    command=Command(
                        max(before.force_kn - 1.0, 60.0), max(before.speed_rpm - 3.0, 300.0)
                    ),
                )
            ],
            "unhealthy": lambda: [replace(good, healthy=False, reason=Reason.of("x"))],
            "liar": lambda: [replace(good, source="decentral")],
            "twice": lambda: [
                good,
                replace(good, command=Command(before.force_kn, before.speed_rpm)),
            ],
            "silent": lambda: [],
            "good": lambda: [good],
        }
        return [(at_s, name, proposal) for proposal in edits[behaviour]()]

    def _run_timer(self, until_s):
        while (at_s := self.arbiter.wakeup_s) is not None and max(at_s, self.now_s) <= until_s:
            self.now_s = max(at_s, self.now_s)
            self._take(self.arbiter.on_time(self.now_s))

    def _take(self, decisions):
        for decision in decisions:
            self._check(decision)
            self.decisions.append(decision)
            self.arbiter.on_command(decision.stamp_ns, decision.source, decision.command)

    def _check(self, decision):
        command, limits = decision.command, self.settings.drive_limits
        assert math.isfinite(command.force_kn)
        assert math.isfinite(command.speed_rpm)
        assert limits.force_min_kn <= command.force_kn <= limits.force_max_kn
        assert limits.speed_min_rpm <= command.speed_rpm <= limits.speed_max_rpm
        # After a gap or a jump of the clock the drives' feedback counts, which a command may have
        # overtaken.
        starts = [self.decisions[-1].command] if self.decisions else []
        if self.decisions and self.calm < 3:
            starts += self.feedback
        assert not starts or any(self._in_rate(command, start) for start in starts)
        if decision.source == "manual":
            assert self.manual is not None
        elif decision.source in NAMES:
            # The source shown did propose for this very tick, and these values unless a transition
            # is named.
            answers = self.offered[decision.source, decision.stamp_ns]
            exact = any(
                math.isclose(answer.command.force_kn, command.force_kn, abs_tol=2e-6)
                and math.isclose(answer.command.speed_rpm, command.speed_rpm, abs_tol=2e-6)
                and answer.healthy
                for answer in answers
            )
            assert exact or decision.reason.code is ReasonCode.SLEWING
        elif decision.source == "hold":
            assert not starts or command in starts
        else:
            assert decision.source == "safe_stop"
            assert not starts or any(
                command.speed_rpm == start.speed_rpm and command.force_kn <= start.force_kn
                for start in starts
            )

    def _in_rate(self, command, start):
        limits = self.settings.drive_limits
        return (
            abs(command.force_kn - start.force_kn) <= limits.force_step_kn + 1e-9
            and abs(command.speed_rpm - start.speed_rpm) <= limits.speed_step_rpm + 1e-9
        )

    # ---- the operator and the graph

    @rule(
        name=st.sampled_from([*NAMES, "nobody", ""]),
        strict=st.booleans(),
        timeout_s=st.sampled_from([0.0, 0.3, 2.0, math.nan, -1.0]),
    )
    def ask_switch(self, name, strict, timeout_s):
        """The operator asks for a controller."""
        request = self.arbiter.operator.ask_switch(name, strict, timeout_s, "operator", self.now_s)
        assert not request.done or request.reply.fact.words

    @rule(
        mode=st.sampled_from(["auto", "auto", "manual", "hold", "safe_stop", "start", ""]),
        force=numbers,
    )
    def ask_mode(self, mode, force):
        """The operator asks for a mode."""
        requested = Command(force, 400.0)
        before = self.arbiter.machine.mode
        latched = before is Mode.SAFE_STOP and not self.arbiter.machine.acknowledged
        ok, fact = self.arbiter.operator.ask_mode(mode, requested, "operator")
        assert fact.words
        assert not (ok and latched) or mode == "safe_stop"
        if ok and mode == "manual":
            self.manual = requested

    @rule()
    def acknowledge(self):
        """The operator acknowledges a safe stop."""
        ok, fact = self.arbiter.operator.acknowledge("operator")
        assert fact.words
        safety = self.arbiter.safety
        unknown = safety.tripped or safety.invalid_sensors or not safety.judged
        assert ok == (self.arbiter.machine.mode is Mode.SAFE_STOP and not unknown)

    @rule(name=st.sampled_from(NAMES), joins=st.booleans())
    def graph_changes(self, name, joins):
        """A controller appears or disappears."""
        if joins:
            self.arbiter.registry.join(name)
        else:
            self.arbiter.registry.leave(name)

    @rule(force=numbers)
    def foreign_command(self, force):
        """Someone else writes on the command topic."""
        before = self.arbiter.watch.foreign_commands
        self.arbiter.on_command(self.stamp_ns, "stranger", Command(force, 400.0))
        assert self.arbiter.watch.foreign_commands == before + 1

    @rule(jump_s=st.sampled_from([-3600, 3600, -2]))
    def clock_jumps(self, jump_s):
        """The plant's clock jumps."""
        self.calm = 0
        self.stamp_ns += jump_s * 10**9 + 7 * len(self.begun)

    # ---- what always holds

    @invariant()
    def no_tick_twice(self):
        """No two commands for one measurement (unless its stamp came twice, after a jump back)."""
        if not hasattr(self, "decisions"):
            return
        for earlier, later in zip(self.decisions, self.decisions[1:], strict=False):
            assert earlier.stamp_ns != later.stamp_ns

    @invariant()
    def every_tick_is_answered(self):
        """Every tick that is over has its command, from the first command on."""
        if not hasattr(self, "decisions") or not self.decisions:
            return
        arbiter = self.arbiter
        open_ticks = 1 if arbiter.wakeup_s is not None else 0
        assert arbiter.machine.tick == arbiter.ticks.commands + arbiter.ticks.lost + open_ticks
        assert arbiter.ticks.commands == len(self.decisions)

    @invariant()
    def a_cause_means_a_safe_stop(self):
        """While an interlock is tripped nothing else is commanded.

        Nothing is acknowledged, either, unless what is tripped is the stop's own consequence.
        """
        if hasattr(self, "arbiter") and self.arbiter.safety.tripped:
            assert self.arbiter.machine.mode is Mode.SAFE_STOP
            if self.arbiter.machine.acknowledged:
                why = self.arbiter.safety.why_stop(acknowledged=True)
                assert why is None or why.code is not Code.CAUSE_PRESENT

    @invariant()
    def the_state_is_consistent(self):
        """An active controller exactly in auto; mode, table and log agree."""
        if not hasattr(self, "arbiter"):
            return
        machine = self.arbiter.machine
        assert (machine.mode is Mode.AUTO) == bool(machine.active)
        assert machine.reason
        if machine.mode is Mode.AUTO:
            assert self.arbiter.registry.get(machine.active) is not None


TestArbiterProperties = ArbiterMachine.TestCase
TestArbiterProperties.settings = hypothesis_settings(stateful_step_count=40, deadline=None)
