"""The closed loop in one process."""

import numpy as np
import pytest

from fsw_control.contract import Coming, Command, Limits, Measurement, Proposal, Reference
from fsw_control.schema.models import InputError
from fsw_decentral import DecentralController
from fsw_model import ProcessModel
from fsw_plant import PlantEmulator
from fsw_scenario import scenario_file
from fsw_scenario.closed_loop import ClosedLoop, OfflineSupervisor
from fsw_scenario.controllers import make


def run(name, controllers=None, overrides=()):
    return ClosedLoop(scenario_file.load(name, overrides), controllers).run()


def test_set_points_are_reached_and_limits_hold():
    signals = run(
        "reference_tracking",
        {"decentral": DecentralController({"tuning": "tight"})},
        ["plant.noise=false"],
    )
    assert signals.n_ticks == 2400
    assert signals.stamp_ns[0] == 100_000_000
    assert abs(signals.truth.depth_mm[595] - signals.reference_depth_mm[595]) < 0.01
    assert abs(signals.truth.temperature_c[1590] - signals.reference_temperature_c[1590]) < 10.0
    limits = Limits()
    assert np.abs(np.diff(signals.force_kn)).max() <= limits.force_step_kn + 1e-9
    assert np.abs(np.diff(signals.speed_rpm)).max() <= limits.speed_step_rpm + 1e-9
    assert set(signals.command_source) == {"decentral"}


def test_same_seed_same_weld():
    first, second = (run("quick", {"decentral": DecentralController()}) for _ in range(2))
    other = run("quick", {"decentral": DecentralController()}, ["plant.seed=8"])
    assert np.array_equal(first.depth_mm, second.depth_mm)
    assert np.array_equal(first.speed_rpm, second.speed_rpm)
    assert not np.array_equal(first.depth_mm, other.depth_mm)


def test_a_shadow_controller_changes_nothing():
    alone = run("quick", {"decentral": make("decentral")})
    shadow = make("decentral:tight")
    shadow.name = "shadow"
    together = run("quick", {"decentral": make("decentral"), "shadow": shadow})
    assert np.array_equal(alone.force_kn, together.force_kn)
    assert not np.array_equal(together.proposals["shadow"].force_kn, together.force_kn)


def test_open_loop_follows_the_commands_within_the_move_limits():
    signals = run("open_loop_force_steps")
    assert signals.force_kn[48] == pytest.approx(78.4)
    assert signals.force_kn[49] == pytest.approx(79.4)  # tick 50, stamp 5 s
    assert signals.force_kn[50] == pytest.approx(80.4)
    assert np.ptp(signals.speed_rpm) == 0.0
    assert set(signals.command_source) == {"open_loop"}


def test_disturbance_acts_at_its_tick():
    signals = run(
        "output_disturbances", {"decentral": DecentralController()}, ["plant.noise=false"]
    )
    steps = np.flatnonzero(np.diff(signals.truth.depth_disturbance_mm))
    assert steps.tolist() == [198]  # from tick 199 to tick 200
    assert signals.depth_mm[199] - signals.depth_mm[198] == pytest.approx(0.1, abs=1e-4)


class Failing:
    name = "decentral"
    tolerated_sensors = ()

    def __init__(self, fails_from, fails_until=10**9):
        self.fails_from, self.fails_until = fails_from, fails_until
        self.steps = 0

    def step(self, measurement, reference, applied, dt_s):
        self.steps += 1
        if self.fails_from < self.steps <= self.fails_until:
            raise RuntimeError("broken on purpose")
        return Proposal(Command(applied.force_kn, applied.speed_rpm))

    def reset(self, applied):
        self.steps = 0


def test_a_failing_controller_is_replaced_and_without_another_the_command_is_held():
    backup = make("decentral")
    replaced = run("quick", {"decentral": Failing(100), "backup": backup})
    assert set(replaced.command_source[:100]) == {"decentral"}
    assert set(replaced.command_source[100:]) == {"backup"}
    held = run("quick", {"decentral": Failing(100)})
    assert set(held.command_source[100:]) == {"hold"}
    assert np.ptp(held.force_kn) == 0.0


def test_recovered_controller_stays_on_standby():
    signals = run("quick", {"decentral": Failing(100, 105), "backup": make("decentral")})
    assert set(signals.command_source[100:]) == {"backup"}
    assert set(signals.actual_controller[100:]) == {"backup"}
    assert signals.proposals["decentral"].healthy[100] == 0.0
    assert signals.proposals["decentral"].healthy[105] == 1.0


def test_several_controllers_stop_safely_when_all_have_failed():
    other = Failing(100)
    other.name = "other"
    signals = run("quick", {"decentral": Failing(100), "other": other})
    assert set(signals.actual_mode[:100]) == {"auto"}
    assert set(signals.command_source[100:200]) == {"hold"}
    assert set(signals.command_source[201:]) == {"safe_stop"}
    assert np.all(np.diff(signals.force_kn[201:]) <= 0.0)


