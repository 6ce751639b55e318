"""Fusion of the depth channels.

Faults are named and do no harm, and what it cannot know it says.
"""

import math
from itertools import product

import numpy as np
import pytest

from fsw_control import weld
from fsw_control.depth_bank import DepthBank
from fsw_control.depth_channels import CHANNELS, ChannelHealth, DepthChannel, DepthFusionSettings
from fsw_control.depth_edges import SurfaceEdges
from fsw_control.depth_footprint import Footprint, SensorBias
from fsw_control.depth_fusion import DepthFusion

GOOD, MISSING, OUT_OF_RANGE, SPIKE, STUCK, SLIP, DRIFT, DUST, SUSPECT, STEPPED, _ = ChannelHealth
AT_S = 60.0  #: of a fault
MM_PER_S = 2.0
ALL = tuple(CHANNELS)
#: by name, what a fault makes of a sample after a time, and what it may be called
FAULTS = {
    "slip": (lambda y, since_s, r: y + 0.3, {SPIKE, SLIP}),
    "small slip": (lambda y, since_s, r: y - 0.06, {SPIKE, SLIP, DRIFT, STEPPED}),
    "drift": (lambda y, since_s, r: y + 0.03 * since_s, {SPIKE, SLIP, DRIFT, STEPPED}),
    "spike": (lambda y, since_s, r: y + (round(10 * since_s) % 10 == 0), {SPIKE}),
    "stuck": (lambda y, since_s, r: 2.6543, {SPIKE, SLIP, STUCK, DRIFT, STEPPED}),
    "dust": (
        lambda y, since_s, r: y + 0.1 * r.normal() if r.random() < 0.8 else math.nan,
        {SPIKE, DUST, MISSING},
    ),
    "out of range": (lambda y, since_s, r: 9.0, {OUT_OF_RANGE, STUCK}),
    "nan": (lambda y, since_s, r: math.nan, {MISSING}),
    "dropout": (lambda y, since_s, r: None, {MISSING}),
}


def torque_nm(force_kn, depth_mm, speed_rpm):
    """Torque about the operating point, by the slopes of the paper's (19)-(23)."""
    return 1053.0 + 12.84 * (force_kn - weld.FORCE_KN) + 120.8 * (depth_mm - weld.DEPTH_MM)


class Weld:
    """A weld with channels as the estimator expects them."""

    def __init__(self, seed=0, names=ALL, fault=None, torque=None, shared_mm=0.0, edges=None):
        self.random = np.random.default_rng(seed)
        self.rows = {name: CHANNELS[name] for name in names}
        self.fusion = DepthFusion(channels=self.rows, torque_model=torque)
        draw = self.random.normal
        self.bias = {name: draw(0.0, row.bias_deviation_mm) for name, row in self.rows.items()}
        self.deflection = {
            name: row.deflection_mm_per_kn + draw(0.0, row.deflection_deviation_mm_per_kn)
            for name, row in self.rows.items()
        }
        self.growth_mm = self.random.uniform(0.0, 0.3)
        self.fault, self.shared_mm, self.hardness = fault or {}, shared_mm, 1.0
        self.edges, self.travel_mm = edges, math.nan if edges is None else 0.0
        self.mm_per_s = MM_PER_S
        self.time_s, self.force_kn, self.depth_mm = 0.0, weld.FORCE_KN, weld.DEPTH_MM
        self.estimates, self.errors_mm = [], []

    def run(self, seconds):
        """Let time pass."""
        draw = self.random.normal
        for _ in range(round(10 * seconds)):
            self.time_s += weld.TICK_S
            self.force_kn += 0.3 * draw() - 0.02 * (self.force_kn - weld.FORCE_KN)
            self.depth_mm += 2e-4 * draw() - 0.01 * (self.depth_mm - weld.DEPTH_MM)
            estimate = self.fusion.update(
                self.time_s,
                self.samples(),
                self.force_kn,
                self.hardness * torque_nm(self.force_kn, self.depth_mm, 0.0) + 2.0 * draw(),
                43.6,
                weld.SPEED_RPM,
                travel_mm=self.travel_mm,
            )
            self.travel_mm += 0.1 * self.mm_per_s
            self.estimates.append(estimate)
            self.errors_mm.append(estimate.depth_mm - self.depth_mm)
        return self

    def samples(self):
        """What the channels show."""
        grown, since_s = 1.0 - math.exp(-self.time_s / 900.0), self.time_s - AT_S
        errors = {}
        for name, row in self.rows.items():
            shown = self.depth_mm + self.bias[name] + row.growth_share * self.growth_mm * grown
            shown += self.deflection[name] * (self.force_kn - weld.FORCE_KN) + self.shared_mm
            shown = round(shown + row.noise_mm * self.random.normal(), 4)
            shown -= self.surface_mm(0.0)
            shown += self.surface_mm(row.lead_mm) if row.rides else 0.0
            is_wrong = name in self.fault and since_s >= 0.0
            errors[name] = self.fault[name](shown, since_s, self.random) if is_wrong else shown
        return errors

    def surface_mm(self, ahead_mm):
        """Height of the surface, by its edges: heights by their places."""
        reached_mm = self.travel_mm + ahead_mm
        return sum(h for at_mm, h in (self.edges or {}).items() if reached_mm >= at_mm)

    def seen(self, name):
        """Health of a channel that was reported."""
        return {estimate.health[name] for estimate in self.estimates}


