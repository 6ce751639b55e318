"""The registry of controllers: every command finds one of a user's own, and nothing that it does is a traceback."""

import sys
from pathlib import Path

import pytest
import yaml

from fsw_analysis.verify import TickDifference, Verification
from fsw_experiment import controller_node, controllers, scenario_file
from fsw_experiment.campaign import definition
from fsw_experiment.campaign.errors import CampaignError
from fsw_experiment.campaign.welds import run_weld
from fsw_experiment.cli.main import main
from fsw_experiment.closed_loop import ClosedLoop
from fsw_experiment.controllers import kind_of, make, name_of, program, short
from fsw_experiment.demo import _controllers, parser
from fsw_experiment.graph import WeldGraph
from fsw_experiment.scenario import ScenarioError
from fsw_experiment.shadow_run import ShadowRun

SOURCES = Path(__file__).resolve().parents[2]
EXAMPLE = f"{SOURCES.parent}/examples/my_controller.py:DepthOnly"
OWN = """
from fsw_control import Command, Diagnosis, Proposal

class Own:
    name = "own"
    tolerated_sensors = ()
    def step(self, measurement, reference, applied, dt_s):
        {step}
    def reset(self, applied):
        pass

class Idle(Own):
    name = "idle"
    variant = "pace"

nameless = Own()
broken_name = type("Broken", (Own,), {{"name": "two words"}})
"""


@pytest.fixture(autouse=True)
def forgotten(monkeypatch):
    """What a test names by its class is forgotten after it."""
    monkeypatch.setattr(controllers, "KNOWN", dict(controllers.KNOWN))
    controllers._class_at.cache_clear()


def own(tmp_path, step="return Proposal(applied)"):
    (tmp_path / "own.py").write_text(OWN.format(step=step))
    return f"{tmp_path}/own.py:Own"


def test_entry_points_of_our_packages_are_those_of_the_registry():
    for name, place in controllers.OURS.items():
        setup = (SOURCES / f"fsw_{name}" / "setup.py").read_text(encoding="utf-8")
        assert f'"fsw.controllers": ["{name} = {place}"]' in setup
        assert kind_of(name).name == name


def test_a_controller_of_an_installed_package_is_known(tmp_path, monkeypatch):
    information = tmp_path / "theirs-1.0.dist-info"
    information.mkdir()
    (information / "METADATA").write_text("Metadata-Version: 2.1\nName: theirs\nVersion: 1.0\n")
    (information / "entry_points.txt").write_text("[fsw.controllers]\ntheirs = theirs:Own\nnmpc = theirs:Own\n")
    (tmp_path / "theirs.py").write_text(OWN.format(step="return Proposal(applied)"))
    monkeypatch.syspath_prepend(tmp_path)
    assert controllers._known() == controllers.OURS | {"theirs": "theirs:Own"}
    sys.modules.pop("theirs", None)


def test_one_named_by_its_class_is_known_by_its_name(tmp_path):
    label = own(tmp_path)
    assert (name_of(label), short(label), name_of("own")) == ("own", "own", "own")
    assert program("own") == ("fsw_experiment", "controller", [label])
    assert short("decentral:tight") == "decentral:tight"


@pytest.mark.parametrize(
    ("label", "said"),
    [
        ("nobody", "available: decentral, nmpc"),
        ("", "no name"),
        ("no_such_module:Own", "no_such_module"),
        ("{0}/missing.py:Own", "FileNotFoundError"),
        ("{0}/own.py:Nothing", "no class Nothing"),
        ("{0}/own.py:nameless", "no class nameless"),
        ("{0}/own.py:broken_name", "two words"),
        ("{0}/own.py:Own:fast", "no variants"),
        ("{0}/own.py:Idle:fast", "pace"),
        ("decentral:wrong", "wrong"),
    ],
)
def test_what_is_not_there_is_told(tmp_path, label, said):
    own(tmp_path)
    with pytest.raises(ScenarioError, match=said):
        make(label.format(tmp_path))


def test_a_name_stands_for_one_class(tmp_path):
    own(tmp_path)
    (tmp_path / "other.py").write_text("class Other:\n    name = 'nmpc'\n")
    with pytest.raises(ScenarioError, match="give it another one"):
        name_of(f"{tmp_path}/other.py:Other")


def test_a_class_that_is_no_controller_is_told(tmp_path):
    (tmp_path / "other.py").write_text("class Other:\n    name = 'other'\n    def step(self): ...\n")
    with pytest.raises(ScenarioError, match="it has no tolerated_sensors, reset"):
        make(f"{tmp_path}/other.py:Other")


