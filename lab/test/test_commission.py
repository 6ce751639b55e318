"""fsw.py commission against a graph in lockstep.

From the check to the acceptance test, and Ctrl-C.
"""

import json
import os
import signal
import subprocess
import sys
import time

import pytest
import yaml

from fsw.main import main
from fsw_control.free_domain import free_domain
from fsw_lab import commission
from fsw_lab.commissioning import Outcome
from fsw_model import nominal
from fsw_scenario.launcher import Launcher
from fsw_test_support.patient_weld import PATIENT
from fsw_test_support.waiting import PATIENCE_S, wait_for_text, wait_until

pytestmark = [pytest.mark.slow, pytest.mark.full]
STEPS = {
    "name": "short_steps",
    "duration_s": 40.0,
    "events": [
        {"at_s": 5.0, "reference": {"depth_mm": 2.7, "temperature_c": 818.4}},
        {"at_s": 20.0, "reference": {"depth_mm": 2.66, "temperature_c": 816.4}},
    ],
}
TUNED = {"depth_gain": 40.0}
_LOCKSTEP = {"use_sim_time": True, "lockstep_deadline_s": 30.0, "lockstep_shadow_wait_s": 30.0}
NODES = {
    "fsw_supervisor": ("fsw_supervisor.supervisor_node", PATIENT | _LOCKSTEP),
    "fsw_decentral": ("fsw_decentral.decentral_node", {"use_sim_time": True}),
    "fsw_scenario": (
        "fsw_scenario.scenario_node",
        {"use_sim_time": True, "scenario": "", "silence_timeout_s": 3600.0},
    ),
    "fsw_plant": (
        "fsw_plant.plant_node",
        {
            "clock": "simulated",
            "speed": 0.0,
            "wait_for_subscribers": 2,
            "factors.thermal_gain_c_per_kw": 1.3,
        },
    ),
}


@pytest.fixture
def graph(tmp_path, monkeypatch):
    """Plant, decentralized controller, supervisor and a player that waits, in lockstep.

    The plant heats by 1.3.
    """
    file = tmp_path / "parameters.yaml"
    file.write_text(
        yaml.safe_dump({name: {"ros__parameters": values} for name, (_, values) in NODES.items()})
    )
    for name in ("experiment", "acceptance"):
        (tmp_path / f"{name}.yaml").write_text(json.dumps(STEPS))
    with free_domain() as domain, Launcher(tmp_path / "log", domain) as launcher:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
        for name, (module, _) in NODES.items():
            launcher.start(name, module, ["--ros-args", "--params-file", str(file)])
        wait_for_text(launcher, "fsw_supervisor", "controller decentral has joined")
        assert (
            main(["reference", "--depth", "2.66", "--temperature", "816.4", "--timeout", "60"])
            == 0
        )
        yield tmp_path
        launcher.check()


def arguments(folder, out):
    files = [
        word
        for name in ("experiment", "acceptance")
        for word in (f"--{name}", f"{folder / name}.yaml")
    ]
    return [
        "commission",
        "--out",
        f"{folder / out}",
        "--timeout",
        "60",
        "--yes",
        *files,
    ]


def verdicts(folder, out):
    """Verdict by step."""
    text = (folder / out / "commission.yaml").read_text()
    return {name: outcome["verdict"] for name, outcome in yaml.safe_load(text)["outcomes"].items()}


def interrupted(folder, out):
    """Ctrl-C in the middle of the experiment; returns exit code and output."""
    log = folder / "command.log"
    with log.open("wb") as file:
        environment = os.environ | {
            "PYTHONPATH": os.pathsep.join(filter(None, sys.path)),
            "PYTHONUNBUFFERED": "1",
        }
        command = [sys.executable, "-m", "fsw.main", *arguments(folder, out)]
        process = subprocess.Popen(command, stdout=file, stderr=subprocess.STDOUT, env=environment)
        try:
            wait_until(
                lambda: "running: " in log.read_text() or process.poll() is not None,
                "the experiment",
            )
            process.send_signal(signal.SIGINT)
            wait_until(lambda: process.poll() is not None, "the command's end")
        finally:
            process.kill()
    return process.returncode, log.read_text()


@pytest.fixture
def known_process(tmp_path, monkeypatch):
    """Known model and tuning.

    Identification and search have tests without a graph, and take minutes.
    """
    out = tmp_path / "out"

    def identify(work):
        model = {"thermal_gain_c_per_kw": 1.3 * nominal().thermal_gain_c_per_kw}
        (out / "model.yaml").write_text(yaml.safe_dump(model))
        return Outcome(verdict="done")

    def tune(work):
        (out / "tuned").mkdir(exist_ok=True)
        content = {"fsw_decentral": {"ros__parameters": TUNED}}
        (out / "tuned" / "decentral_conservative.yaml").write_text(yaml.safe_dump(content))
        return Outcome(verdict="done")

    monkeypatch.setattr(commission.Work, "identify", identify)
    monkeypatch.setattr(commission.Work, "tune", tune)


def test_a_running_graph_is_commissioned_and_ctrl_c_aborts(graph, known_process, capsys):
    end_s = time.monotonic() + PATIENCE_S
    while (
        main(arguments(graph, "out")) != 0
    ):  # where the machine stands still, samples are lost: a step is repeated
        assert time.monotonic() < end_s, capsys.readouterr()
    assert verdicts(graph, "out") == dict.fromkeys(commission.STEPS, "done")
    capsys.readouterr()
    assert main(["param", "get", "fsw_decentral", "depth_gain", "--timeout", "60"]) == 0
    assert float(capsys.readouterr().out.split()[1]) == pytest.approx(TUNED["depth_gain"])
    assert "predicted" in (graph / "out" / "report.md").read_text()

    (graph / "experiment.yaml").write_text(json.dumps(STEPS | {"duration_s": 3000.0}))
    end_s = time.monotonic() + PATIENCE_S
    while True:
        code, printed = interrupted(graph, "again")
        if verdicts(graph, "again").get("check") == "done":
            break
        assert time.monotonic() < end_s, printed
    assert (code, verdicts(graph, "again")) == (130, {"check": "done"}), printed
    assert "interrupted: " in printed and "was aborted" in printed
    capsys.readouterr()
    end_s = time.monotonic() + PATIENCE_S
    while True:  # status shows what it has heard within seconds; the supervisor may be late
        assert main(["status", "--timeout", "60"]) == 0
        if "safe_stop" in (printed := capsys.readouterr().out):
            break
        assert time.monotonic() < end_s, printed
    assert main(arguments(graph, "again")) == 1
    captured = capsys.readouterr()
    note = yaml.safe_load((graph / "again" / "commission.yaml").read_text())["outcomes"][
        "experiment"
    ]["note"]
    assert "mode safe_stop" in note and "fsw.py acknowledge" in note, captured