@pytest.mark.parametrize(("fault", "channel"), list(product(FAULTS, ALL)))
def test_a_wrong_channel_is_named_and_does_no_harm(fault, channel):
    """Within three seconds, and without blaming another one."""
    change, names = FAULTS[fault]
    weld_ = Weld(3, fault={channel: change}).run(AT_S - 0.1)
    before = np.mean(weld_.errors_mm[-100:])
    assert weld_.seen(channel) == {GOOD}
    weld_.estimates.clear()
    weld_.run(3.0)
    assert weld_.seen(channel) & names
    weld_.run(17.0)
    assert weld_.seen(channel) <= names | {GOOD, SUSPECT}
    for other in set(ALL) - {channel}:
        assert weld_.seen(other) <= {GOOD, SUSPECT}
    assert np.abs(np.array(weld_.errors_mm[-200:]) - before).max() < 0.03


@pytest.mark.parametrize("channel", ALL)
def test_slow_drift_is_found_and_a_step_as_large_is_forgiven(channel):
    """Both are watched at first; the bias is then found again."""
    drift = Weld(3, fault={channel: lambda y, since_s, r: y + 0.002 * since_s})
    step = Weld(3, fault={channel: lambda y, since_s, r: y + 0.03})
    for w in (drift, step):
        w.run(AT_S + 15.0)
        before = np.mean(w.errors_mm[-250:-150])
        assert STEPPED in w.seen(channel)
        w.run(25.0)
        assert np.abs(np.array(w.errors_mm[-400:]) - before).max() < 0.03
    assert drift.estimates[-1].health[channel] is DRIFT
    assert step.estimates[-1].used == ALL


@pytest.mark.parametrize("channel", ALL)
def test_a_channel_that_has_stood_still_since_the_start_is_stuck(channel):
    """The noise of the others shows it; without any noise, nothing does."""
    w, frozen = Weld(3), Weld(3, fault={channel: lambda y, since_s, r: 2.7})
    w.run(3.0)
    frozen.time_s = AT_S
    frozen.run(3.0)
    assert frozen.estimates[-1].health[channel] is STUCK
    frozen.run(5.0)
    w.run(5.0)
    assert abs(frozen.errors_mm[-1]) < abs(w.errors_mm[-1]) + 0.03
    still, shown = DepthFusion(), dict.fromkeys(ALL, 2.7)
    estimates = [still.update(0.1 * k, shown, weld.FORCE_KN) for k in range(1, 50)]
    assert set(estimates[-1].health.values()) == {GOOD}


