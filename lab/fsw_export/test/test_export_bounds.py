"""The exported C folder: whatever its inputs are, its command is inside the bounds."""

import csv
import random
import subprocess
from math import inf, nan

import pytest

from fsw_export.signals import DECENTRAL_INPUTS, NMPC_INPUTS
from fsw_export.vectors import csv_text
from fsw_test_support.c_code import SANITIZE, compile_c, has_sanitizers
from fsw_test_support.exports import c_folder, c_objects

SANE = {
    "depth_mm": 2.66,
    "torque_nm": 1052.0,
    "temperature_c": 816.4,
    "reference_depth_mm": 2.7,
    "dt_s": 0.1,
}
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
@pytest.mark.parametrize(
    "checks", [(), pytest.param(SANITIZE, marks=pytest.mark.full)], ids=["plain", "sanitizers"]
)
@pytest.mark.parametrize("name", ["nmpc", "decentral"])
def test_any_input_keeps_the_command_within_the_bounds(name, checks, tmp_path, tmp_path_factory):
    if checks and not has_sanitizers(tmp_path):
        pytest.skip("this compiler has no sanitizers")
    folder, objects = c_folder(tmp_path_factory, name), c_objects(tmp_path_factory, name, *checks)
    inputs = {"nmpc": NMPC_INPUTS, "decentral": DECENTRAL_INPUTS}[name]
    ticks = tmp_path / "ticks.csv"
    ticks.write_text(csv_text(inputs, list(rows(inputs, random.Random(5)))), encoding="utf-8")
    options = [
        *checks,
        "-I",
        str(folder),
        "-I",
        str(folder / "src"),
        str(folder / "main.c"),
        *objects,
    ]
    built = compile_c([*options, "-o", str(tmp_path / "run"), "-lm"])
    assert built.returncode == 0, built.stderr
    ran = subprocess.run(
        [str(tmp_path / "run"), str(ticks)],
        capture_output=True,
        text=True,
        check=True,
        timeout=100,
    )
    answers = list(csv.DictReader(ran.stdout.splitlines()))
    assert len(answers) == 600
    for row in answers:
        assert 60.0 <= float(row["force_kn"]) <= 95.0 and 300.0 <= float(row["speed_rpm"]) <= 500.0
    assert any(row["reason"] == "5" and row["healthy"] == "0" for row in answers)
