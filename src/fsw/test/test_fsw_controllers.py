"""Every command finds a controller of a user's own, and nothing that it does is a traceback."""

from pathlib import Path
from types import SimpleNamespace

import pytest

from fsw.demo import _controllers, parser
from fsw.main import main
from fsw_analysis.replay import Comparison, TickDifference
from fsw_scenario import scenario_file
from fsw_scenario.graph import WeldGraph
from fsw_schema.models import InputError
from fsw_test_support.own_controller import own

SOURCES = Path(__file__).resolve().parents[2]
EXAMPLE = f"{SOURCES.parent}/examples/my_controller.py:DepthOnly"
pytestmark = pytest.mark.usefixtures("forgotten")


def test_every_command_takes_it(tmp_path, capsys):
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
    chosen = _controllers(
        parser().parse_args(["--controller", EXAMPLE, "--controller", "decentral:tight"])
    )
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
def test_one_that_never_works_has_no_figures(tmp_path, capsys, step):
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


def test_one_that_fails_now_and_then_is_told_as_not_healthy(tmp_path, capsys):
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


def test_parameters_of_a_shadow_are_checked(weld_bag, tmp_path, capsys):
    arguments = [
        "bag",
        "shadow",
        str(weld_bag),
        "--controller",
        "decentral",
        "--out",
        str(tmp_path / "out"),
    ]
    assert main([*arguments, "--set", "tunning=tight"]) == 1
    error = capsys.readouterr().err
    assert "tunning" in error and "mean tuning" in error and not (tmp_path / "out").exists()


def bag_with(monkeypatch, names, differences=(), not_comparable=()):
    """`bag verify` finds these controllers; those of `differences` differ."""

    def replay(messages, name, *_):
        different = [TickDifference(0, 0.1, 1.0, 1.0, 1.0)] if name in differences else []
        compared = Comparison(name, 1, different)
        return SimpleNamespace(
            notes=[], comparable=name not in not_comparable, against_own=lambda *_: compared
        )

    messages = SimpleNamespace(controllers=lambda _: names)
    monkeypatch.setattr("fsw.bag_replay.read_messages", lambda _: messages)
    monkeypatch.setattr("fsw.bag_replay.replay", replay)


def test_verify_leaves_out_whom_it_does_not_know(weld_bag, monkeypatch, capsys):
    bag_with(monkeypatch, ["stranger", "decentral"])
    assert main(["bag", "verify", str(weld_bag)]) == 3
    captured = capsys.readouterr()
    assert "stranger" in captured.err and "stranger" not in captured.out
    assert captured.out.startswith("decentral: all 1 ")


@pytest.mark.parametrize(
    ("found", "code"),
    [((0, 0, 0), 0), ((0, 4, 0), 4), ((4, 1), 1), ((1, 4), 1), ((3, 4), 4), ((4, 3), 4)],
)
def test_what_cannot_be_compared_is_neither_equal_nor_unequal(weld_bag, monkeypatch, found, code):
    """By controller: 0 equal, 1 different, 3 unknown here, 4 different but its state at the beginning is unknown."""
    names = {
        f"{'stranger' if one == 3 else 'decentral'}{number}": one
        for number, one in enumerate(found)
    }

    def maker(name):
        if names[name] == 3:
            raise InputError("unknown")

    different, not_comparable = (
        [name for name, one in names.items() if one in kinds] for kinds in ((1, 4), (4,))
    )
    bag_with(monkeypatch, list(names), different, not_comparable)
    monkeypatch.setattr("fsw.bag_replay.maker", maker)
    monkeypatch.setattr("fsw.bag_replay.described_in", lambda _: None)
    assert main(["bag", "verify", str(weld_bag)]) == code
