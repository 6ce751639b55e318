"""The C library by itself: strict C99, sanitizers, layout of its structs."""

import shutil
import subprocess
from functools import partial

import pytest

from fsw_control.c_library import CController
from fsw_decentral import DecentralController
from fsw_decentral.controller import KERNEL
from fsw_test_support.c_code import SANITIZE, STRICT, check_layout, compile_c, has_sanitizers

DRIVER = r"""
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "fsw_decentral.h"
static double draw(double low, double high) { return low + (high - low) * (rand() / (double)RAND_MAX); }
static double sample(double low, double high) {
  static const double odd[] = {NAN, INFINITY, -INFINITY, 0.0, -0.0, 1e300, -1e300, 1.7e308, 5e-324, 1e20};
  return rand() % 8 ? draw(low, high) : odd[rand() % 10];
}
static fsw_decentral_tuning drawn(void) {
  fsw_decentral_tuning t = {
    draw(0, 300), sample(1, 10), draw(0, 0.1), draw(0, 1), draw(0, 1), draw(0, 1), sample(0.1, 30),
    draw(0, 1), sample(1, 60), draw(0, 3), draw(0, 1), draw(0, 1), draw(0, 1), draw(0.1, 30),
    draw(0, 3), draw(0.1, 1), sample(0, 1), draw(1, 30), sample(0, 1),
    draw(0, 30), draw(0, 1), draw(0, 30), draw(0, 60), draw(0, 3), sample(0, 10),
    draw(40, 70), sample(85, 100), draw(250, 350), draw(450, 550), draw(0, 3), draw(0, 9),
    {draw(-500, 500), sample(-2, 2), draw(-0.01, 0.01)}, sample(0, 10), draw(100, 3000), sample(0, 20)};
  return t;
}
/* In the bounds, and a step from what is applied; where both cannot be, at the nearest bound and not healthy. */
static int keeps(double x, double low, double high, double applied, double step, int healthy) {
  if (!(x >= low && x <= high)) return 0;
  if (x >= applied - step && x <= applied + step) return 1;
  return (applied < low && x == low && (!healthy || applied > low - step - 1e-5)) ||
         (applied > high && x == high && (!healthy || applied < high + step + 1e-5));
}
int main(void) {
  fsw_decentral *c = malloc(sizeof(fsw_decentral)); /* exactly as long as asked for, and not cleared */
  if (!c) return 1;
  memset(c, 0xFF, sizeof(fsw_decentral));
  fsw_decentral_tuning tuning = drawn();
  while (fsw_decentral_init(c, &tuning)) tuning = drawn();
  int healthy = 0, again = 0, refused = 0;
  double force = 78.4, speed = 407.6;
  fsw_decentral_reset(c, force, speed);
  for (int k = 0; k < TICKS; k++) {
    fsw_decentral_input in = {draw(2.6, 2.7), draw(1000, 1100), draw(815, 818), 1, 1, 1, force, speed, 2.7, 820, 0.1};
    if (k % 2000 > 1000) { /* everything may be wrong */
      in.depth_mm = sample(0, 5); in.torque_nm = sample(0, 3000); in.temperature_c = sample(0, 1500);
      in.depth_valid = rand(); in.torque_valid = rand() % 2; in.temperature_valid = rand() % 2;
      in.applied_force_kn = sample(50, 100); in.applied_speed_rpm = sample(250, 550);
      in.reference_depth_mm = sample(1, 4); in.reference_temperature_c = sample(700, 950);
      in.dt_s = sample(-1, 5);
    }
    if (k % 150 == 149) fsw_decentral_reset(c, sample(60, 95), sample(300, 500));
    if (k % 50 == 49) {
      const fsw_decentral_tuning other = drawn();
      if (fsw_decentral_configure(c, &other)) refused++; else tuning = other;
    }
    const int known = isfinite(in.applied_force_kn + in.applied_speed_rpm);
    const double f = known ? in.applied_force_kn : c->proposed_force_kn;
    const double n = known ? in.applied_speed_rpm : c->proposed_speed_rpm;
    fsw_decentral_output out, twin_out;
    fsw_decentral twin = *c;
    fsw_decentral_step(c, &in, &out);
    fsw_decentral_step(&twin, &in, &twin_out);
    if (out.force_kn != twin_out.force_kn || out.speed_rpm != twin_out.speed_rpm) { free(c); return 2; }
    const int h = out.healthy;
    const int kept = keeps(out.force_kn, tuning.force_min_kn, tuning.force_max_kn, f, tuning.force_step_kn, h) &&
                     keeps(out.speed_rpm, tuning.speed_min_rpm, tuning.speed_max_rpm, n, tuning.speed_step_rpm, h);
    if (!kept || !isfinite(out.force_kn) || !isfinite(out.speed_rpm)) { free(c); return 3; }
    healthy += out.healthy;
    again += out.reason == FSW_DECENTRAL_OVERFLOW;
    force = out.force_kn;
    speed = out.speed_rpm;
  }
  free(c);
  printf("%d healthy, %d restarts, %d refused\n", healthy, again, refused);
  return healthy > TICKS / 2 && again > 0 && refused > 0 ? 0 : 4;
}
"""


