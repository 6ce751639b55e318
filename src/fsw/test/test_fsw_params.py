"""``fsw.py param``: parameters of a node that runs, listed, read and changed."""

import re

import pytest

from fsw.main import main
from fsw_control.free_domain import free_domain
from fsw_scenario.launcher import Launcher

pytestmark = pytest.mark.slow
NODE = "fsw_decentral"


@pytest.fixture(scope="module")
def domain(tmp_path_factory):
    with free_domain() as domain, Launcher(tmp_path_factory.mktemp("log"), domain) as launcher:
        launcher.start("controller", "fsw_decentral.decentral_node")
        yield domain


@pytest.fixture
def param(domain, monkeypatch, capsys):
    monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))

    def run(*words):
        code = main(["param", *words, "--timeout", "60"])
        captured = capsys.readouterr()
        return code, captured.out + captured.err

    return run


def test_list_get_and_set(param):
    code, text = param("list", NODE)
    assert (
        code == 0
        and re.search(r"\ndepth_gain +-1.0 +Proportional gain", text)
        and re.search(r"\ntuning +conservative", text)
    )
    assert param("set", NODE, "depth_gain", "1e2") == (0, "depth_gain: 100.0\n")
    assert param("get", f"/{NODE}", "depth_gain") == (0, "depth_gain: 100.0\n")
    assert param("set", NODE, "tuning", "tight") == (0, "tuning: tight\n")


@pytest.mark.parametrize(
    ("words", "error"),
    [
        (("get", NODE, "depth_gian"), "mean depth_gain"),
        (("set", NODE, "depth_gian", "1"), "mean depth_gain"),
        (("set", NODE, "depth_gain", "1e9"), "refuses depth_gain"),
        (("set", NODE, "depth_gain", "much"), "'much'"),
        (("set", NODE, "depth_gain", "[1"), "type double"),
        (("set", NODE, "tuning", "5"), "'conservative', 'tight'"),
        (("set", NODE, "period", "0.2"), "read-only"),
        (("list", "a node"), "a node"),
    ],
)
def test_invalid_parameter_changes_are_refused(param, words, error):
    code, text = param(*words)
    assert code == 1 and error in text and text.startswith("error: ") and text.count("\n") == 1


def test_missing_node_is_refused_by_name(domain, monkeypatch, capsys):
    monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
    assert main(["param", "list", "fsw_nobody", "--timeout", "0.1"]) == 1
    assert "no node fsw_nobody" in capsys.readouterr().err
