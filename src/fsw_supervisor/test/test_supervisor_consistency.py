"""Sensors compared with each other.

What the residuals show of faults, and that wear and other plants do not count.
"""

import math

import pytest

from fsw_control.contract import Measurement
from fsw_model import nominal
from fsw_model.equations import friction_torque_nm, process_torque_nm
from fsw_supervisor.consistency import Consistency

MODEL = nominal()
FORCE_KN, SPEED_RPM, DEPTH_MM, TEMPERATURE_C = 78.4, 407.576, 2.66, 816.4


def torque_nm(force_kn=FORCE_KN, depth_mm=DEPTH_MM, share=1.0):
    return share * process_torque_nm(MODEL, force_kn, depth_mm) + friction_torque_nm(
        MODEL, SPEED_RPM
    )


class Weld:
    """Ticks of a weld at rest, of which a test changes what it wants."""

    def __init__(self, **usual):
        self.consistency, self.time_s, self.usual = Consistency(), 1000.0, usual

    def tick(self, period_s=0.1, **changes):
        self.time_s += period_s
        values = {"depth_mm": DEPTH_MM, "torque_nm": torque_nm(), "temperature_c": TEMPERATURE_C}
        values |= {"force_kn": FORCE_KN, "speed_rpm": SPEED_RPM} | self.usual | changes
        return self.consistency.update(Measurement(self.time_s, **values))

    def run(self, count, **changes):
        for _ in range(count):
            residuals = self.tick(**changes)
        return residuals


def test_residuals_vanish_at_rest():
    assert Weld().run(100) == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)


@pytest.mark.requirement("S35")
@pytest.mark.parametrize("share", [0.7, 0.8, 1.0, 1.2, 1.3])
@pytest.mark.parametrize("off", [-0.43, -0.15, 0.15, 0.4])
def test_torque_off_what_a_plant_is_used_to_shows_for_good(share, off):
    weld = Weld(torque_nm=torque_nm(share=share))
    assert weld.run(700).torque_residual_percent == pytest.approx(0.0, abs=0.1)
    wrong = torque_nm(share=share * (1.0 + off))
    assert weld.tick(torque_nm=wrong).torque_residual_percent == pytest.approx(
        100.0 * off, abs=0.1
    )
    assert weld.run(6000, torque_nm=wrong).torque_residual_percent == pytest.approx(
        100.0 * off, abs=0.1
    )


@pytest.mark.requirement("S35")
@pytest.mark.parametrize("share", [0.5, 1.6])
def test_torque_that_was_never_right_shows(share):
    assert abs(Weld(torque_nm=torque_nm(share=share)).run(700).torque_residual_percent) > 8.0


def test_wear_does_not_count():
    """25 N m in a whole weld."""
    weld, worst = Weld(), 0.0
    for tick in range(27_000):
        percent = weld.tick(torque_nm=torque_nm() + 25.0 * tick / 27_000).torque_residual_percent
        worst = max(worst, abs(percent))
    assert worst < 0.2


@pytest.mark.requirement("S35")
@pytest.mark.parametrize("rate_mm_per_s", [0.001, 0.005, 0.02])
def test_a_slow_slip_that_sinks_the_tool_shows_before_it_is_deep(rate_mm_per_s):
    """A controller keeps the depth that is shown; the torque is that of the true one."""
    weld = Weld()
    weld.run(1000)
    true_mm = DEPTH_MM
    while abs(weld.tick(torque_nm=torque_nm(depth_mm=true_mm)).torque_residual_percent) < 8.0:
        true_mm += 0.1 * rate_mm_per_s
        assert true_mm < DEPTH_MM + 1.2


def test_force_that_moves_the_torque_and_the_depth_does_not_count():
    weld = Weld()
    weld.run(100)
    process_nm, force_kn, worst = process_torque_nm(MODEL, FORCE_KN, DEPTH_MM), FORCE_KN, 0.0
    for tick in range(100):
        force_kn += 1.0 if tick < 15 else 0.0
        process_nm += (process_torque_nm(MODEL, force_kn, DEPTH_MM) - process_nm) * (
            1.0 - math.exp(-0.1 / 0.27)
        )
        measured = process_nm + friction_torque_nm(MODEL, SPEED_RPM)
        worst = max(
            worst, abs(weld.tick(force_kn=force_kn, torque_nm=measured).torque_residual_percent)
        )
    assert worst < 0.5


@pytest.mark.requirement("S35")
@pytest.mark.parametrize("rate_mm_per_s", [0.1, -0.1, 1.0, -3.0])
def test_a_depth_that_moves_by_itself_shows(rate_mm_per_s):
    weld = Weld()
    weld.run(100)
    residuals = [
        weld.tick(depth_mm=DEPTH_MM + 0.1 * k * rate_mm_per_s).depth_residual_mm for k in range(60)
    ]
    assert max(map(abs, residuals)) > 0.4
    assert residuals[-1] * rate_mm_per_s > 0.0


def test_a_depth_that_follows_the_force_does_not_count():
    """+15 kN for half a minute sink the shoulder by (17)."""
    weld, depth_mm, slow, worst = Weld(), DEPTH_MM, 0.0, 0.0
    weld.run(100)
    gain, pole_s, zero_s = (
        MODEL.depth_gain_mm_per_kn_s,
        MODEL.depth_pole_slow_s,
        MODEL.depth_zero_s,
    )
    for _ in range(300):
        depth_mm += 0.1 * gain * 15.0
        slow += 0.1 / pole_s * (gain * 15.0 * (zero_s - pole_s) - slow)
        residual = weld.tick(
            force_kn=FORCE_KN + 15.0, depth_mm=depth_mm + slow, torque_nm=math.nan
        ).depth_residual_mm
        worst = max(worst, abs(residual))
    assert depth_mm + slow > DEPTH_MM + 0.9
    assert worst < 0.02


@pytest.mark.requirement("S35")
@pytest.mark.parametrize("rate_c_per_s", [6.0, -6.0])
def test_a_temperature_that_moves_by_itself_shows(rate_c_per_s):
    weld = Weld()
    weld.run(100)
    residuals = [
        weld.tick(temperature_c=TEMPERATURE_C + 0.1 * k * rate_c_per_s).temperature_residual_c
        for k in range(300)
    ]
    assert max(map(abs, residuals)) > 90.0


@pytest.mark.parametrize(
    ("lost", "unknown"),
    [
        ({"depth_mm": math.nan, "depth_valid": False}, (0, 1)),
        ({"torque_nm": math.nan, "torque_valid": False}, (0, 2)),
        ({"temperature_c": math.nan, "temperature_valid": False}, (2,)),
        ({"held": ("depth",)}, (0, 1)),
        ({"held": ("torque",)}, (0, 2)),
        ({"held": ("thermocouple",)}, (2,)),
        ({"force_kn": math.nan, "speed_rpm": math.nan}, (0, 1, 2)),
    ],
)
def test_missing_measurements_are_not_judged(lost, unknown):
    weld = Weld()
    weld.run(10)
    residuals = weld.tick(**lost)
    assert tuple(k for k, value in enumerate(residuals) if math.isnan(value)) == unknown
    assert weld.run(3) == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)


@pytest.mark.parametrize("period_s", [0.0, -5.0, 60.0])
def test_stamps_that_stand_still_go_back_or_leave_a_gap_do_no_harm(period_s):
    weld = Weld()
    weld.run(100)
    assert all(map(math.isfinite, weld.tick(period_s)))
    weld.consistency.forget_time()
    assert weld.run(3) == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)