def test_every_command_takes_it(tmp_path, capsys):
    arguments = ["simulate", "quick", "--controller", EXAMPLE, "--no-figures", "--out", str(tmp_path / "out")]
    assert main(arguments) == 0
    assert (tmp_path / "out" / "signals_depth_only.csv").is_file() and "depth_only" in capsys.readouterr().out
    chosen = _controllers(parser().parse_args(["--controller", EXAMPLE, "--controller", "decentral:tight"]))
    assert chosen == {"depth_only": {}, "decentral": {"tuning": "tight"}}
    nodes = WeldGraph(scenario_file.load("quick"), tmp_path, tuple(chosen), parameters=chosen).parameter_file(tmp_path)
    assert nodes["fsw_decentral"]["ros__parameters"]["tuning"] == "tight" and "fsw_depth_only" in nodes
    assert ShadowRun(tmp_path, tmp_path, EXAMPLE).name == "depth_only"


@pytest.mark.parametrize("step", ["raise RuntimeError('boom')", "return 3", "return Proposal(applied, healthy='?')"])
def test_one_that_fails_is_told_as_not_healthy(tmp_path, capsys, step):
    label = own(tmp_path, step)
    assert main(["simulate", "quick", "--controller", label, "--no-figures", "--out", str(tmp_path / "out")]) == 0
    assert "own is not healthy at 600 of 600 ticks, first at 0.1 s: controller raised" in capsys.readouterr().err


def test_a_diagnosis_that_cannot_be_read_ends_no_weld(tmp_path):
    label = own(tmp_path, "return Proposal(applied, diagnosis=Diagnosis(depth_estimate_mm='deep'))")
    signals = ClosedLoop(scenario_file.load("quick", ["controller=own"]), {"own": make(label)}).run()
    assert signals.statuses == {} and "deep" in signals.problems[0] and signals.proposals["own"].healthy.all()


def test_a_campaign_runs_it_and_depends_on_its_source(tmp_path):
    label = own(tmp_path)
    file = tmp_path / "campaign.yaml"
    file.write_text(yaml.safe_dump({"name": "c", "scenario": "quick", "controllers": [label, "decentral"], "welds": 1}))
    campaign = definition.load(file)
    assert [one.label for one in campaign.entrants] == ["own", "decentral"]
    assert run_weld(campaign, 0, campaign.parameters(0), campaign.entrants[0])["status"] == "ok"
    before = campaign.digest
    own(tmp_path, "return Proposal(Command(80.0, 400.0))")
    assert campaign.digest != before
    file.write_text(file.read_text().replace("own.py:Own", "own.py:None"))
    with pytest.raises(CampaignError, match="no class None"):
        definition.load(file)


def test_parameters_of_a_shadow_are_checked(weld_bag, tmp_path, capsys):
    arguments = ["bag", "shadow", str(weld_bag), "--controller", "decentral", "--out", str(tmp_path / "out")]
    assert main([*arguments, "--set", "tunning=tight"]) == 1
    assert "did you mean tuning" in capsys.readouterr().err and not (tmp_path / "out").exists()


def test_verify_leaves_out_whom_it_does_not_know(weld_bag, monkeypatch, capsys):
    monkeypatch.setattr("fsw_experiment.cli.replays.recorded_controllers", lambda _: ["stranger", "decentral"])
    seen = []

    def verify(bag, name, *_):
        seen.append(name)
        return Verification(name, 1)

    monkeypatch.setattr("fsw_experiment.cli.replays.verify", verify)
    assert main(["bag", "verify", str(weld_bag)]) == 3
    captured = capsys.readouterr()
    assert seen == ["decentral"] and "stranger is left out" in captured.err and "reproduced" in captured.out


@pytest.mark.parametrize(
    ("found", "code"), [((0, 0, 0), 0), ((0, 4, 0), 4), ((4, 1), 1), ((1, 4), 1), ((3, 4), 4), ((4, 3), 4)]
)
def test_what_cannot_be_compared_is_neither_equal_nor_unequal(weld_bag, monkeypatch, found, code):
    """By controller: 0 equal, 1 different, 3 unknown here, 4 different but its state at the beginning is unknown."""
    names = [f"{'stranger' if one == 3 else 'decentral'}{number}" for number, one in enumerate(found)]
    codes = dict(zip(names, found, strict=True))
    different = [TickDifference(0, 0.1, 1.0, 1.0, 1.0)]

    def verify(bag, name, *_):
        return Verification(name, 1, different if codes[name] else [], comparable=codes[name] != 4)

    def maker(name):
        if codes[name] == 3:
            raise ScenarioError("unknown")

    monkeypatch.setattr("fsw_experiment.cli.replays.recorded_controllers", lambda _: names)
    monkeypatch.setattr("fsw_experiment.cli.replays.maker", maker)
    monkeypatch.setattr("fsw_experiment.cli.replays.described_in", lambda _: None)
    monkeypatch.setattr("fsw_experiment.cli.replays.verify", verify)
    assert main(["bag", "verify", str(weld_bag)]) == code


@pytest.mark.parametrize(("words", "code"), [([], 2), (["--help"], 0), (["-h"], 0)])
def test_without_a_controller_the_node_says_what_to_give(words, code, capsys):
    assert controller_node.main(["run_controller.py", *words]) == code
    assert "FILE.py:CLASS" in capsys.readouterr().out
