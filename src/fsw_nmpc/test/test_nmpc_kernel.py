"""The C library by itself: strict C99, sanitizers, sizes, builds."""

import subprocess
from dataclasses import replace
from functools import reduce
from importlib.util import find_spec

import numpy as np
import pytest

from fsw_model import nominal
from fsw_nmpc import tuning_struct
from fsw_nmpc.horizon import BLOCK_LENGTHS, PAPER_GRID_S, horizon_of, make_horizon
from fsw_nmpc.library import KERNEL, Library, Tables, tuning_of
from fsw_nmpc.tuning import ApproachTuning, EstimatorTuning, Settings, Tuning
from fsw_test_support.c_code import SANITIZE, STRICT, check_layout, compile_c, has_sanitizers
from fsw_test_support.nmpc_problems import LIMITS, make_library

P = nominal()
DRIVER = r"""
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include "fsw_nmpc.h"
#include "tables.h"
static double draw(double low, double high) { return low + (high - low) * (rand() / (double)RAND_MAX); }
static double sample(double low, double high) {
  const int kind = rand() % 40;
  return kind == 0 ? NAN : kind == 1 ? INFINITY : kind == 2 ? -1e300 : kind == 3 ? 0.0 : draw(low, high);
}
int main(void) {
  fsw_nmpc *c = malloc(sizeof(fsw_nmpc)); /* exactly as long as asked for */
  int proposed = 0, solved = 0;
  if (fsw_nmpc_init(c, &model, &tuning)) { free(c); return 2; }
  double force = 78.4, speed = 407.6;
  for (int k = 0; k < TICKS; k++) {
    fsw_nmpc_input in = {draw(2.4, 2.9), draw(900, 1200), draw(806, 826), 1, 1, 1, NAN, NAN, force, speed, 2.7, 820.0,
                         0.1, 0, {{0.0, 0.0, 0.0}}};
    if (k % 3 == 0) { /* everything may be wrong */
      in.depth_mm = sample(0, 5); in.torque_nm = sample(0, 3000); in.temperature_c = sample(0, 1500);
      in.depth_fresh = rand() % 2; in.torque_fresh = rand() % 2; in.temperature_fresh = rand() % 2;
      in.force_kn = sample(50, 100); in.speed_rpm = sample(250, 550);
      in.applied_force_kn = sample(50, 100); in.applied_speed_rpm = sample(250, 550);
      in.reference_depth_mm = sample(1, 4); in.reference_temperature_c = sample(700, 950);
      in.dt_s = sample(-1, 5); in.n_changes = rand() % 20 - 4;
      for (int i = 0; i < FSW_MAX_CHANGES; i++) {
        in.change[i].at_s = sample(-5, 40); in.change[i].depth_mm = sample(1, 4);
        in.change[i].temperature_c = sample(700, 950);
      }
    }
    if (k % 150 == 149) fsw_nmpc_reset(c, sample(60, 95), sample(300, 500));
    if (k % 31 == 30) { /* a tuning that cannot be used changes nothing */
      fsw_nmpc_tuning wrong = tuning;
      double *numbers[5] = {&wrong.force_step_kn, &wrong.speed_step_rpm, &wrong.estimator.depth_noise_mm,
                            &wrong.estimator.torque_noise_nm, &wrong.estimator.temperature_noise_c};
      *numbers[k % 2] = sample(-1, 0); *numbers[2 + k % 3] = NAN;
      if (!fsw_nmpc_configure(c, &wrong)) { free(c); return 6; }
    }
    if (k % 97 == 96) { tuning.trajectory = (tuning.trajectory + 1) % 4; fsw_nmpc_configure(c, &tuning); }
    fsw_nmpc_output out;
    fsw_nmpc_step(c, &in, &out);
    if (out.iterations > 2 * tuning.max_iterations) { free(c); return 3; }
    const int inside = out.force_kn >= 60 && out.force_kn <= 95 && out.speed_rpm >= 300 && out.speed_rpm <= 500;
    /* never further than a step from what is applied, if it is healthy */
    const double f = c->unclipped[0], n = c->unclipped[1];
    const int near = fabs(out.force_kn - f) <= 1 + 2e-6 && fabs(out.speed_rpm - n) <= 3 + 2e-6;
    if (!inside || (out.healthy && !near)) { free(c); return 4; }
    proposed += out.healthy;
    force = out.force_kn;
    speed = out.speed_rpm;
    solved += out.solve_status == FSW_OK;
  }
  free(c);
  printf("%d proposed, %d solved\n", proposed, solved);
  return proposed > TICKS / 2 && solved > TICKS / 2 ? 0 : 5;
}
"""


