"""The shipped gains on processes that differ from the model; the command."""

import pytest

from decentral_tuning.command import MISMATCH, main
from fsw_decentral import tunings
from fsw_model import nominal
from fsw_tuning.decentral_loop import errors, simulated_sensitivity


@pytest.mark.slow
@pytest.mark.parametrize("name", tunings())
def test_shipped_gains_are_stable_on_processes_unlike_the_model(name):
    for factors in MISMATCH.values():
        assert max(simulated_sensitivity(tunings()[name], nominal().scaled(**factors))) < 3.5


@pytest.mark.slow
@pytest.mark.full
def test_the_command_checks_the_shipped_gains(capsys):
    assert main(["--check"]) == 0
    printed = capsys.readouterr().out
    assert "dead time +20 %" in printed
    assert f"{errors(tunings()['tight'])['tracking_iae_depth_mm_s']:.4g} (" in printed


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--evaluations", "many"], "many"),
        (["--tuning", "loose"], "loose"),
        (["--write", "--check"], "--check"),
    ],
)
def test_bad_input_is_one_line(capsys, arguments, said):
    with pytest.raises(SystemExit, match="2"):
        main(arguments)
    complaints = [line for line in capsys.readouterr().err.splitlines() if "error:" in line]
    assert len(complaints) == 1 and said in complaints[0]
