"""``fsw.py identify`` and ``fsw.py tune``.

Results, one line for bad input, nothing overwritten.
"""

from collections.abc import Mapping
from math import inf
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
import yaml

from fsw.main import main
from fsw_analysis.weld_signals import WeldSignals, export_weld
from fsw_lab.identify import Identified, weld_of
from fsw_lab.tune_command import write_tunings
from fsw_model import MachineData, ModelParameters, ParameterCovariance
from fsw_scenario import scenario_file
from fsw_scenario.closed_loop import ClosedLoop
from fsw_scenario.controllers import make
from fsw_test_support.sample_weld import write_sample_weld
from fsw_tuning import identification_design

GOLDEN = Path(__file__).resolve().parents[3] / "test" / "golden"


@pytest.fixture(scope="module")
def experiment() -> WeldSignals:
    """The closed-loop experiment on a process that differs from the model."""
    overrides = [
        "duration_s=150",
        "plant.factors.thermal_gain_c_per_kw=1.3",
        "plant.factors.depth_gain_mm_per_kn_s=0.8",
    ]
    text = yaml.safe_load(scenario_file.load("identify_closed_loop").text)
    text["events"] = [event for event in text["events"] if event["at_s"] < 150.0]
    scenario = scenario_file.parse(yaml.safe_dump(text), "experiment", overrides)
    return ClosedLoop(scenario, {"decentral": make("decentral")}).run()