@pytest.mark.parametrize("wrong", [("lvdt_lead", "lvdt_trail"), ("laser", "axial")])
def test_two_channels_wrong_from_the_start_leave_no_error(wrong):
    """Found in the same tick: no filter has been without both."""
    stuck = Weld(3, fault=dict.fromkeys(wrong, lambda y, since_s, r: weld.DEPTH_MM + 0.1))
    without = Weld(3, fault=dict.fromkeys(wrong, FAULTS["nan"][0]))
    for w in (stuck, without):
        w.time_s = AT_S
        w.run(6.0)
    last = stuck.estimates[-1], without.estimates[-1]
    assert {last[0].health[name] for name in wrong} == {STUCK}
    assert last[0].depth_mm == pytest.approx(last[1].depth_mm, abs=1e-4)
    assert last[0].deviation_mm == pytest.approx(last[1].deviation_mm, rel=1e-3)


@pytest.mark.parametrize("wrong", [("lvdt_lead", "laser"), ("lvdt_trail", "axial")])
def test_two_channels_excluded_in_turn_leave_no_error(wrong):
    """A filter has been without both."""
    drifts = {
        name: lambda y, since_s, r, rate=rate: y + rate * since_s
        for name, rate in zip(wrong, (0.02, 0.005), strict=True)
    }
    both, without = Weld(3, fault=drifts), Weld(3)
    samples = without.samples
    without.samples = lambda: {
        name: None if name in wrong else value for name, value in samples().items()
    }
    for w in (both, without):
        w.run(AT_S + 40.0)
    health = both.estimates[-1].health
    assert all(health[name] in (SLIP, DRIFT) for name in wrong)
    assert both.estimates[-1].depth_mm == pytest.approx(without.estimates[-1].depth_mm, abs=0.002)


def test_a_bank_that_begins_again_still_knows_the_edges():
    """The one below the tool, and the one that has passed.

    The axial position shows it for good.
    """
    bank = DepthBank(DepthFusionSettings(), CHANNELS)
    bank.start(2.7)
    for slot, height_mm in enumerate((0.1, 0.2)):
        bank.begin_edge(slot, height_mm, 0.005)
        bank.edge_shares[:, slot] = 0.0, 0.0, -1.0, -1.0
    bank.edge_shares[2, 0] = 0.0
    bank.end_edge(0)
    bank.start(2.6)
    assert bank.edge_mm(1) == 0.2
    bank.innovate(np.array([2.6, 2.6, 2.4, 2.3]), 0.0)
    assert bank.z == pytest.approx(0.0, abs=1e-12)


def test_good_channels_are_never_blamed():
    """And the error is what the deviation says."""
    welds = [Weld(seed).run(100.0) for seed in range(4)]
    assert {health for w in welds for name in ALL for health in w.seen(name)} == {GOOD}
    assert all(w.estimates[-1].used == ALL for w in welds)
    errors = [w.errors_mm[-1] / w.estimates[-1].deviation_mm for w in welds]
    assert 0.1 < np.sqrt(np.mean(np.square(errors))) < 2.0


@pytest.mark.parametrize("height_mm", [0.1, -0.3])
@pytest.mark.parametrize("out", [None, "laser", "lvdt_lead"])
def test_edge_is_not_reported_as_a_slip_and_leaves_the_depth(height_mm, out):
    """A channel that sees it first is out until another, or the tool, has met it."""
    fault = {out: FAULTS["nan"][0]} if out else None
    w = Weld(7, fault=fault, edges={AT_S * MM_PER_S + 80.0: height_mm}).run(AT_S)
    before = np.mean(w.errors_mm[-100:])
    w.run(90.0)
    assert np.abs(np.array(w.errors_mm[-900:]) - before).max() < 0.03
    assert STEPPED in w.seen("laser" if out == "lvdt_lead" else "lvdt_lead")
    for name in set(ALL) - {out}:
        assert w.seen(name) <= {GOOD, SPIKE, STEPPED}
        assert w.estimates[-1].health[name] is GOOD


def test_edge_missed_by_the_foremost_channel_is_not_a_slip_of_the_next():
    """It had passed the foremost at the touch-off."""
    w = Weld(7, edges={54.0: 0.1})
    w.bias["lvdt_lead"] -= 0.1
    w.run(40.0)
    assert STEPPED in w.seen("laser")
    assert {health for name in ALL for health in w.seen(name)} <= {GOOD, SPIKE, STEPPED}
    assert w.estimates[-1].used == ALL


