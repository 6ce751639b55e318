"""What the estimator makes of noise, jumps, spikes, held values and another process, and that it knows how well."""

import numpy as np
import pytest

from fsw_model import ProcessModel, nominal
from fsw_nmpc.library import tuning_of
from fsw_nmpc.tuning import PAPER, EstimatorTuning, Settings, Tuning
from fsw_test_support.nmpc_problems import LIMITS, begin, make_library

P = nominal()
NOISE = (2e-3, 2.0, 0.1)  # depth mm, torque N m, temperature degC: the emulator's sensors
FORCE, HEAT, SCALE, DEPTH, TEMPERATURE = range(5)  # of the library's disturbances
DEPTH_RATE, GAIN = 10, 12  # of the estimator's states
REST = [0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]  # estimates of the undisturbed process
NAN = float("nan")


class Watch:
    """An estimator that watches a process under constant inputs."""

    def __init__(
        self, process=None, tuning=None, noise=False, start=(2.66, 816.4), seed=0, **actual
    ):
        self.library = make_library(20, tuning=tuning)
        self.model = ProcessModel(process or P)
        at = self.model.equilibrium(*start)
        self.state, self.force, self.speed = at.state.copy(), at.force_kn, at.speed_rpm
        self.actual_force = self.force + actual.get("unmeasured_kn", 0.0)
        self.rng = np.random.default_rng(seed) if noise else None
        self.library.reset(self.force, self.speed)
        self.innovations = []

    def shown(self):
        out = self.model.outputs(self.state, self.actual_force, self.speed)
        return np.array([out.depth_mm, out.motor_torque_nm, out.temperature_c])

    def run(self, ticks, offset=(0.0, 0.0, 0.0), fresh=(True, True, True), drives=False):
        inputs, estimator = self.library.input, self.library.state.estimator
        for _ in range(ticks):
            values = self.shown() + offset
            if self.rng is not None:
                values = values + self.rng.normal(0.0, NOISE)
            inputs.depth_mm, inputs.torque_nm, inputs.temperature_c = values
            inputs.depth_fresh, inputs.torque_fresh, inputs.temperature_fresh = fresh
            inputs.force_kn = inputs.applied_force_kn = self.force
            inputs.speed_rpm = inputs.applied_speed_rpm = self.speed
            if not drives:
                inputs.force_kn = inputs.speed_rpm = NAN
            inputs.reference_depth_mm = inputs.reference_temperature_c = NAN  # only estimate
            inputs.dt_s = 0.1
            assert not begin(self.library)
            assert estimator.started
            self.innovations.append([*estimator.innovation, *estimator.expected])
            self.model.step(self.state, self.actual_force, self.speed)
        return self.library.output

    @property
    def x(self):
        return np.array(list(self.library.state.estimator.x))


@pytest.mark.slow
def test_estimate_is_exact_at_rest():
    watch = Watch(start=(2.8, 830.0))
    output = watch.run(300)
    assert (output.depth_mm, output.temperature_c) == pytest.approx((2.8, 830.0), abs=1e-9)
    assert list(output.disturbance) == pytest.approx(REST, abs=1e-9)


def test_jump_of_the_depth_sensor_becomes_its_offset():
    output = (watch := Watch(noise=True)).run(600)
    output = watch.run(30, offset=(0.1, 0.0, 0.0))
    assert output.depth_mm == pytest.approx(2.76, abs=3e-3)
    assert abs(output.disturbance[DEPTH] - 0.1) < 3.0 * output.deviation[DEPTH] < 0.03


def test_jump_of_the_tool_leaves_the_sensor_offset():
    watch = Watch(noise=True)
    watch.run(600)
    creep, *rest = watch.state.x
    watch.state.x = (creep + 0.1, *rest)
    output = watch.run(30)
    assert output.depth_mm == pytest.approx(watch.shown()[0], abs=3e-3)
    assert abs(output.disturbance[DEPTH]) < 3.0 * output.deviation[DEPTH] < 0.03


def test_jump_of_the_temperature_becomes_its_offset():
    watch = Watch()
    watch.run(50)
    output = watch.run(100, offset=(0.0, 0.0, -5.0))
    assert output.temperature_c == pytest.approx(811.4, abs=0.02)
    assert output.disturbance[TEMPERATURE] == pytest.approx(-5.0, abs=0.2)
    assert output.disturbance[HEAT] == pytest.approx(0.0, abs=0.05)


