"""Every command finds a controller of a user's own, and nothing that it does is a traceback."""

from pathlib import Path

import pytest

from fsw.main import main
from fsw_scenario import scenario_file
from fsw_scenario.controllers import variants_of
from fsw_scenario.graph import WeldGraph
from fsw_test_support.own_controller import own

SOURCES = Path(__file__).resolve().parents[2]
EXAMPLE = f"{SOURCES.parent}/examples/my_controller.py:DepthOnly"
pytestmark = pytest.mark.usefixtures("forgotten")


def test_every_command_accepts_an_own_controller(tmp_path, capsys):
    arguments = [
        "simulate",
        "quick",
        "--controller",
        EXAMPLE,
        "--no-figures",
        "--out",
        str(tmp_path / "out"),
    ]
    assert main(arguments) == 0
    assert (
        tmp_path / "out" / "signals_depth_only.csv"
    ).is_file() and "depth_only" in capsys.readouterr().out
    chosen = variants_of([EXAMPLE, "decentral:tight"])
    assert chosen == {"depth_only": {}, "decentral": {"tuning": "tight"}}
    nodes = WeldGraph(
        scenario_file.load("quick"), tmp_path, tuple(chosen), parameters=chosen
    ).parameter_file(tmp_path)
    assert (
        nodes["fsw_decentral"]["ros__parameters"]["tuning"] == "tight"
        and "fsw_depth_only" in nodes
    )


@pytest.mark.parametrize(
    "step", ["raise RuntimeError('boom')", "return 3", "return Proposal(applied, healthy='?')"]
)
def test_controller_that_is_never_healthy_has_no_figures(tmp_path, capsys, step):
    label = own(tmp_path, step)
    assert (
        main(
            [
                "simulate",
                "quick",
                "--controller",
                label,
                "--no-figures",
                "--out",
                str(tmp_path / "out"),
            ]
        )
        == 1
    )
    error = capsys.readouterr().err
    assert "quick: own" in error and "600 ticks: controller raised" in error


def test_intermittent_controller_is_reported_unhealthy(tmp_path, capsys):
    label = own(tmp_path, "return 3 if 10.0 < measurement.time_s < 11.0 else Proposal(applied)")
    assert (
        main(
            [
                "simulate",
                "quick",
                "--controller",
                label,
                "--no-figures",
                "--out",
                str(tmp_path / "out"),
            ]
        )
        == 0
    )
    error = capsys.readouterr().err
    assert "own" in error and "9 of 600" in error and "98.5%" in error and "tick 101" in error
