"""Arbiter and gateway in one loop, without a middleware: a PLC ramps down by itself.

Once the operator has acknowledged that, control comes back.
"""

from importlib import resources
from math import isfinite

import pytest

from fsw_control import Command
from fsw_control.fence import Signature
from fsw_control.parameters import defaults
from fsw_control.units import NANOSECONDS
from fsw_machine.gateway import Gateway
from fsw_machine.machine_file import MachineFile
from fsw_machine.parameters import GatewayParameters
from fsw_machine.samples import CycleRead, RawValue
from fsw_supervisor import Arbiter, ProposalInput, SupervisorParameters
from fsw_supervisor.state_machine import Mode
from fsw_test_support.short_times import any_residual

_TICK_S = 0.1
_START_NS = 1_700_000_000 * NANOSECONDS
_TORQUE_NM_PER_KN = 12.84
_VALUES = {"depth": 2.66, "torque": 1052.0, "thermocouple": 850.0}
#: of the PLC: cycles without a set-point until it ramps, the ramp and its end
_PATIENCE, _RAMP_KN, _SAFE_KN = 5, 0.2, 60.0
#: two takeovers, of which the first may be refused, each after a pause and with a start
_BOUND_TICKS = 45


class Loop:
    """PLC, gateway, arbiter and two controllers, cycle by cycle.

    Attributes
    ----------
    late : bool
        Commands reach the gateway too late to be written: it goes on reporting drives that do not
        obey.
    push : Command
        What a load cell sees besides the set-points.
    """

    def __init__(self):
        self.gateway = Gateway(
            MachineFile.parse((resources.files("fsw_machine") / "machine.yaml").read_text()),
            defaults(GatewayParameters),
        )
        self.gateway.on_connected()
        # this depth does not follow the force
        self.arbiter = Arbiter(SupervisorParameters.from_values(any_residual("depth")))
        self.in_force, self.push, self.late = Command(78.4, 407.5), Command(0.0, 0.0), False
        self.counter, self.silent, self.first = 100, 0, []

    def _read(self):
        acting = Command(
            self.in_force.force_kn + self.push.force_kn,
            self.in_force.speed_rpm + self.push.speed_rpm,
        )
        values = {"permissive": True, "depth": 2.66, "torque": 1052.0, "temperature": 850.0}
        values |= {"force_acting": acting.force_kn, "speed_acting": acting.speed_rpm}
        values |= {
            "force_in_force": self.in_force.force_kn,
            "speed_in_force": self.in_force.speed_rpm,
        }
        source_ns = _START_NS + self.counter * NANOSECONDS // 10
        raw = {name: RawValue(value, source_ns=source_ns) for name, value in values.items()}
        return CycleRead(self.counter, raw, source_ns, self.counter * _TICK_S, source_ns, 1)

    def tick(self):
        """One cycle; whether a command was written."""
        self.counter += 1
        self.silent += 1
        if self.silent > _PATIENCE:
            self.in_force = Command(
                max(_SAFE_KN, self.in_force.force_kn - _RAMP_KN), self.in_force.speed_rpm
            )
        arbiter, now_s, out = self.arbiter, self.counter * _TICK_S, []
        seen = self.gateway.on_read(self._read())
        if seen is not None:
            arbiter.on_actuator(self.gateway.fence.state)
            if isfinite(seen.drives.force_kn):
                out += arbiter.on_drives(seen.stamp_ns, seen.drives, now_s)
            values = _VALUES | {
                "torque": _VALUES["torque"] + _TORQUE_NM_PER_KN * (self.in_force.force_kn - 78.4)
            }
            for sensor, value in values.items():
                out += arbiter.on_sample(sensor, seen.stamp_ns, value, now_s)
            for name in ("decentral", "nmpc"):
                before = arbiter.applied or self.in_force
                force_kn = before.force_kn + min(max(78.4 - before.force_kn, -0.5), 0.5)
                proposal = ProposalInput(seen.stamp_ns, name, Command(force_kn, before.speed_rpm))
                out += arbiter.on_proposal(name, proposal, now_s + 0.005)
                out += arbiter.on_status(name, (), name == "decentral", now_s + 0.006)
        while (at_s := arbiter.wakeup_s) is not None and at_s < now_s + _TICK_S:
            out += arbiter.on_time(at_s)
        out += arbiter.on_time(now_s + 0.99 * _TICK_S)
        written = False
        for decision in out:
            arbiter.on_command(decision.stamp_ns, decision.source, decision.command)
            at_s = now_s + (0.3 if self.late else 0.02)
            signature = Signature(1, "m", arbiter.machine.register.value)
            order = self.gateway.on_command(
                decision.command, decision.stamp_ns, decision.source, True, at_s, signature
            )
            if order is not None:
                self.gateway.on_written(order, "", at_s)
                self.in_force, self.silent, written = order.command, 0, True
        return written

    def run(self, ticks):
        return [self.tick() for _ in range(ticks)]

    def resume(self):
        """The operator acknowledges the safe stop, and asks for auto."""
        operator = self.arbiter.operator
        assert not operator.ask_mode("auto", None, "operator")[0]
        assert operator.acknowledge("operator")[0]
        assert operator.ask_mode("auto", None, "operator")[0]


@pytest.mark.requirement("S25", "S33")
@pytest.mark.parametrize("late_ticks", [8, 12, 20, 60, 200])
@pytest.mark.parametrize("push", [Command(0.0, 0.0), Command(4.0, 0.0), Command(-3.0, 9.0)])
@pytest.mark.parametrize("slowly", [False, True])
def test_after_a_plcs_own_ramp_control_comes_back_in_bounded_time(late_ticks, push, slowly):
    loop = Loop()
    assert all(loop.run(20))
    for step in range(1, 101):
        share = step / 100.0 if slowly else 1.0
        loop.push = Command(share * push.force_kn, share * push.speed_rpm)
        assert loop.tick()
    loop.late = True
    assert not any(loop.run(late_ticks))
    assert loop.in_force.force_kn < 78.4
    loop.late = False
    before_kn = loop.in_force.force_kn
    loop.run(_BOUND_TICKS)
    assert loop.arbiter.machine.mode is Mode.SAFE_STOP
    assert loop.in_force.force_kn <= before_kn, "no control after a safe reaction"
    loop.resume()
    assert all(loop.run(40)[20:]), f"{loop.gateway.gate.last}; {loop.arbiter.machine.reason.words}"
    assert loop.arbiter.machine.mode is Mode.AUTO
    assert loop.arbiter.machine.active == "decentral"


@pytest.mark.parametrize("push", [Command(2.0, 0.0), Command(-6.0, 9.0)])
def test_a_start_with_a_load_cell_that_is_off_comes_to_control(push):
    loop = Loop()
    loop.push = push
    loop.run(_BOUND_TICKS)
    assert all(loop.run(20))
    assert loop.arbiter.machine.mode is Mode.AUTO