def test_jump_is_followed_at_once_and_a_spike_is_forgotten():
    watch = Watch()
    watch.run(50)
    output = watch.run(1, offset=(0.3, 0.0, 20.0))
    assert output.depth_mm == pytest.approx(2.96, abs=5e-3)
    assert output.temperature_c == pytest.approx(836.4, abs=0.2)
    output = watch.run(2)
    assert output.depth_mm == pytest.approx(2.66, abs=5e-3)
    assert output.temperature_c == pytest.approx(816.4, abs=0.2)


def test_stale_samples_are_ignored():
    watch = Watch()
    watch.run(50)
    sure = watch.library.output.deviation[DEPTH]
    output = watch.run(20, offset=(0.5, 300.0, 50.0), fresh=(False, False, False))
    assert (output.depth_mm, output.temperature_c) == pytest.approx((2.66, 816.4), abs=1e-6)
    assert output.deviation[DEPTH] > sure


@pytest.mark.parametrize("factor", [0.85, 1.1])  # with 0.8 the speed at rest is beyond its bound
def test_torque_error_becomes_the_torque_scale(factor):
    watch = Watch(P.scaled(sticking_stress_pa=factor, sliding_friction=factor))
    output = watch.run(600)
    assert output.disturbance[SCALE] == pytest.approx(factor, abs=1e-3)
    assert (output.disturbance[DEPTH], output.disturbance[HEAT]) == pytest.approx(
        (0.0, 0.0), abs=1e-2
    )


def test_thermal_gain_error_becomes_a_heat():
    watch = Watch(P.scaled(thermal_gain_c_per_kw=1.2), start=(2.66, 840.0))
    output = watch.run(600)
    assert output.disturbance[HEAT] == pytest.approx(
        (840.0 - 816.4) * (1 / 18.1 - 1 / (1.2 * 18.1)), rel=0.02
    )
    assert output.temperature_c == pytest.approx(840.0, abs=1e-3)


def test_unmeasured_force_is_estimated_from_creep():
    output = Watch(unmeasured_kn=0.5).run(3000)
    assert output.disturbance[FORCE] == pytest.approx(
        0.5, abs=0.1
    )  # a part is taken for another gain


def test_drive_feedback_takes_precedence_over_the_command():
    watch = Watch(unmeasured_kn=0.5)
    watch.force = watch.actual_force
    output = watch.run(600, drives=True)
    assert output.disturbance[FORCE] == pytest.approx(0.0, abs=0.05)


@pytest.mark.parametrize("drift_sigmas", [0.0, 3.5])
def test_a_ramp_of_the_depth_sensor_is_followed(drift_sigmas):
    """0.1 mm in 30 s: a constant offset would stay behind.

    With the test for drifts the rate is known after seconds.
    """
    watch = Watch(noise=True, tuning=Tuning(estimator=EstimatorTuning(drift_sigmas=drift_sigmas)))
    watch.run(300)
    for tick in range(60):
        watch.run(1, offset=(0.1 * tick / 300, 0.0, 0.0))
    rate = watch.x[DEPTH_RATE]
    assert rate == pytest.approx(0.1 / 30.0, rel=0.4) if drift_sigmas else rate < 0.1 / 60.0


@pytest.mark.parametrize("factor", [0.75, 1.3])
def test_force_moves_identify_the_depth_gain(factor):
    watch = Watch(P.scaled(depth_gain_mm_per_kn_s=factor), noise=True)
    watch.run(200)
    assert watch.x[GAIN] == pytest.approx(1.0, abs=0.1), "not excited yet"
    for force_kn in (1.0, -1.0, 0.0):
        watch.force = watch.actual_force = 78.4 + force_kn
        watch.run(40)
    assert watch.x[GAIN] == pytest.approx(factor, rel=0.1)


def test_gain_and_rates_without_a_walk_stay_constant():
    watch = Watch(P.scaled(depth_gain_mm_per_kn_s=1.3), tuning=PAPER)
    watch.force = watch.actual_force = 79.4
    watch.run(50)
    assert watch.x[[GAIN, DEPTH_RATE]] == pytest.approx([1.0, 0.0], abs=0.0)