def tables_of(library):
    """The model's tables and the tuning as C text."""
    arrays, ffi = library.tables.arrays, KERNEL.ffi
    lines = [
        f"static const {'int' if array.dtype == np.int32 else 'double'} {name}[] = "
        f"{{{', '.join(map(repr, array.ravel().tolist()))}}};"
        for name, array in arrays.items()
    ]

    def text(value):
        if not isinstance(value, ffi.CData):
            return repr(value)
        parts = dir(value) if ffi.typeof(value).kind == "struct" else ()
        return (
            "{"
            + ", ".join(
                [f".{part} = {text(getattr(value, part))}" for part in parts] or map(repr, value)
            )
            + "}"
        )

    for kind, name, struct in (
        ("const fsw_nmpc_model", "model", library.tables.model),
        ("fsw_nmpc_tuning", "tuning", library.state.tuning),
    ):
        fields = ffi.typeof(kind.removeprefix("const ")).fields
        values = [
            f if member.type.kind == "pointer" else text(getattr(struct, f))
            for f, member in fields
        ]
        lines.append(f"static {kind} {name} = {{{', '.join(values)}}};")
    return "\n".join(lines) + "\n"


def copy_of(tuning):
    """A tuning of its own."""
    copied = KERNEL.new("fsw_nmpc_tuning")
    copied[0] = tuning
    return copied


@pytest.mark.slow
@pytest.mark.parametrize("blocks", [20, 54])
@pytest.mark.full
def test_under_sanitizers_with_all_that_can_be_wrong(tmp_path, blocks):
    (tmp_path / "tables.h").write_text(
        tables_of(make_library(blocks, max_iterations=50)), encoding="utf-8"
    )
    (tmp_path / "driver.c").write_text(DRIVER, encoding="utf-8")
    if not has_sanitizers(tmp_path):
        pytest.skip("this compiler has no sanitizers")
    sources = [str(KERNEL.folder / name) for name in KERNEL.sources]
    include = ["-I", str(KERNEL.folder), "-I", str(tmp_path)]
    program = str(tmp_path / "driver")
    built = compile_c(
        [
            "-std=c99",
            *SANITIZE,
            f"-DFSW_MAX_BLOCKS={blocks}",
            f"-DTICKS={2000 if blocks == 20 else 400}",
            *include,
            str(tmp_path / "driver.c"),
            *sources,
            "-o",
            program,
            "-lm",
        ]
    )
    assert built.returncode == 0, built.stderr
    ran = subprocess.run([program], capture_output=True, text=True, check=False, timeout=350)
    assert ran.returncode == 0, ran.stdout + ran.stderr


@pytest.mark.slow
@pytest.mark.parametrize("source", KERNEL.sources)
def test_strict_c99_without_a_warning(source, tmp_path):
    done = compile_c([*STRICT, "-c", str(KERNEL.folder / source), "-o", str(tmp_path / "o")])
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    "horizon",
    [
        make_horizon(P, PAPER_GRID_S, BLOCK_LENGTHS[20], 0.8),  # 81 steps
        make_horizon(P, tuple(0.1 * k for k in range(60)), (1,) * 59),  # 59 intervals
        replace(horizon_of(P, 20), interval_block=np.arange(54, dtype=np.int32)[::-1].copy()),
        replace(
            horizon_of(P, 20), weight_segment=horizon_of(P, 20).weight_segment + np.int32(100)
        ),
        replace(horizon_of(P, 20), depth_width=horizon_of(P, 20).depth_width + np.int32(100)),
    ],
    ids=["steps", "intervals", "blocks", "segments", "widths"],
)
def test_every_size_is_checked(horizon):
    with pytest.raises(ValueError, match="the sizes"):
        make_library(horizon=horizon)


def test_generated_struct_of_the_tuning_is_up_to_date():
    assert (KERNEL.folder / "fsw_nmpc_tuning.h").read_text(
        encoding="utf-8"
    ) == tuning_struct.header()


def test_every_field_of_the_tuning_reaches_the_kernel():
    """A field that is left out is one that the kernel has in another form, or a whole number."""
    fields = {
        *Tuning.model_fields,
        *(f"approach.{name}" for name in ApproachTuning.model_fields),
        *(f"estimator.{name}" for name in EstimatorTuning.model_fields),
    }
    ours = {".".join(path) for path in numbers(KERNEL.ffi.typeof("fsw_nmpc_tuning"))}
    memories = {"offset_memory_s", "depth_rate_memory_s", "temperature_rate_memory_s"}
    parts = {"approach", "estimator"}
    assert fields - ours == {
        "trajectory",
        "blocks",
        "second_solve_iterations",
        *parts,
        *(f"estimator.{name}" for name in memories),
    }


@pytest.mark.slow
def test_structs_are_those_of_the_header(tmp_path):
    """Sizes in Python and in C are equal, field by field offsets too."""
    check_layout(KERNEL, tmp_path)