def test_switch_takes_place_at_its_tick(tmp_path):
    path = tmp_path / "switch.yaml"
    path.write_text(
        "{name: s, duration_s: 5.0, controller: decentral, events: [{at_s: 2.0, switch: other}]}"
    )
    other = make("decentral:tight")
    signals = ClosedLoop(
        scenario_file.load(path), {"decentral": make("decentral"), "other": other}
    ).run()
    assert signals.command_source[18] == "decentral"
    assert signals.command_source[19] == "other"


def test_missing_controller_is_a_clear_error():
    with pytest.raises(InputError, match="controller decentral"):
        ClosedLoop(scenario_file.load("quick"))
    with pytest.raises(InputError, match=r"nobody .*: decentral, nmpc"):
        make("nobody")
    with pytest.raises(InputError, match="conservative', 'tight"):
        make("decentral:wild")


def test_progress_rises_from_0_to_1():
    shares = []
    ClosedLoop(scenario_file.load("quick"), {"decentral": make("decentral")}).run(shares.append)
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


def announced_steps(noise=False):
    text = """
        {name: announced, duration_s: 100.0, controller: nmpc, announced: true, events: [
          {at_s: 20.0, reference: {depth_mm: 2.86}}, {at_s: 60.0, reference: {temperature_c: 826.4}}]}"""
    return [f"plant.noise={str(noise).lower()}"], text


@pytest.mark.slow
def test_announced_set_points_are_prepared_for():
    overrides, text = announced_steps()

    def errors(extra):
        scenario = scenario_file.parse(text, "announced", [*overrides, *extra])
        signals = ClosedLoop(scenario, {"nmpc": make("nmpc")}).run()
        depth = np.abs(signals.truth.depth_mm - signals.reference_depth_mm).sum()
        return depth, np.abs(signals.truth.temperature_c - signals.reference_temperature_c).sum()

    ahead, behind = errors([]), errors(["announced=false"])
    assert ahead[0] < 0.5 * behind[0]
    assert ahead[1] < 0.5 * behind[1]


@pytest.mark.slow
def test_withdrawn_or_ignored_announcement_causes_no_bump():
    """A plan appears, is changed and taken back while the weld rests.

    The moves stay those of an approach.
    """
    controller, limits = make("nmpc"), Limits()
    applied = Command(78.4, 407.576)
    controller.reset(applied)
    model = ProcessModel()
    state, moves, depths = model.equilibrium().state.copy(), [], []
    plans = {10: (Coming(6.0, 2.9, 816.4),), 30: (Coming(9.0, 2.4, 830.0),), 50: ()}
    coming = ()
    for k in range(300):
        coming = plans.get(k, coming)
        shown = model.outputs(state, applied.force_kn, applied.speed_rpm)
        measurement = Measurement(
            0.1 * k, shown.depth_mm, shown.motor_torque_nm, shown.temperature_c
        )
        proposal = controller.step(measurement, Reference(2.66, 816.4, coming), applied, 0.1)
        assert proposal.healthy
        moves.append(abs(proposal.command.force_kn - applied.force_kn))
        applied = limits.clip(proposal.command, applied)
        model.step(state, applied.force_kn, applied.speed_rpm)
        depths.append(shown.depth_mm)
    assert max(moves) <= limits.force_step_kn + 1e-9
    assert depths[-1] == pytest.approx(2.66, abs=1e-3)
    assert max(abs(depth - 2.66) for depth in depths) < 0.15


def test_decentralized_controller_ignores_announcements():
    overrides, text = announced_steps()
    runs = []
    for extra in ("announced=true", "announced=false"):
        scenario = scenario_file.parse(
            text, "announced", [*overrides, "controller=decentral", extra]
        )
        runs.append(ClosedLoop(scenario, {"decentral": make("decentral")}).run())
    assert np.array_equal(runs[0].force_kn, runs[1].force_kn)


@pytest.mark.requirement("S25")
@pytest.mark.parametrize("acknowledged_after_s", [1.0, 30.0, 90.0, 200.0])
def test_a_safe_stop_can_be_acknowledged_however_long_it_lasts(acknowledged_after_s):
    """The tool rises to the surface and the copper cools: both are the stop's own doing."""
    plant, stop = PlantEmulator(), 20
    supervisor = OfflineSupervisor({"decentral": DecentralController()}, "decentral")
    arbiter, acknowledged = supervisor._arbiter, []
    for tick in range(2500):
        reading = plant.measure()
        proposal = {"decentral": Proposal(Command(78.4, 407.0))}
        decision = supervisor.decide(reading.stamp_ns, reading.values, reading.drives, proposal)
        if tick == stop:
            assert arbiter.operator.ask_mode("safe_stop", None, "operator").ok
        if tick == stop + 10 * acknowledged_after_s:
            acknowledged.append(arbiter.operator.acknowledge("operator").ok)
        plant.apply(decision.command, reading.stamp_ns, decision.source)
        plant.step()
    assert acknowledged == [True]
    assert arbiter.machine.acknowledged
    assert set(arbiter.safety.tripped) == {"depth_low", "temperature_low"}
    assert not arbiter.operator.ask_mode("auto", None, "operator").ok
