"""The operator's command against a running graph."""

import time

import pytest

from fsw.main import main
from fsw_control.free_domain import free_domain
from fsw_scenario.launcher import Launcher
from fsw_scenario.scenario_file import load
from fsw_test_support.patient_weld import PatientWeld
from fsw_test_support.waiting import PATIENCE_S, wait_for_text


@pytest.fixture(scope="module")
def graph(tmp_path_factory):
    """A weld at 10 Hz that goes on for as long as the tests need."""
    folder = tmp_path_factory.mktemp("weld")
    scenario = load(
        "quick", ["duration_s=600", "events=[]", "phases=[{name: dwell, duration_s: 600.0}]"]
    )
    with free_domain() as domain, Launcher(folder / "log", domain) as launcher:
        PatientWeld(scenario, folder / "weld", realtime=True, record=False).start(launcher)
        wait_for_text(launcher, "supervisor", "controller decentral is ready")
        yield domain
        launcher.check()


@pytest.fixture
def fsw(graph, capsys, monkeypatch):
    """Run the command on the graph's domain; returns exit code, output, errors."""
    monkeypatch.setenv("ROS_DOMAIN_ID", str(graph))

    def run(*arguments):
        code = main([*arguments, "--timeout", "60"])
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return run


@pytest.fixture
def patient(fsw):
    """Run the command until it ends well and says these words.

    Where the machine stands still, it does not at once.
    """

    def run(*arguments, words=()):
        end_s = time.monotonic() + PATIENCE_S
        while True:
            code, printed, error = fsw(*arguments)
            if code == 0 and all(word in printed for word in words):
                assert error == ""
                return printed
            assert time.monotonic() < end_s, (printed, error)

    return run


def test_status_tells_who_commands_what_is_measured_and_applied(patient):
    patient(
        "status",
        words=(
            "fsw_plant",
            "auto, decentral",
            "set-point 2.66 mm",
            "degC",
            "kN",
            "from decentral",
        ),
    )


def test_controllers(patient):
    patient("controllers", words=("active decentral", "ready"))


def test_reference_keeps_what_is_left_out(fsw, patient):
    code, _, error = fsw("reference", "--depth", "2.67")
    assert (code, "the programme" in error) == (1, True)
    patient("weld", "hold")
    code, _, error = fsw("reference", "--depth", "3.8")
    assert (code, "3.8 mm" in error and "interlock" in error) == (1, True)
    assert patient("reference", "--depth", "2.67") == "set-points 2.67 mm, 816.4 degC\n"
    printed = patient("reference", "--temperature", "817")
    assert printed == "set-points 2.67 mm, 817 degC\n", "the sender of the depth has left"
    patient("status", words=("set-point 2.67 mm", "set-point 817 degC"))
    patient("weld", "resume")


@pytest.mark.parametrize(
    "arguments",
    [
        ("disturb", "temperature", "step", "0.5"),
        ("disturb", "temperature", "clear"),
        ("fault", "thermocouple", "bias", "0.5", "--duration", "0.5"),
        ("fault", "thermocouple", "clear"),
        ("mode", "hold"),
        ("mode", "manual", "--axial-force", "78.4", "--speed", "407"),
        ("mode", "auto"),
        ("switch", "decentral"),
        ("weld", "hold"),
        ("reference", "--temperature", "818", "--ramp"),
        ("weld", "resume"),
    ],
)
def test_orders_are_obeyed(patient, arguments):
    assert patient(*arguments).strip()


def test_refusals_are_one_line_and_a_bad_exit_code(fsw):
    code, _, error = fsw("switch", "nobody")
    assert code == 1
    assert "unknown controller 'nobody'" in error
    assert error.count("\n") == 1
    code, _, error = fsw("acknowledge")
    assert code == 1 and "no safe stop" in error and error.count("\n") == 1
    code, _, error = fsw("weld", "resume")
    assert code == 1 and "is running" in error and error.count("\n") == 1


def test_empty_domain_is_reported(capsys, monkeypatch):
    with free_domain() as domain:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
        for arguments in (
            ["status"],
            ["disturb", "depth", "none"],
            ["reference", "--depth", "2.7"],
        ):
            assert main([*arguments, "--timeout", "0.5"]) == 1
            error = capsys.readouterr().err
            assert error.count("\n") == 1


def test_without_a_set_point_status_says_that_it_is_what_lacks(tmp_path, capsys, monkeypatch):
    """As after weld.launch.py without a scenario."""
    with free_domain() as domain, Launcher(tmp_path / "log", domain) as launcher:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
        for name, module in (
            ("decentral", "fsw_decentral.decentral_node"),
            ("supervisor", "fsw_supervisor.supervisor_node"),
            ("plant", "fsw_plant.plant_node"),
        ):
            launcher.start(name, module)
        wait_for_text(launcher, "supervisor", "role: active")
        end_s = time.monotonic() + PATIENCE_S
        printed = ""
        while (
            "hold, no controller: starting: waiting for decentral: no set-point yet" not in printed
        ):
            assert time.monotonic() < end_s, printed
            assert main(["status", "--timeout", "60"]) == 0
            printed = " ".join(capsys.readouterr().out.split())
        assert "set-points none yet" in printed
        assert (
            main(["reference", "--depth", "2.66", "--temperature", "816.4", "--timeout", "60"])
            == 0
        )
        wait_for_text(launcher, "supervisor", "start -> auto")
        while "auto, decentral" not in printed:
            assert time.monotonic() < end_s, printed
            assert main(["status", "--timeout", "60"]) == 0
            printed = " ".join(capsys.readouterr().out.split())
