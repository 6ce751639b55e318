"""The shipped gains on processes that differ from the model; the command."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from decentral_tuning.command import MISMATCH, main
from fsw_decentral import tunings
from fsw_model import nominal
from fsw_scenario.decentral_loop import errors, simulated_sensitivity

SCRIPT = Path(__file__).resolve().parents[3] / "scripts" / "tune_decentral.py"


@pytest.mark.slow
@pytest.mark.parametrize("name", tunings())
def test_shipped_gains_are_stable_on_processes_unlike_the_model(name):
    for factors in MISMATCH.values():
        assert max(simulated_sensitivity(tunings()[name], nominal().scaled(**factors))) < 3.5


@pytest.mark.slow
@pytest.mark.full
def test_the_command_checks_the_shipped_gains(tmp_path, capsys):
    file = tmp_path / "figures.json"
    assert main(["--check", "--json", str(file)]) == 0
    written = json.loads(file.read_text(encoding="utf-8"))
    assert written["tight"]["gains"] == dict(tunings()["tight"])
    assert written["tight"]["figures"]["tracking_iae_depth_mm_s"] == pytest.approx(
        errors(tunings()["tight"])["tracking_iae_depth_mm_s"]
    )
    assert "dead time +20 %" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (["--model", "missing.yaml"], 1, "missing.yaml"),
        (["--model", "bad.yaml"], 1, "warmth is an unknown key"),
        (["--json", "bad.yaml"], 1, "bad.yaml exists"),
        (["--evaluations", "many"], 2, "many"),
        (["--tuning", "loose"], 2, "loose"),
        (["--write", "--model", "bad.yaml"], 2, "--model"),
        (["--write", "--check"], 2, "--check"),
    ],
)
def test_bad_input_is_one_line(tmp_path, monkeypatch, capsys, arguments, code, said):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bad.yaml").write_text("warmth: 1.0\n", encoding="utf-8")
    try:
        returned = main(arguments)
    except SystemExit as error:
        returned = error.code
    assert returned == code
    complaints = [line for line in capsys.readouterr().err.splitlines() if "error:" in line]
    assert len(complaints) == 1 and said in complaints[0]


@pytest.mark.slow
def test_the_script_is_the_command():
    printed = subprocess.run([sys.executable, SCRIPT, "--help"], capture_output=True, text=True, timeout=60)
    assert printed.returncode == 0
    assert "--evaluations" in printed.stdout
