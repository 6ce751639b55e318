"""Lockstep: the wall clock only guards, and nothing depends on the timing of shadow controllers."""

from fsw_control.contract import Command
from fsw_control.reason import Lack
from fsw_supervisor.arbiter import Arbiter
from fsw_supervisor.parameters import SupervisorParameters
from fsw_supervisor.tick import ProposalInput

STEP_NS = 100_000_000
SENSORS = {"depth": 2.66, "torque": 1052.0, "thermocouple": 850.0}


def begin(arbiter, stamp_ns, now_s):
    out = arbiter.on_drives(stamp_ns, arbiter.applied or Command(78.4, 407.5), now_s)
    for sensor, value in SENSORS.items():
        out += arbiter.on_sample(sensor, stamp_ns, value, now_s)
    return out


def started(settings=None):
    """An arbiter after its first tick, which waits for what the controllers tell."""
    arbiter = Arbiter(settings or SupervisorParameters.from_values({}), lockstep=True)
    begin(arbiter, STEP_NS, 9.0)
    assert (
        propose(arbiter, "nmpc", STEP_NS, 9.0) + propose(arbiter, "decentral", STEP_NS, 9.0) == []
    )
    assert [d.source for d in arbiter.on_time(9.3)] == ["decentral"]
    return arbiter


def propose(arbiter, name, stamp_ns, now_s, change_kn=0.01):
    before = arbiter.applied or Command(78.4, 407.5)
    command = Command(before.force_kn + change_kn, before.speed_rpm)
    out = arbiter.on_proposal(name, ProposalInput(stamp_ns, name, command), now_s)
    return out + arbiter.on_status(name, (), False, now_s)


def test_a_slow_active_controller_is_waited_for():
    arbiter = Arbiter(SupervisorParameters.from_values({}), lockstep=True)
    assert begin(arbiter, STEP_NS, 10.0) == []
    assert arbiter.on_time(11.0) == []
    assert [d.source for d in propose(arbiter, "decentral", STEP_NS, 11.3)] == ["decentral"]


def test_a_dead_active_controller_is_replaced_at_the_guard():
    arbiter = started()
    for count in range(2, 8):
        begin(arbiter, count * STEP_NS, 10.0)
        out = propose(arbiter, "decentral", count * STEP_NS, 10.0) + propose(
            arbiter, "nmpc", count * STEP_NS, 10.0
        )
        assert len(out) == 1
    begin(arbiter, 8 * STEP_NS, 10.0)
    assert propose(arbiter, "nmpc", 8 * STEP_NS, 10.0) == []
    assert [d.source for d in arbiter.on_time(11.5)] == ["nmpc"]


def silent_after_some_ticks():
    """An arbiter in a tick that no controller has answered yet."""
    arbiter = started()
    for count in range(2, 8):
        begin(arbiter, count * STEP_NS, 10.0)
        propose(arbiter, "nmpc", count * STEP_NS, 10.0)
        propose(arbiter, "decentral", count * STEP_NS, 10.0)
    begin(arbiter, 8 * STEP_NS, 10.0)
    return arbiter


def test_a_slow_fallback_is_given_time_too():
    arbiter = silent_after_some_ticks()
    assert arbiter.on_time(11.5) == []
    assert [d.source for d in propose(arbiter, "nmpc", 8 * STEP_NS, 12.0)] == ["nmpc"]


def test_a_dead_fallback_ends_in_hold_all_the_same():
    arbiter = silent_after_some_ticks()
    assert arbiter.on_time(11.5) == []
    assert [d.source for d in arbiter.on_time(13.0)] == ["hold"]


def test_a_supervisor_that_was_stalled_itself_replaces_a_dead_controller_all_the_same():
    arbiter = silent_after_some_ticks()
    assert propose(arbiter, "nmpc", 8 * STEP_NS, 10.0) == []
    assert arbiter.on_time(11.6) == []  # a tenth of a second after the guard
    assert [d.source for d in arbiter.on_time(arbiter.wakeup_s)] == ["nmpc"]
    assert arbiter.ticks.stalls == 1