def visibility(tuning):
    """Least singular value of the PBH matrices of all eigenvalues near or on the unit circle, in usual sizes."""
    watch = Watch(tuning=tuning)
    watch.run(20)
    free = (
        np.diag([list(row) for row in watch.library.state.estimator.p]) > 0.0
    )  # the others are known to be constant
    free[GAIN] = False  # only moves of the force show it
    a = np.array([list(row) for row in watch.library.state.estimator.a])[np.ix_(free, free)]
    c = np.zeros((3, free.size))
    c[0, [0, 1, 3, 8]] = 1.0, 1.0, P.softening_per_c * 2.66, 1.0
    c[1, 4] = c[2, 3] = c[2, 9] = 1.0
    c = c[:, free]
    sizes = np.array([1e-2, 1e-2, 1.0, 1.0, 10.0, 1.0, 0.5, 0.01, 1e-2, 1.0, 1e-3, 0.1, 0.1])
    sizes = sizes[free]
    values = np.linalg.eigvals(a)
    matrices = (
        np.vstack(
            [
                (v * np.eye(len(a)) - a) * sizes / sizes[:, None],
                c * sizes / np.array(NOISE)[:, None],
            ]
        )
        for v in values[np.abs(values) > 0.99]
    )
    return min(np.linalg.svd(m, compute_uv=False)[-1] for m in matrices), values


@pytest.mark.parametrize(
    "tuning",
    [Tuning(), PAPER, Tuning().with_knobs(calmness=3.0)],
    ids=["default", "paper", "calm"],
)
def test_every_state_is_detectable(tuning):
    """PBH: no eigenvector of an eigenvalue near or on the unit circle is invisible to the three sensors."""
    least, values = visibility(tuning)
    assert least > 1e-6
    assert (
        sum(np.abs(values) > 1.0 - 1e-9) == 4
    )  # creep, which the process has, and one per sensor
    unleaking = tuning.changed(estimator=tuning.estimator.changed(offset_memory_s=1e12))
    assert visibility(unleaking)[0] < 1e-10  # what the leak is for


@pytest.mark.slow
@pytest.mark.full
def test_eight_hours_of_rest():
    """Deviations settle, and the estimated disturbances stay true."""
    watch = Watch(noise=True)
    output = watch.run(2 * 36_000)
    settled = np.array(list(output.deviation))
    for _ in range(6):
        output = watch.run(36_000)
        off = np.abs(np.array(list(output.disturbance)) - REST)
        assert (off < 4.0 * np.array(list(output.deviation))).all(), off
    others = [FORCE, HEAT, SCALE, TEMPERATURE]
    assert [output.deviation[i] for i in others] == pytest.approx(settled[others], rel=0.15)
    # noise of more than four standard deviations passes for a small jump of the depth, some times
    # in an hour
    assert output.deviation[DEPTH] < 0.01 and settled[TEMPERATURE] < 2.5


def test_innovations_have_the_expected_size():
    """Normalised innovations under nominal noise.

    About one, neither boastful nor timid, and no jumps are seen.
    """
    watch = Watch(noise=True)
    watch.run(6000)
    values = np.array(watch.innovations[1000:])
    ratio = (values[:, :3] ** 2 / values[:, 3:]).mean(axis=0)
    assert (ratio > 0.7).all() and (ratio < 1.1).all(), ratio
    white = [np.corrcoef(column[:-1], column[1:])[0, 1] for column in values[:, :3].T]
    assert np.abs(white).max() < 0.25, white


@pytest.mark.slow
@pytest.mark.full
def test_errors_match_the_estimated_deviations():
    """Over many noisy runs from wrong starts, the errors are as large as the estimated deviations say."""
    ratios = []
    for seed in range(30):
        watch = Watch(noise=True, seed=seed)
        output = watch.run(300)
        error = np.array(list(output.disturbance)) - REST
        ratios.append(error / np.array(list(output.deviation)))
    assert (np.array(ratios).std(axis=0) < 1.2).all(), np.array(ratios).std(axis=0)


def test_tuning_changes_at_runtime():
    watch = Watch(noise=True)
    watch.run(200)
    before = watch.x
    watch.library.configure(
        tuning_of(Settings(P, Tuning(estimator=EstimatorTuning(depth_noise_mm=0.01)), LIMITS))
    )
    watch.run(1)
    assert watch.x[[0, 2, 3]] == pytest.approx(before[[0, 2, 3]], abs=0.05)