@pytest.mark.parametrize("height_mm", [0.02, -0.03])
def test_no_channel_is_blamed_for_a_small_edge(height_mm):
    """Whichever notices it."""
    for at_mm in (65.0, 80.0):
        w = Weld(8, edges={at_mm: height_mm}).run(90.0)
        assert {health for name in ALL for health in w.seen(name)} <= {GOOD, SPIKE, STEPPED}
        assert w.estimates[-1].used == ALL


@pytest.mark.parametrize("slip_mm", [0.1, 1.0])
def test_a_slip_of_the_foremost_channel_is_one_where_no_other_sees_an_edge(slip_mm):
    """It is not used meanwhile."""
    fault = {"lvdt_lead": lambda y, since_s, r: y + slip_mm}
    w = Weld(8, fault=fault, edges={}).run(AT_S + 1.0)
    assert w.estimates[-1].health["lvdt_lead"] is STEPPED
    assert "lvdt_lead" not in w.estimates[-1].used
    w.run((60.0 - 45.0) / MM_PER_S + 2.0)
    assert w.estimates[-1].health["lvdt_lead"] is SLIP


@pytest.mark.parametrize(
    ("channel", "ahead_mm"),
    [
        ("lvdt_lead", -8.0),
        ("lvdt_lead", -1.2),
        ("lvdt_lead", 8.0),
        ("laser", 1.0),
        ("axial", 45.5),
    ],
)
def test_only_the_channel_that_slips_while_an_edge_is_undecided_is_blamed(channel, ahead_mm):
    """Whether it has met the edge before or meets it after the slip."""
    at_mm = AT_S * MM_PER_S + CHANNELS[channel].lead_mm + ahead_mm
    fault = {channel: lambda y, since_s, r: y - 0.1}
    w = Weld(7, fault=fault, edges={at_mm: 0.15}).run(AT_S)
    before = np.mean(w.errors_mm[-100:])
    w.run(45.0)
    assert np.abs(np.array(w.errors_mm[-450:]) - before).max() < 0.03
    assert w.estimates[-1].health[channel] in {SLIP, DRIFT}
    for name in set(ALL) - {channel}:
        assert w.seen(name) <= {GOOD, SPIKE, STEPPED}
        assert w.estimates[-1].health[name] is GOOD


@pytest.mark.parametrize(
    ("channel", "edge_mm", "slip_mm", "ahead_mm"),
    [
        ("lvdt_lead", 0.11, -0.14, -0.2),  # the edge is hidden, but for its begin
        ("lvdt_lead", 0.18, -0.17, -0.8),
        ("laser", 0.16, -0.16, 0.3),
        ("laser", -0.2, -0.2, -1.5),  # the other way round, another edge as high
        ("lvdt_lead", 0.1, 0.1, -0.6),  # or one twice as high
    ],
)
def test_a_slip_beside_an_edge_does_not_shift_the_depth(channel, edge_mm, slip_mm, ahead_mm):
    """Whatever the channel seems to show; the others are used again after the tool."""
    at_mm = AT_S * MM_PER_S + CHANNELS[channel].lead_mm + ahead_mm
    fault = {channel: lambda y, since_s, r: y + slip_mm}
    w = Weld(7, fault=fault, edges={at_mm: edge_mm})
    w.bias["laser"] = 0.06
    w.run(AT_S - 2.0)
    before = np.mean(w.errors_mm[-100:])
    w.run(45.0)
    assert np.abs(np.array(w.errors_mm[-450:]) - before).max() < 0.03
    assert set(w.estimates[-1].used) >= set(ALL) - {channel}


@pytest.mark.parametrize(
    ("channel", "step_mm"), [("lvdt_lead", 0.03), ("lvdt_lead", 0.05), ("laser", 0.03)]
)
def test_small_slip_is_not_taken_for_an_edge_at_the_tool(channel, step_mm):
    """Nor is the verdict delayed until then."""
    for seed in range(4):
        fault = {channel: lambda y, since_s, r: y + step_mm}
        w = Weld(seed, fault=fault, edges={}).run(AT_S)
        w.mm_per_s = 1.43
        w.run(25.0)
        assert w.estimates[-1].health[channel] is not STEPPED
        w.run(50.0)
        assert np.abs(np.array(w.errors_mm[-700:]) - np.mean(w.errors_mm[-850:-750])).max() < 0.02