@pytest.mark.slow
@pytest.mark.full
def test_under_sanitizers_with_all_that_can_be_wrong(tmp_path):
    if not has_sanitizers(tmp_path):
        pytest.skip("this compiler has no sanitizers")
    (tmp_path / "driver.c").write_text(DRIVER, encoding="utf-8")
    sources = [str(tmp_path / "driver.c"), *(str(KERNEL.folder / name) for name in KERNEL.sources)]
    options = ["-std=c99", *SANITIZE, "-DTICKS=200000", "-I", str(KERNEL.folder)]
    built = compile_c([*options, *sources, "-o", str(tmp_path / "driver"), "-lm"])
    assert built.returncode == 0, built.stderr
    ran = subprocess.run(
        [str(tmp_path / "driver")], capture_output=True, text=True, check=False, timeout=100
    )
    assert ran.returncode == 0, ran.stdout + ran.stderr


@pytest.mark.slow
@pytest.mark.parametrize("compiler", ["gcc", "clang"])
@pytest.mark.parametrize("source", KERNEL.sources)
def test_strict_c99_without_a_warning(source, compiler, tmp_path):
    if shutil.which(compiler) is None:
        pytest.skip(f"{compiler} is not installed")
    done = compile_c(
        [*STRICT, "-Wvla", "-c", str(KERNEL.folder / source), "-o", str(tmp_path / "o")],
        [compiler],
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_structs_are_those_of_the_header(tmp_path):
    check_layout(KERNEL, tmp_path)


def copy_of(tuning):
    """A tuning of its own."""
    copied = KERNEL.new("fsw_decentral_tuning")
    copied[0] = tuning
    return copied


def test_a_tuning_that_is_not_usable_is_refused_and_the_last_one_stays():
    good = copy_of(DecentralController().library.state.tuning)
    library, before = DecentralController().library, bytes(KERNEL.ffi.buffer(good))
    for field, _ in KERNEL.ffi.typeof("fsw_decentral_tuning").fields:
        bad = copy_of(good[0])
        if field == "friction":
            bad.friction[2] = float("nan")
        else:
            setattr(bad, field, float("inf"))
        for take in (library.configure, partial(CController, KERNEL, None, "be finite")):
            with pytest.raises(ValueError, match="be finite"):
                take(bad)
        assert bytes(KERNEL.ffi.buffer(library.state))[: len(before)] == before, field


@pytest.mark.parametrize(
    ("low", "high"), [("force_min_kn", "force_max_kn"), ("speed_min_rpm", "speed_max_rpm")]
)
def test_the_kernel_itself_refuses_bounds_without_room_between(low, high):
    library = DecentralController().library
    tuning = copy_of(library.state.tuning)
    library.configure(tuning)
    setattr(tuning, low, getattr(tuning, high))
    with pytest.raises(ValueError, match="limits"):
        library.configure(tuning)
