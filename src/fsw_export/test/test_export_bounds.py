"""The exported C folder: whatever its inputs are, its command is inside the bounds."""

import csv
import random
import subprocess
from math import inf, nan

import pytest

from fsw_control.c_library import compiler
from fsw_decentral import DecentralController
from fsw_export.c_folder import FLAGS, fill
from fsw_export.sources import sources_of
from fsw_export.vectors import csv_text
from fsw_nmpc import NmpcController
from fsw_test_support.c_code import SANITIZE, has_sanitizers

SANE = {"depth_mm": 2.66, "torque_nm": 1052.0, "temperature_c": 816.4, "reference_depth_mm": 2.7, "dt_s": 0.1}
SANE |= {"reference_temperature_c": 818.0, "acting_force_kn": 78.4, "acting_speed_rpm": 407.6}
SANE |= {"applied_force_kn": 78.4, "applied_speed_rpm": 407.6}
JUNK = (nan, inf, -inf, 0.0, -0.0, 5e-324, -1.0, 97.0, 1e12, -1e12, 1e300, -1e300, 1.7e308)


def rows(signals, rng):
    """Ticks of which the first is sane, and in the others a third of the inputs is anything."""
    for k in range(600):
        yield [
            rng.choice((0, 1, 1, -7, 9))
            if signal.is_int
            else rng.choice(JUNK)
            if k and rng.random() < 0.3
            else SANE.get(signal.name, 0.0)
            for signal in signals
        ]


@pytest.mark.requirement("S31")
@pytest.mark.slow
@pytest.mark.parametrize("name", ["nmpc", "decentral"])
def test_whatever_comes_the_command_is_inside_the_bounds(name, tmp_path):
    made = sources_of({"nmpc": NmpcController, "decentral": DecentralController}[name]())
    folder = tmp_path / "export"
    fill(folder, made, {})
    ticks = tmp_path / "ticks.csv"
    ticks.write_text(csv_text(made.inputs, list(rows(made.inputs, random.Random(5)))), encoding="utf-8")
    files = [str(folder / "main.c"), *map(str, (folder / "src").glob("*.c"))]
    checks = SANITIZE if has_sanitizers(tmp_path) else ()
    command = [*compiler(), *FLAGS, *checks, "-I", str(folder), "-I", str(folder / "src"), *files]
    subprocess.run([*command, "-o", str(tmp_path / "run"), "-lm"], check=True)
    ran = subprocess.run([str(tmp_path / "run"), str(ticks)], capture_output=True, text=True, check=True, timeout=100)
    told = list(csv.DictReader(ran.stdout.splitlines()))
    assert len(told) == 600
    for row in told:
        assert 60.0 <= float(row["force_kn"]) <= 95.0 and 300.0 <= float(row["speed_rpm"]) <= 500.0
    assert any(row["reason"] == "5" and row["healthy"] == "0" for row in told)