@pytest.mark.parametrize("edge_mm", [0.1, -0.15])
def test_edge_after_many_spikes_is_not_a_slip(edge_mm):
    """Its place is where the channel began to show it, not where the first spike was."""
    spike = {"lvdt_lead": lambda y, since_s, r: y + (round(10 * since_s) % 10 == 0)}
    at_mm = (AT_S + 40.0) * 1.43 + CHANNELS["lvdt_lead"].lead_mm
    w = Weld(5, fault=spike, edges={at_mm: edge_mm})
    w.mm_per_s = 1.43
    w.run(AT_S + 80.0)
    assert SLIP not in w.seen("lvdt_lead")


def test_a_channel_that_falls_silent_while_it_is_watched_is_missing():
    """That it has stepped is no verdict."""
    fault = {"laser": lambda y, since_s, r: y + 0.03 if since_s < 8.0 else None}
    w = Weld(3, fault=fault).run(AT_S + 7.0)
    assert w.estimates[-1].health["laser"] is STEPPED
    w.run(2.0)
    assert w.estimates[-1].health["laser"] is MISSING


@pytest.mark.parametrize("slow", [False, True])
def test_a_jump_keeps_its_height_and_a_slow_step_may_grow(slow):
    """At the tool, the others shift by the height that the laser showed at first.

    Of a jump only.
    """
    bank, edges = DepthBank(DepthFusionSettings(), CHANNELS), SurfaceEdges(CHANNELS)
    usable = np.array([name != "laser" for name in ALL])
    edges.move(0.0)
    edges.move(1.0)
    edges.note_wrong(0, 0.1)
    assert edges.suspect(0, 0.1, usable, slow)
    for laser_mm in [0.1] * 5 + [0.4] * 20:
        bank.innovate(np.where(usable, 0.0, laser_mm), 0.0)
        assert edges.review(bank, np.zeros(len(ALL)), usable, usable) == ([], [])
    edges.move(1.0 + CHANNELS["laser"].lead_mm)
    bank.innovate(np.where(usable, -0.1, 0.3), 0.0)
    accepted, _ = edges.review(bank, np.zeros(len(ALL)), usable, usable)
    assert accepted == ([] if slow else [0])


def test_a_channel_found_wrong_stays_so_when_the_majority_is_lost():
    """The one that decided drops out before the slip is confirmed."""
    fault = {
        "axial": lambda y, since_s, r: y - 0.1,
        "laser": lambda y, since_s, r: None if since_s > 0.15 else y,
    }
    w = Weld(7, names=("laser", "lvdt_trail", "axial"), fault=fault).run(AT_S)
    before = np.mean(w.errors_mm[-100:])
    w.run(5.0)
    assert w.estimates[-1].health["axial"] is SLIP
    assert w.seen("lvdt_trail") == {GOOD}
    assert np.abs(np.array(w.errors_mm[-50:]) - before).max() < 0.03


def test_a_missing_sample_is_not_used_in_the_tick_in_which_its_step_becomes_an_edge():
    edges = {AT_S * MM_PER_S + 80.0: 0.1}
    whole = Weld(7, edges=edges).run(AT_S + 20.0)
    health = [estimate.health["lvdt_lead"] for estimate in whole.estimates]
    tick = max(k for k, state in enumerate(health) if state is STEPPED) + 1
    fault = {"lvdt_lead": lambda y, since_s, r: math.nan if round(10 * since_s) == late else y}
    late = tick + 1 - round(10 * AT_S)
    gap = Weld(7, fault=fault, edges=edges).run(AT_S + 20.0)
    assert "lvdt_lead" in whole.estimates[tick].used
    assert "lvdt_lead" not in gap.estimates[tick].used
    assert gap.estimates[tick].health["lvdt_lead"] is not GOOD
    assert gap.estimates[tick + 1].health["lvdt_lead"] is GOOD


