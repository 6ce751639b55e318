"""Whatever is lost, refused, late or cut: every write is near what the machine has.

And control always comes back.
"""

from math import isfinite

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from fsw_control import Command, Limits
from fsw_control.fence import Signature
from fsw_control.message_synchronizer import JUMP_NS
from fsw_control.parameters import defaults
from fsw_machine.gateway import Gateway
from fsw_machine.parameters import GatewayParameters

SPEED_RPM = 407.5
LIMITS = Limits()
#: the machine ramps the force down by itself when commands stay away: from this many cycles on, so
#: fast, so far
RAMP_CYCLES, RAMP_KN, SAFE_KN = 20, 0.1, 65.0


class Plc:
    """A machine that obeys, and a gateway that reads it.

    Set-points may be shown a cycle late, the load cell off.
    """

    def __init__(self, machine, read_of, late=0, offset_kn=0.0):
        self.gateway = Gateway(machine, defaults(GatewayParameters))
        self.gateway.on_connected()
        self._read_of, self._late, self._offset_kn = read_of, late, offset_kn
        self.counter, self.quiet, self.force_kn = 100, 0, 78.4
        self._shown = [78.4, 78.4]
        self.published = None
        self.orders = []
        self.asked = self.ordered = 0

    def cycle(self, steps=1, permissive=True):
        for _ in range(steps):
            self.counter, self.quiet = self.counter + 1, self.quiet + 1
            if self.quiet > RAMP_CYCLES:
                self.force_kn = min(self.force_kn, max(SAFE_KN, self.force_kn - RAMP_KN))
            self._shown = [self.force_kn, self._shown[0]]
        read = self._read_of(
            self.counter,
            steps=steps,
            permissive=permissive,
            force_in_force=self._shown[self._late],
            force_acting=self.force_kn + self._offset_kn,
        )
        self.published = self.gateway.on_read(read) or self.published
        self.gateway.fence.register.acknowledge("operator", 0)  # of the machine's own ramp

    def command(self, force_kn, after_s=0.02):
        if self.published is not None:
            now_s = self.counter * 0.1 + after_s
            requested = Command(force_kn, SPEED_RPM), self.published.stamp_ns
            signature = Signature(stop=self.gateway.fence.register.value)
            self.asked += 1
            self._wrote(self.gateway.on_command(*requested, "nmpc", True, now_s, signature))

    def _wrote(self, order):
        """The invariant: in the bounds, and within a move of what the machine has.

        Its own ramp may be under way.
        """
        if order is None:
            return
        self.ordered += 1
        force_kn = order.command.force_kn
        assert LIMITS.force_min_kn <= force_kn <= LIMITS.force_max_kn
        assert abs(force_kn - self.force_kn) <= LIMITS.force_step_kn + RAMP_KN * self._late + 1e-6
        self.orders.append(order)

    def take(self):
        """What has been sent reaches the machine."""
        if self.orders:
            self.force_kn, self.quiet = self.orders[-1].command.force_kn, 0

    def answer(self, failure=""):
        if self.orders:
            order, self.orders = self.orders[-1], []
            self._wrote(self.gateway.on_written(order, failure, self.counter * 0.1 + 0.05))

    def lose(self):
        """The connection: what was sent and has not arrived never does."""
        self.gateway.on_lost()
        self.orders = []


class Supervisor:
    """Begins from the drives after a gap, then moves by at most a move per tick from its own last command."""

    def __init__(self, force_kn):
        self._force_kn, self._stamp_ns = force_kn, None

    def tick(self, plc, move_kn):
        out = plc.published
        if out is None or out.stamp_ns == self._stamp_ns:
            return
        gap = self._stamp_ns is not None and out.stamp_ns - self._stamp_ns > JUMP_NS
        if gap:
            self._force_kn = None
        self._stamp_ns = out.stamp_ns
        if self._force_kn is None and isfinite(out.drives.force_kn):
            self._force_kn = out.drives.force_kn
        if self._force_kn is not None:
            force_kn = self._force_kn if gap else self._force_kn + move_kn
            self._force_kn = min(
                max(force_kn + gap * move_kn, LIMITS.force_min_kn), LIMITS.force_max_kn
            )
            plc.command(self._force_kn)


move = st.sampled_from([-1.0, -0.4, 0.0, 0.4, 1.0])
fate = st.sampled_from(["taken", "taken", "refused", "lost", "silent", "late"])
events = st.one_of(
    st.tuples(st.just("ticks"), move, st.lists(fate, min_size=1, max_size=8)),
    st.tuples(
        st.just("command"),
        st.sampled_from([60.0, 70.0, 78.0, 79.3, 95.0, 300.0]),
        st.floats(0.0, 0.4),
    ),
    st.tuples(st.just("quiet"), st.integers(1, 40), st.booleans()),
    st.tuples(st.just("answer"), st.sampled_from(["", "refused"]), st.none()),
    st.tuples(st.just("cut"), st.booleans(), st.none()),
)


def happen(plc, supervisor, happened):
    for action, first, second in happened:
        if action == "ticks":
            for report in second:
                plc.cycle()
                supervisor.tick(plc, first)
                if report in (
                    "taken",
                    "silent",
                    "late",
                ):  # silent: arrived, but the answer is lost; late: comes later
                    plc.take()
                if report != "late":
                    plc.answer({"taken": ""}.get(report, report))
        elif action == "command":
            plc.command(first, second)
        elif action == "quiet":
            plc.cycle(first, second)
        elif action == "answer":
            if not first:
                plc.take()
            plc.answer(first)
        else:
            plc.lose()
            if first:
                plc.gateway.on_connected()


@pytest.mark.requirement("S32")
@example(
    happened=[("ticks", -1.0, ["late", "taken", "taken", "taken", "silent", "refused"])], late=1
)
@example(
    happened=[
        ("ticks", -1.0, ["late"]),
        ("ticks", 0.0, ["taken"]),
        ("ticks", -1.0, [*["taken"] * 4, "refused"]),
    ],
    late=1,
)
@given(happened=st.lists(events, max_size=20), late=st.sampled_from([0, 1]))
def test_every_write_is_near_what_the_machine_has(machine, read_of, happened, late):
    happen(Plc(machine, read_of, late), Supervisor(78.4), happened)


@example(happened=[("ticks", 0.0, ["late"] * 6)])
@given(happened=st.lists(events, max_size=20))
def test_every_command_is_written_or_its_refusal_reported(machine, read_of, happened):
    plc = Plc(machine, read_of)
    happen(plc, Supervisor(78.4), happened)
    plc.lose()  # what still waits is refused
    assert plc.ordered + plc.gateway.gate.total() == plc.asked


@pytest.mark.requirement("S33")
@given(
    st.lists(events, max_size=15),
    st.sampled_from([0, 1]),
    st.floats(60.0, 95.0),
    st.floats(-4.0, 4.0),
    st.lists(move, min_size=90, max_size=90),
)
def test_when_all_is_well_commands_are_written_again_and_go_on(
    machine, read_of, happened, late, begin_kn, offset_kn, moves
):
    """Within two pauses and what is lost before them, whatever was before, and whatever a load cell adds."""
    plc, supervisor = Plc(machine, read_of, late, offset_kn), Supervisor(begin_kn)
    happen(plc, supervisor, happened)
    plc.take()
    plc.answer()
    plc.gateway.on_connected()
    written = []
    for move_kn in moves:
        plc.cycle()
        before = plc.gateway.written
        supervisor.tick(plc, move_kn)
        plc.take()
        plc.answer()
        written.append(plc.gateway.written > before)
    first = written.index(True)
    assert first <= 50 and all(written[50:])