def error_of(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """The one line that a command that cannot be carried out prints."""
    assert main(arguments) == 1
    lines = [line for line in capsys.readouterr().err.splitlines() if line.startswith("error: ")]
    assert len(lines) == 1
    return lines[0]


def test_a_log_of_a_machine_is_read(
    experiment: WeldSignals, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, out = tmp_path / "log.csv", str(tmp_path / "model.yaml")
    export_weld(experiment, log)
    seen, meant = weld_of(log).signals, experiment
    assert seen.drives is not None and meant.drives is not None
    assert np.array_equal(seen.drives.force_kn, meant.drives.force_kn)
    for wrong, fact in (
        ("force=F", "'force'"),
        ("force_n=F", "'F'"),
        ("torque_nm=M: Nm", "'M: Nm'"),
        ("torque_nm=#4", "'#4'"),
        ("torque_nm", "QUANTITY=NAME"),
    ):
        assert fact in error_of(capsys, "identify", str(log), "--out", out, "--column", wrong)
    bag = str(tmp_path / "weld")
    assert "--column" in error_of(capsys, "identify", bag, "--out", out, "--column", "force_n=F")


def test_a_data_frame_is_read_as_a_log(experiment: WeldSignals, tmp_path: Path) -> None:
    pytest.importorskip("pandas", reason="pandas is one of the extra science")
    export_weld(experiment, log := tmp_path / "log.csv")
    frame = weld_of(log).to_pandas()
    assert np.array_equal(weld_of(frame)["depth_mm"], experiment.depth_mm)


@pytest.mark.slow
def test_identify(
    experiment: WeldSignals,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr("fsw.bags.load_weld", lambda bag, progress=None: experiment)
    out, machine, folder = (tmp_path / name for name in ("model.yaml", "machine.yaml", "report"))
    covariance, later = str(tmp_path / "covariance.yaml"), str(tmp_path / "later.yaml")
    files = (
        "--out",
        str(out),
        "--covariance",
        covariance,
        "--machine",
        str(machine),
        "--report",
        str(folder),
        "--format",
        "svg",
    )
    assert main(["identify", "weld", *files, "--validate", "weld"]) == 0
    seen = MachineData.from_file(machine)
    assert (seen.depth_noise_mm, seen.temperature_noise_c) == pytest.approx((2e-3, 0.1), rel=0.1)
    assert (seen.force_rate_kn_per_s, seen.speed_rate_rpm_per_s) == (None, None)
    model = ModelParameters.from_file(out)
    assert model.thermal_gain_c_per_kw == pytest.approx(1.3 * 18.1, rel=0.03)
    assert model.depth_gain_mm_per_kn_s == pytest.approx(0.8 * 0.0016, rel=0.05)
    assert {path.name for path in folder.glob("[!.]*")} == {"report.html", "report.svg"}
    names = "geometry_factor, contact_radius_m, geometry_offset_m3: "
    assert f"{names}not identifiable" in capsys.readouterr().out
    before = out.read_text()
    assert "exists" in error_of(capsys, "identify", "weld", "--out", str(out))
    assert out.read_text() == before
    prior = ("--model", str(out), "--prior", covariance)
    files = ("--out", str(tmp_path / "next.yaml"), "--covariance", later)
    assert main(["identify", "weld", *prior, *files]) == 0
    known, both = map(ParameterCovariance.from_file, (covariance, later))
    variances = [
        dict(zip(known_parameters.parameters, np.diag(known_parameters.matrix), strict=True))
        for known_parameters in (known, both)
    ]
    assert all(
        variances[1][name] < variances[0][name] for name in ("depth_zero_s", "copper_lag_s")
    )
    assert set(variances[0]) <= set(variances[1])


@pytest.mark.slow
def test_a_weld_at_rest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    text = yaml.safe_dump({"name": "rest", "duration_s": 40.0, "controller": "none"})
    rest = ClosedLoop(scenario_file.parse(text, "rest")).run()
    monkeypatch.setattr("fsw.bags.load_weld", lambda bag, progress=None: rest)
    out = tmp_path / "model.yaml"
    assert "hardly move" in error_of(capsys, "identify", "weld", "--out", str(out))
    assert not out.exists()


def test_bad_input(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = str(tmp_path / "model.yaml")
    short = tmp_path / "short"
    write_sample_weld(short, 20)
    assert "nothing there" in error_of(
        capsys, "identify", str(tmp_path / "nothing there"), "--out", out
    )
    assert "of 30 s" in error_of(capsys, "identify", str(short), "--out", out)
    assert "give the bag" in error_of(capsys, "identify", "--out", out)
    assert "--out" in error_of(capsys, "identify", str(short))
    golden = str(GOLDEN / "open_loop_force_steps")
    assert "nothing there" in error_of(
        capsys, "identify", golden, "--out", out, "--validate", str(tmp_path / "nothing there")
    )
    assert "nowhere" in error_of(
        capsys, "identify", str(short), "--out", out, "--model", str(tmp_path / "nowhere")
    )
    unwritable = str(Path(golden) / "metadata.yaml" / "folder")
    assert unwritable in error_of(capsys, "identify", golden, "--out", f"{unwritable}/model.yaml")
    assert f"folder {unwritable}" in error_of(
        capsys, "identify", golden, "--out", out, "--report", unwritable
    )
    assert not Path(out).exists()


@pytest.mark.parametrize(
    "arguments",
    [
        ["identify", "no bag", "--out", "model.yaml", "--report", "old"],
        ["tune", "--model", "old/model.yaml", "--out", "old"],
        ["canister", "--power", "40", "--probe", "0,0,0", "--vtk", "old"],
    ],
)
def test_force_keeps_an_earlier_result_if_the_command_cannot_be_carried_out(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    old = tmp_path / "old" / "model.yaml"
    old.parent.mkdir()
    old.write_text("{}\n")
    (old.parent / ".fsw_results").touch()
    error_of(capsys, *arguments, "--force")
    assert old.exists()


def test_a_bag_without_the_needed_topics(
    genuine: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = error_of(
        capsys, "identify", str(genuine / "mcap_default"), "--out", str(tmp_path / "model.yaml")
    )
    assert "of depth, torque" in line and "/fsw/spindle_torque" in line


def test_an_empty_bag(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_sample_weld(tmp_path / "empty", 0)
    line = error_of(
        capsys, "identify", str(tmp_path / "empty"), "--out", str(tmp_path / "model.yaml")
    )
    assert "empty" in line


def test_a_prior_is_of_a_model(capsys: pytest.CaptureFixture[str]) -> None:
    files = ("identify", "bag", "--out", "model.yaml")
    assert "--model" in error_of(capsys, *files, "--prior", "covariance.yaml")
    assert "--prior" in error_of(capsys, *files, "--other-type")
    assert "no prior" in error_of(capsys, "identify", "--design", "--prior", "covariance.yaml")


def test_covariance_is_that_of_the_parameters_in_the_model_file() -> None:
    """Where the thermocouple lags, that is not the tool's dead time."""
    tool = ModelParameters()
    fit = SimpleNamespace(
        parameters=tool,
        shown=tool.scaled(dead_time_s=1.2),
        free=("copper_lag_s", "dead_time_s"),
        covariance=np.array([[4e-4, 1e-4], [1e-4, 9e-4]]),
    )
    known = Identified("weld", cast("Any", fit)).covariance
    assert (known.parameters, known.covariance) == (["copper_lag_s"], [[4e-4]])


def test_a_design_takes_no_bags(capsys: pytest.CaptureFixture[str]) -> None:
    assert "takes no bags" in error_of(capsys, "identify", "--design", "bag")


@pytest.mark.slow
@pytest.mark.full
def test_design(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    propose = identification_design.propose
    monkeypatch.setattr(
        identification_design,
        "propose",
        lambda s, closed, model, progress: propose(s, closed, model, 2, progress),
    )
    out = tmp_path / "experiment.yaml"
    assert main(["identify", "--design", "--duration", "90", "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    assert "thermal_gain_c_per_kw" in printed and "open loop" not in printed
    assert main(["identify", "--design", "--duration", "60", "--open-loop"]) == 0
    assert "drift far" in capsys.readouterr().out
    scenario = scenario_file.load(str(out))
    assert scenario.duration_s == 90.0 and scenario.events


@pytest.mark.slow
@pytest.mark.parametrize("name", ["identify_closed_loop", "identify_open_loop"])
def test_shipped_experiments_are_safe_and_identify_all_parameters(name: str) -> None:
    proposal = identification_design.assess(scenario_file.load(name).text)
    assert (
        proposal.depth_mm < identification_design.SAFE_MM
        and proposal.temperature_c < identification_design.SAFE_C
    )
    assert all(proposal.deviations[of] < aim for of, aim in identification_design.AIMS.items())


def test_tune_refuses_bad_input(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model, full = tmp_path / "model.yaml", tmp_path / "full"
    full.mkdir()
    (full / "file").touch()
    out = ("--out", str(tmp_path / "out"))
    assert f"model {model}" in error_of(capsys, "tune", "--model", str(model), *out)
    model.write_text("thermal: 1\n")
    assert "unknown key" in error_of(capsys, "tune", "--model", str(model), *out)
    model.write_text("{}\n")
    assert "not empty" in error_of(capsys, "tune", "--model", str(model), "--out", str(full))
    assert not (tmp_path / "out").exists()


class Loops:
    """Margins that are known at once.

    The NMPC's are large enough from three quarters of its aggressiveness on.
    """

    def __init__(
        self, label: str, parameters: Mapping[str, Any], process: ModelParameters
    ) -> None:
        self.aggressiveness = parameters.get("temperature_aggressiveness", 1.0)

    def margins(self) -> dict[str, float]:
        return {
            "depth_gain": inf,
            "temperature_gain": 2.7,
            "depth_delay_s": 1.1,
            "temperature_delay_s": 6.5,
        }

    def has(self, gain: float, delay_s: float) -> bool:
        assert (gain, delay_s) == (2.7, 6.5)
        return bool(self.aggressiveness < 0.75)


@pytest.mark.slow
def test_tuned_files_are_taken_by_the_controllers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("fsw_lab.tune_command.margins.Loops", Loops)
    model, machine, out = (tmp_path / name for name in ("model.yaml", "machine.yaml", "out"))
    model.write_text("dead_time_s: 3.5\n")
    machine.write_text("speed_rate_rpm_per_s: 10.0\ntemperature_noise_c: 0.4\n")
    tune = ["tune", "--model", str(model), "--evaluations", "3", "--no-sweep"]
    assert main([*tune, "--out", str(out), "--machine", str(machine)]) == 0
    machine.unlink()
    assert capsys.readouterr().out.count("> 8") == 4
    for label in ("decentral_conservative", "decentral_tight", "nmpc"):
        text = (out / f"{label}.yaml").read_text()
        assert "# Margins" in text and "temperature: delay ≥ 6.5 s" in text
        ((_, section),) = yaml.safe_load(text).items()
        made = make(label.partition("_")[0], section["ros__parameters"])
    assert made.settings.limits.speed_step_rpm == pytest.approx(1.0)
    assert made.settings.tuning.estimator.temperature_noise_c == pytest.approx(0.4)
    arguments = [
        "simulate",
        "quick",
        "--controller",
        "decentral",
        "--no-figures",
        "--out",
        str(tmp_path / "welds"),
    ]
    assert main([*arguments, "--params-file", str(out / "decentral_tight.yaml")]) == 0


@pytest.mark.slow
def test_the_nmpc_is_slowed_until_its_margins_are_those_of_the_tight_tuning(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fsw_lab.tune_command.margins.Loops", Loops)
    model = tmp_path / "model.yaml"
    model.write_text("dead_time_s: 3.5\n")
    (out := tmp_path / "out").mkdir()
    write_tunings(model, out, 1, matched=True)
    text = (out / "nmpc_tuning.yaml").read_text()
    assert yaml.safe_load(text)["temperature_time_s"] == pytest.approx(0.3 * 3.5 * 1.12**3)
    assert "times 1.4" in text and "decentral:tight" in text


def test_a_wrong_parameter_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "file.yaml"
    file.write_text("- 1\n")
    error = error_of(capsys, "simulate", "quick", "--params-file", str(file))
    assert str(file) in error and "parameter file" in error