def test_nothing_but_a_slip_steps_while_the_tool_stands_or_behind_a_sound_channel():
    standing = Weld(9, fault={"lvdt_lead": FAULTS["slip"][0]}, edges={})
    standing.mm_per_s = 0.0
    standing.run(AT_S + 2.0)
    behind = Weld(9, fault={"laser": FAULTS["slip"][0]}, edges={}).run(AT_S + 2.0)
    for w, name in ((standing, "lvdt_lead"), (behind, "laser")):
        assert w.estimates[-1].health[name] is SLIP


def test_common_error_is_unobservable_but_in_the_deviation():
    """The zero of all channels shifts the depth; the deviation covers it."""
    shifted, right = (Weld(1, shared_mm=offset).run(20.0) for offset in (0.04, 0.0))
    assert shifted.errors_mm[-1] - right.errors_mm[-1] == pytest.approx(0.04, abs=1e-3)
    assert {health for name in ALL for health in shifted.seen(name)} == {GOOD}
    assert shifted.estimates[-1].deviation_mm > 0.02


def test_single_channel_with_deflection_says_how_wrong_it_may_be():
    """Nothing contradicts it: its error grows with the force, and so does the deviation."""
    stiff = {"axial": CHANNELS["axial"].changed(deflection_mm_per_kn=0.0)}
    fusion = DepthFusion(channels=stiff)
    for tick in range(1, 200):
        force_kn = weld.FORCE_KN + min(10.0, 0.1 * tick)
        shown = weld.DEPTH_MM + 0.03 * (force_kn - weld.FORCE_KN)
        estimate = fusion.update(tick * weld.TICK_S, {"axial": shown}, force_kn)
        if tick == 1:
            first = estimate
    assert estimate.depth_mm - weld.DEPTH_MM > 0.1
    assert estimate.deviation_mm > 2.0 * first.deviation_mm


def test_harder_copper_is_not_taken_for_depth():
    """The torque is a witness only."""
    hard, soft = Weld(1, torque=torque_nm), Weld(1, torque=torque_nm)
    for w in (hard, soft):
        w.run(20.0)
    hard.hardness = 1.1
    for w in (hard, soft):
        w.run(5.0)
    assert [e.depth_mm for e in hard.estimates] == [e.depth_mm for e in soft.estimates]


@pytest.mark.parametrize("names", [("laser", "lvdt_lead"), ("axial",)])
def test_a_jump_without_a_jump_of_the_torque_is_a_slip(names):
    """Also where no majority of channels decides."""
    w = Weld(2, names, {names[0]: FAULTS["slip"][0]}, torque_nm).run(AT_S + 3.0)
    assert w.estimates[-1].health[names[0]] is SLIP
    assert w.estimates[-1].used == names[1:]
    if names[1:]:
        assert abs(w.errors_mm[-1] - w.errors_mm[round(10 * AT_S) - 20]) < 0.03
    else:
        assert math.isnan(w.estimates[-1].depth_mm)


def test_two_channels_that_drift_apart_are_both_suspect():
    """Which is wrong cannot be known; the deviation grows."""
    w = Weld(2, ("laser", "lvdt_lead"), {"laser": FAULTS["drift"][0]}, torque_nm).run(AT_S)
    before = w.estimates[-1].deviation_mm
    w.run(4.0)
    assert w.seen("laser") >= {GOOD, SUSPECT}
    assert SUSPECT in w.seen("lvdt_lead")
    assert max(estimate.deviation_mm for estimate in w.estimates) > before + 0.01


def test_a_jump_of_all_channels_is_followed():
    """The depth itself has changed."""
    w = Weld(4).run(20.0)
    before = w.errors_mm[-1]
    w.depth_mm += 0.3
    w.run(1.0)
    assert w.errors_mm[-1] == pytest.approx(before, abs=0.02)
    assert {health for name in ALL for health in w.seen(name)} == {GOOD}


