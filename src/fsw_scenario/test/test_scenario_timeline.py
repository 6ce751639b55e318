"""What is announced of set-points, and that it comes true."""

from math import sin

from hypothesis import given
from hypothesis import strategies as st

from fsw_control.contract import Reference
from fsw_control.ramps import ReferencePlan, stair
from fsw_control.weld import TICK_NS

FAR = Reference(2.66, 950.0)


def believed(changes):
    """Ticks at which the plan of all changes is believed, but for the last one, after which nothing comes."""
    plan = ReferencePlan(
        [(tick * TICK_NS, reference) for tick, reference in stair(changes.items())]
    )
    assert not any(plan.after(tick * TICK_NS, FAR) for tick in changes)
    return [tick for tick, reference in changes.items() if plan.after(tick * TICK_NS, reference)]


@given(st.floats(-1.0, 1.0), st.integers(2, 100))
def test_announced_ramp_matches_the_set_points(c_per_s, ticks):
    ramp = {tick: Reference(2.66, 816.4 + 0.1 * c_per_s * tick) for tick in range(1, ticks + 1)}
    assert believed(ramp) == list(ramp)[:-1]


@given(st.floats(0.1, 20.0), st.floats(0.01, 1.0))
def test_announced_sine_matches_except_at_its_steep_ends(amplitude_c, rad_per_s):
    sine = {
        tick: Reference(2.66, 816.4 + amplitude_c * sin(0.1 * rad_per_s * tick))
        for tick in range(1, 400)
    }
    assert set(list(sine)[10:-11]) <= set(believed(sine))