def test_an_answer_that_a_stalled_supervisor_has_not_read_yet_is_read_first():
    arbiter = silent_after_some_ticks()
    assert propose(arbiter, "nmpc", 8 * STEP_NS, 10.0) == []
    assert arbiter.on_time(60.0) == []
    assert [d.source for d in propose(arbiter, "decentral", 8 * STEP_NS, 60.7)] == ["decentral"]
    assert arbiter.registry.is_ready("decentral")


def test_shadows_that_keep_up_are_waited_for_and_dead_ones_once():
    arbiter = started()
    begin(arbiter, 2 * STEP_NS, 10.1)
    assert propose(arbiter, "decentral", 2 * STEP_NS, 10.1) == []
    assert [d.source for d in arbiter.on_time(10.6)] == ["decentral"]
    begin(arbiter, 3 * STEP_NS, 10.8)
    assert len(propose(arbiter, "decentral", 3 * STEP_NS, 10.8)) == 1


def test_with_no_shadow_wait_lagging_shadows_stay_warm():
    arbiter = started(SupervisorParameters.from_values({"lockstep_shadow_wait_s": 0.0}))
    for count in range(2, 20):
        begin(arbiter, count * STEP_NS, 10.0)
        assert len(propose(arbiter, "decentral", count * STEP_NS, 10.0, change_kn=0.0)) == 1
        if count > 4:
            propose(arbiter, "nmpc", (count - 3) * STEP_NS, 10.0)
    assert arbiter.registry.is_ready("nmpc")
    assert arbiter.registry.get("nmpc").late == 0


def test_the_applied_commands_do_not_depend_on_the_shadows_timing():
    runs = []
    for delay in (0.0, 0.3, 0.9):
        arbiter = Arbiter(SupervisorParameters.from_values({}), lockstep=True)
        commands = []
        for count in range(1, 30):
            now_s = 10.0 + 2.0 * count
            out = begin(arbiter, count * STEP_NS, now_s)
            out += propose(
                arbiter, "decentral", count * STEP_NS, now_s + 0.001, change_kn=(-1) ** count * 0.3
            )
            while (wakeup_s := arbiter.wakeup_s) is not None and wakeup_s <= now_s + delay:
                out += arbiter.on_time(wakeup_s)
            out += propose(arbiter, "nmpc", count * STEP_NS, now_s + delay)
            while (wakeup_s := arbiter.wakeup_s) is not None:
                out += arbiter.on_time(wakeup_s)
            assert len(out) == 1
            commands.append((out[0].stamp_ns, out[0].source, out[0].command))
        runs.append(commands)
    assert runs[0] == runs[1] == runs[2]


def test_a_tick_that_the_plant_sends_again_is_answered_again():
    arbiter = started()
    first = arbiter.ticks.last
    assert begin(arbiter, STEP_NS, 12.0) == [first]


def test_restarted_simulated_time_is_followed():
    arbiter = Arbiter(SupervisorParameters.from_values({}), lockstep=True)
    for count in (100, 101, 102, 1, 2, 3):
        begin(arbiter, count * STEP_NS, 10.0)
        out = propose(arbiter, "decentral", count * STEP_NS, 10.0) + arbiter.on_time(10.4)
        assert [d.stamp_ns for d in out] == [count * STEP_NS]
    assert "time_back" in [event.fact.code for event in arbiter.machine.events]


def test_timeouts_of_requests_count_in_ticks():
    arbiter = started()
    request = arbiter.operator.ask_switch("nmpc", False, 0.2, "operator", 10.0)
    for count in range(2, 6):
        begin(arbiter, count * STEP_NS, 10.01)
        propose(arbiter, "decentral", count * STEP_NS, 10.01)
        arbiter.on_time(10.6)
    assert (request.done, request.ok) == (True, False)
    why = request.reply.fact.data["reason"]
    assert request.reply.fact.code == "timed_out"
    assert why.data["readiness"].lack is Lack.WARMING


def test_answers_to_a_repeated_tick_are_no_second_controller_of_that_name():
    arbiter = started()
    for count in range(2, 8):
        for _ in range(2):
            begin(arbiter, count * STEP_NS, 10.0 + count)
            propose(arbiter, "decentral", count * STEP_NS, 10.0 + count, change_kn=0.0)
        arbiter.on_time(10.6 + count)
    assert arbiter.registry.get("decentral").doubled == 0
    assert "doubled" not in [event.fact.code for event in arbiter.machine.events]