def test_a_slip_that_is_over_is_forgotten():
    """The channel is used again once it has been back for a while."""
    fault = {"laser": lambda y, since_s, r: y + 0.3 * (since_s < 5.0)}
    w = Weld(5, fault=fault).run(AT_S + 3.0)
    assert w.estimates[-1].health["laser"] is SLIP
    w.run(30.0)
    assert w.estimates[-1].used == ALL


def test_a_slip_is_not_forgotten_while_nothing_is_seen_of_the_channel():
    fault = {"laser": lambda y, since_s, r: y + 2.0 if since_s < 5.0 else math.nan}
    w = Weld(5, fault=fault).run(AT_S + 4.0)
    assert w.estimates[-1].health["laser"] is SLIP
    w.run(60.0)
    assert w.estimates[-1].health["laser"] is SLIP


def test_a_dead_torque_sensor_and_figures_without_bound_do_no_harm():
    w = Weld(6, torque=torque_nm)
    w.fusion.update(0.01, w.samples(), w.force_kn, 0.0, 43.6, weld.SPEED_RPM)
    w.fusion.update(0.02, w.samples(), math.inf, math.inf, math.inf, math.inf)
    assert abs(w.run(10.0).errors_mm[-1]) < 0.05
    assert w.estimates[-1].used == ALL


def test_a_footprint_makes_the_depth_surer():
    bias = {"sensor": "depth", "bias_mm": (0.1,), "deviation_mm": (0.005,)}
    listed = {"weld": "w", "sha256": "0" * 64, "angle_deg": (0.0,), "depth_mm": (2.6,)}
    footprint = Footprint(**listed, deviation_mm=0.01, sensors=(SensorBias(**bias),))
    values = dict.fromkeys(ALL, 2.7)
    estimates = [DepthFusion(footprint=prior).update(0.1, values) for prior in (None, footprint)]
    assert estimates[0].deviation_mm > estimates[1].deviation_mm
    taken_off = estimates[0].depth_mm - estimates[1].depth_mm
    assert taken_off == pytest.approx(estimates[1].footprint_mm)
    assert 0.07 < taken_off < 0.1


def test_a_footprint_counts_by_its_error():
    """A poor one changes nothing, nor does the deviation fall."""
    listed = {"weld": "w", "sha256": "0" * 64, "angle_deg": (0.0,), "depth_mm": (2.6,)}
    bias = SensorBias(sensor="depth", bias_mm=(0.1,), deviation_mm=(1.0,))
    poor = Footprint(**listed, deviation_mm=1.0, sensors=(bias,))
    values = dict.fromkeys(ALL, 2.7)
    without, with_it = (DepthFusion(footprint=prior).update(0.1, values) for prior in (None, poor))
    assert with_it.depth_mm == pytest.approx(without.depth_mm, abs=1e-3)
    assert with_it.deviation_mm == pytest.approx(without.deviation_mm, rel=0.01)


def test_missing_samples_and_repeated_ticks():
    """The depth is held for a short time, then it is not a number; a tick counts once."""
    w = Weld(6).run(5.0)
    last = w.estimates[-1]
    assert w.fusion.update(w.time_s, dict.fromkeys(ALL, 9.0), 78.4) is last
    held = w.fusion.update(w.time_s + 0.1, {})
    assert held.depth_mm == pytest.approx(last.depth_mm, abs=0.01)
    assert held.used == ()
    gone = w.fusion.update(w.time_s + 0.5, {})
    assert math.isnan(gone.depth_mm)
    assert set(gone.health.values()) == {MISSING}
    back = w.fusion.update(w.time_s + 0.6, w.samples(), w.force_kn)
    assert back.depth_mm == pytest.approx(last.depth_mm, abs=0.03)
    assert math.isnan(DepthFusion().update(0.1, {}).depth_mm)


def test_biases_from_a_footprint_are_taken_off():
    """Also where one channel has a great one."""
    rows = {"a": DepthChannel(bias_mm=0.5), "b": DepthChannel()}
    estimate = DepthFusion(channels=rows).update(0.1, {"a": 3.0, "b": 2.5}, 78.4)
    assert estimate.depth_mm == pytest.approx(2.5, abs=1e-6)