@pytest.mark.slow
@pytest.mark.skipif(find_spec("ziglang") is None, reason="the ziglang wheel is not installed")
def test_the_ziglang_wheel_builds_the_same_controller(monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("CC", raising=False)
    built = KERNEL.ffi.dlopen(str(KERNEL.build(tmp_path / "zig.so")))
    usual, zig = (
        make_library(20),
        Library(P, horizon_of(P, 20), tuning_of(Settings(P, Tuning(), LIMITS)), built),
    )
    for library in (usual, zig):
        library.configure(tuning_of(Settings(P, Tuning(), LIMITS)))
        inputs = library.input
        inputs.depth_mm, inputs.torque_nm, inputs.temperature_c = 2.66, 1052.86, 816.4
        inputs.depth_fresh = inputs.torque_fresh = inputs.temperature_fresh = True
        inputs.applied_force_kn, inputs.applied_speed_rpm, inputs.dt_s = 78.4, 407.576, 0.1
        inputs.reference_depth_mm, inputs.reference_temperature_c = 2.8, 820.0
        for _ in range(20):
            library.step()
            inputs.applied_force_kn, inputs.applied_speed_rpm = (
                library.output.force_kn,
                library.output.speed_rpm,
            )
    assert bytes(KERNEL.ffi.buffer(usual.output)) == bytes(KERNEL.ffi.buffer(zig.output))


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("softening_per_c", float("nan")),
        ("dead_time_s", 0.0),
        ("copper_lag_s", float("inf")),
        ("modes", None),
        ("torque_par", None),
        ("time_s", [1e18]),
        ("weight", [float("nan")]),
        ("block_reach", [0.0]),
    ],
)
def test_invalid_model_is_refused(field, value):
    """Missing tables and numbers that are not finite are found at the start, not in a tick."""
    library = make_library(20)
    tables = Tables(P, library.horizon)
    if isinstance(value, list):
        value = KERNEL.ffi.new("double[4096]", value)
    setattr(tables.model, field, KERNEL.ffi.NULL if value is None else value)
    tuning = KERNEL.ffi.addressof(library.state, "tuning")
    assert library.lib.fsw_nmpc_init(library.state, tables.model, tuning) == 1


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("max_iterations", 0),
        ("max_iterations", 2**31 - 1),
        ("tolerance", -1.0),
        ("temperature_corridor_keep", 5.0),
        ("plan_reuse", -1),
    ],
)
def test_invalid_tuning_is_refused(field, value):
    library = make_library(20)
    tuning = copy_of(library.state.tuning)
    setattr(tuning, field, value)
    with pytest.raises(ValueError, match="tuning"):
        library.configure(tuning)
    assert getattr(library.state.tuning, field) != value


def numbers(kind, prefix=()):
    """Paths of all real numbers in a struct."""
    for name, field in kind.fields:
        if field.type.kind == "struct":
            yield from numbers(field.type, (*prefix, name))
        elif "double" in field.type.cname:
            yield (*prefix, name)


@pytest.mark.parametrize("path", list(numbers(KERNEL.ffi.typeof("fsw_nmpc_tuning"))), ids=".".join)
def test_number_that_is_negative_or_not_finite_is_refused(path):
    library = make_library(20)
    for value in (-1.0, float("nan"), float("inf")):
        tuning = copy_of(library.state.tuning)
        part = reduce(getattr, path[:-1], tuning)
        if path[-1] == "start_deviation":
            part.start_deviation[len(part.start_deviation) - 1] = value
        else:
            setattr(part, path[-1], value)
        with pytest.raises(ValueError, match="tuning"):
            library.configure(tuning)


@pytest.mark.parametrize("q", [0, 1])
def test_bounds_without_room_between_are_refused(q):
    library = make_library(20)
    tuning = copy_of(library.state.tuning)
    least, most = (("force_min_kn", "force_max_kn"), ("speed_min_rpm", "speed_max_rpm"))[q]
    setattr(tuning, least, getattr(tuning, most))
    with pytest.raises(ValueError, match="tuning"):
        library.configure(tuning)


def test_lead_that_would_take_long_to_compute_is_refused():
    library = make_library(20)
    tuning = copy_of(library.state.tuning)
    tuning.approach.longest_lead_s = 1e4
    with pytest.raises(ValueError, match="tuning"):
        library.configure(tuning)


@pytest.mark.requirement("S4")
def test_missing_inputs_give_a_finite_command():
    """Without finite inputs the controller stays at its last ones, and time advances in ticks."""
    library = make_library(20)
    nan = float("nan")
    library.reset(nan, float("inf"))
    inputs, output = library.input, library.output
    library.lib.fsw_nmpc_input_clear(library.input)
    library.step()
    assert not output.healthy
    assert np.isfinite([output.force_kn, output.speed_rpm]).all()
    inputs.depth_mm, inputs.torque_nm, inputs.temperature_c = 2.66, 1050.0, 816.4
    inputs.depth_fresh = inputs.torque_fresh = inputs.temperature_fresh = 1
    inputs.applied_force_kn, inputs.applied_speed_rpm = 1e300, nan
    inputs.reference_depth_mm, inputs.reference_temperature_c = 2.7, 818.0
    library.step()
    assert output.healthy
    assert (
        LIMITS.force_min_kn <= output.force_kn <= LIMITS.force_max_kn
    )  # one that is NaN makes both unknown
    inputs.depth_fresh = inputs.torque_fresh = inputs.temperature_fresh = 0
    inputs.dt_s = 0.0
    for _ in range(200):
        library.step()
    assert not output.healthy  # blind: a call without time counts as a tick
