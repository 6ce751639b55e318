"""The registry of controllers.

One of a user's own is found, and what is wrong with one is told.
"""

import sys

import pytest

from fsw_control.schema.extensions import extensions
from fsw_control.schema.models import InputError
from fsw_scenario import controller_node, controllers, scenario_file
from fsw_scenario.closed_loop import ClosedLoop
from fsw_scenario.controllers import kind_of, make, name_of, program, short, variants_of
from fsw_test_support.own_controller import OWN, own

pytestmark = pytest.mark.usefixtures("forgotten")


def test_entry_points_of_our_packages_are_those_of_the_registry():
    for name, place in controllers.OURS.items():
        assert extensions("fsw.controllers")[name].value == place
        assert kind_of(name).name == name


def test_a_controller_of_an_installed_package_is_known(tmp_path, monkeypatch):
    information = tmp_path / "theirs-1.0.dist-info"
    information.mkdir()
    (information / "METADATA").write_text("Metadata-Version: 2.1\nName: theirs\nVersion: 1.0\n")
    (information / "entry_points.txt").write_text(
        "[fsw.controllers]\ntheirs = theirs:Own\nnmpc = theirs:Own\n"
    )
    (tmp_path / "theirs.py").write_text(OWN.format(step="return Proposal(applied)"))
    monkeypatch.syspath_prepend(tmp_path)
    assert controllers.installed() == controllers.OURS | {"theirs": "theirs:Own"}
    sys.modules.pop("theirs", None)


def test_controller_given_by_class_is_known_by_name_afterwards(tmp_path):
    label = own(tmp_path)
    assert (name_of(label), short(label), name_of("own")) == ("own", "own", "own")
    assert program("own") == ("controller", (label,))
    assert short("decentral:tight") == "decentral:tight"


@pytest.mark.parametrize(
    ("label", "error"),
    [
        ("nobody", "available: decentral, nmpc"),
        ("", "no name"),
        ("no_such_module:Own", "no_such_module"),
        ("{0}/missing.py:Own", r"no file .*missing\.py"),
        ("{0}/own.py:Nothing", "class Nothing"),
        ("{0}/own.py:nameless", "class nameless"),
        ("{0}/own.py:broken_name", "two words"),
        ("{0}/own.py:Own:fast", "no variants"),
        ("{0}/own.py:Idle:fast", "pace"),
        ("decentral:wrong", "wrong"),
    ],
)
def test_unavailable_controller_is_refused_with_the_reason(tmp_path, label, error):
    own(tmp_path)
    with pytest.raises(InputError, match=error):
        make(label.format(tmp_path))


def test_a_name_stands_for_one_class(tmp_path):
    own(tmp_path)
    (tmp_path / "other.py").write_text("class Other:\n    name = 'nmpc'\n")
    with pytest.raises(InputError, match="name 'nmpc'"):
        name_of(f"{tmp_path}/other.py:Other")


def test_a_controller_of_a_graph_is_named_once():
    assert variants_of(["decentral:tight", "nmpc"]) == {
        "decentral": {"tuning": "tight"},
        "nmpc": {},
    }
    with pytest.raises(InputError, match=r"decentral .* twice"):
        variants_of(["decentral:tight", "nmpc", "decentral:smith"])


def test_a_parameter_that_contradicts_the_variant_is_refused():
    make("decentral:tight", {"tuning": "tight"})
    with pytest.raises(InputError, match=r"tuning=tight, .* tuning=smith"):
        make("decentral:tight", {"tuning": "smith"})


def test_class_without_the_interface_is_refused(tmp_path):
    (tmp_path / "other.py").write_text(
        "class Other:\n    name = 'other'\n    def step(self): ...\n"
    )
    with pytest.raises(InputError, match="no tolerated_sensors, reset"):
        make(f"{tmp_path}/other.py:Other")


def test_unreadable_diagnosis_is_a_problem_of_a_complete_weld(tmp_path):
    label = own(
        tmp_path, "return Proposal(applied, diagnosis=Diagnosis(depth_estimate_mm='deep'))"
    )
    signals = ClosedLoop(
        scenario_file.load("quick", ["controller=own"]), {"own": make(label)}
    ).run()
    assert (
        signals.statuses == {}
        and "deep" in signals.problems[0]
        and signals.proposals["own"].healthy.all()
    )


@pytest.mark.parametrize(("words", "code"), [([], 2), (["--help"], 0), (["-h"], 0)])
def test_node_without_a_controller_names_its_argument(words, code, capsys):
    assert controller_node.main(["run_controller.py", *words]) == code
    assert "FILE.py:CLASS" in capsys.readouterr().out
