"""The kernel under the address and undefined-behaviour sanitizers, driven by a small C program."""

import subprocess
import textwrap

import pytest

from fsw_model import nominal
from fsw_nmpc import kernel_build
from fsw_nmpc.horizon import horizon_of
from fsw_nmpc.kernel_codegen import TORQUE_PARAMETERS

FLAGS = [
    "-std=c99",
    "-g",
    "-O1",
    "-fsanitize=address,undefined",
    "-fno-sanitize-recover=all",
    "-fno-omit-frame-pointer",
]

DRIVER = """
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include "fsw_nmpc.h"
#include "tables.h"
static double draw(double low, double high) { return low + (high - low) * (rand() / (double)RAND_MAX); }
int main(void) {
  void *workspace = malloc((size_t)fsw_nmpc_workspace_bytes()); /* exactly as long as asked for */
  int solved = 0;
  for (int trial = 0; trial < 60; trial++) {
    double history[2 * N_HISTORY], low[4][N_OUT], high[4][N_OUT], v[2 * N_BLOCKS], depth[N_OUT], temp[N_OUT];
    fsw_nmpc_call c = {{draw(-.3, .3), draw(-.05, .05), 0, draw(-.1, .1), draw(800, 900)}};
    for (int i = 0; i < 2 * N_HISTORY; i++) history[i] = draw(40, 47);
    for (int i = 0; i < N_OUT; i++) {
      low[0][i] = draw(2.4, 2.8); high[0][i] = low[0][i] + 1e-3;
      low[1][i] = draw(840, 860); high[1][i] = low[1][i] + .1;
      low[2][i] = trial % 3 ? 50 : 0; high[2][i] = 1;
      low[3][i] = trial % 2 ? 100 : 0; high[3][i] = trial % 2;
    }
    for (int i = 0; i < 2 * N_BLOCKS; i++) v[i] = draw(-.5, .5);
    c.history = history; c.force_kn = draw(58, 97); c.speed_rpm = draw(290, 510); c.torque_scale = 1;
    c.depth_low = low[0]; c.depth_high = high[0]; c.temp_low = low[1]; c.temp_high = high[1];
    c.depth_weight = low[2]; c.temp_weight = high[2]; c.depth_square = low[3]; c.temp_square = high[3];
    c.move_weight[0] = .3; c.move_weight[1] = trial % 5 ? .01 : 0; c.move_square[0] = trial % 2;
    c.move_max[0] = 1; c.move_max[1] = 3;
    c.input_min[0] = 60; c.input_max[0] = 95; c.input_min[1] = 300; c.input_max[1] = 500;
    c.max_iterations = 60; c.tolerance = 1e-6;
    if (trial == 7) history[3] = NAN;
    if (trial == 11) c.x[4] = INFINITY;
    if (trial == 13) v[0] = 1e300;
    fsw_nmpc_result r;
    solved += fsw_nmpc_solve(&model, &c, v, depth, temp, &r, workspace) == 0;
    if (r.iterations > 60) return 3;
  }
  free(workspace);
  printf("%d solved\\n", solved);
  return solved > 45 ? 0 : 2;
}
"""


def tables(blocks):
    """The model's tables as C text."""
    p, h = nominal(), horizon_of(nominal(), blocks)

    def array(kind, name, values):
        return f"static const {kind} {name}[] = {{{', '.join(repr(v) for v in values.ravel().tolist())}}};"

    torque = [getattr(p, name) for name in TORQUE_PARAMETERS]
    lines = [
        f"#define N_OUT {h.n_out}\n#define N_BLOCKS {h.n_blocks}\n#define N_HISTORY {h.n_history}",
        *(array("int", n, getattr(h, n)) for n in ("step_interval", "interval_block", "out_step", "depth_width")),
        array("int", "temperature_width", h.temperature_width),
        *(array("int", n, getattr(h, n)) for n in ("weight_start", "weight_segment")),
        array("double", "modes", h.modes),
        array("double", "weight", h.weight),
        f"static const double torque[] = {{{', '.join(map(repr, torque))}}};",
        f"static const fsw_nmpc_model model = {{{len(h.step_length_s)}, N_OUT, N_BLOCKS, N_HISTORY, step_interval,"
        " interval_block, out_step, depth_width, temperature_width, modes, weight_start, weight_segment, weight,"
        f" torque, {p.operating_depth_mm}, {p.operating_force_kn}}};",
    ]
    return "\n".join(lines)


@pytest.mark.parametrize("blocks", [20, 54])
def test_kernel_under_sanitizers(tmp_path, blocks):
    compiler = kernel_build.compiler()
    if compiler is None:
        pytest.skip("no C compiler")
    (tmp_path / "tables.h").write_text(tables(blocks), encoding="utf-8")
    (tmp_path / "driver.c").write_text(textwrap.dedent(DRIVER), encoding="utf-8")
    program = tmp_path / "driver"
    sources = [str(kernel_build.FOLDER / name) for name in kernel_build.SOURCES]
    include = ["-I", str(kernel_build.FOLDER), "-I", str(tmp_path)]
    build = [*compiler, *FLAGS, *include, str(tmp_path / "driver.c"), *sources, "-o", str(program), "-lm"]
    probe = tmp_path / "probe.c"
    probe.write_text("int main(void) { return 0; }\n", encoding="utf-8")
    if subprocess.run([*compiler, *FLAGS, str(probe), "-o", str(tmp_path / "probe")], capture_output=True).returncode:
        pytest.skip("this compiler has no sanitizers")
    built = subprocess.run(build, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr
    ran = subprocess.run([str(program)], capture_output=True, text=True, check=False, timeout=100)
    assert ran.returncode == 0, ran.stdout + ran.stderr
