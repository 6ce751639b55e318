"""A user's own controller in a campaign, and replays of bags to controllers."""

from types import SimpleNamespace

import pytest
import yaml

from fsw.main import main
from fsw_campaign import definition
from fsw_campaign.welds import run_weld
from fsw_control.schema.models import InputError
from fsw_lab.replay import Comparison, TickDifference
from fsw_test_support.own_controller import own

pytestmark = pytest.mark.usefixtures("forgotten")


def test_a_campaign_runs_it_and_depends_on_its_source(tmp_path):
    label = own(tmp_path)
    file = tmp_path / "campaign.yaml"
    file.write_text(
        yaml.safe_dump(
            {"name": "c", "scenario": "quick", "controllers": [label, "decentral"], "welds": 1}
        )
    )
    campaign = definition.load(file)
    assert [entrant.label for entrant in campaign.entrants] == ["own", "decentral"]
    assert run_weld(campaign, 0, campaign.parameters(0), campaign.entrants[0])["status"] == "ok"
    before = campaign.digest
    own(tmp_path, "return Proposal(Command(80.0, 400.0))")
    assert campaign.digest != before
    file.write_text(file.read_text().replace("own.py:Own", "own.py:None"))
    with pytest.raises(InputError, match="no class None"):
        definition.load(file)


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
    assert main([*arguments, "--parameter", "tunning=tight"]) == 1
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
    monkeypatch.setattr("fsw_lab.bag_replay.read_messages", lambda _: messages)
    monkeypatch.setattr("fsw_lab.bag_replay.replay", replay)


def test_verify_skips_unknown_controllers(weld_bag, monkeypatch, capsys):
    bag_with(monkeypatch, ["stranger", "decentral"])
    assert main(["bag", "verify", str(weld_bag)]) == 3
    captured = capsys.readouterr()
    assert "stranger" in captured.err and "stranger" not in captured.out
    assert captured.out.startswith("decentral: all 1 ")


@pytest.mark.parametrize(
    ("compared", "code"),
    [((0, 0, 0), 0), ((0, 4, 0), 4), ((4, 1), 1), ((1, 4), 1), ((3, 4), 4), ((4, 3), 4)],
)
def test_unknown_comparison_has_its_own_exit_code(weld_bag, monkeypatch, compared, code):
    """By controller: 0 equal, 1 different, 3 unknown here, 4 different but its state at the beginning is unknown."""
    names = {
        f"{'stranger' if kind == 3 else 'decentral'}{number}": kind
        for number, kind in enumerate(compared)
    }

    def maker(name):
        if names[name] == 3:
            raise InputError("unknown")

    different, not_comparable = (
        [name for name, kind in names.items() if kind in kinds] for kinds in ((1, 4), (4,))
    )
    bag_with(monkeypatch, list(names), different, not_comparable)
    monkeypatch.setattr("fsw_lab.bag_replay.maker", maker)
    monkeypatch.setattr("fsw_lab.bag_replay.described_in", lambda _: None)
    assert main(["bag", "verify", str(weld_bag)]) == code
