"""The commands on procedures."""

from pathlib import Path

import pytest

from fsw.main import main
from fsw_quality import procedure

SHIPPED = Path(procedure.__file__).parent / "procedures" / "copper_lid.yaml"


def test_check_and_show(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["procedure", "check", "copper_lid"]) == 0
    assert procedure.load("copper_lid").sha256 in capsys.readouterr().out
    assert main(["procedure", "show", str(SHIPPED)]) == 0
    shown = capsys.readouterr().out
    assert "temperature_c 790 to 910" in shown and "lup.lub.lu.se/record/1961682" in shown


def test_diff(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    other = tmp_path / "other.yaml"
    other.write_text(SHIPPED.read_text(encoding="utf-8").replace("max: 1600.0", "max: 1500.0"), encoding="utf-8")
    assert main(["procedure", "diff", "copper_lid", str(other)]) == 1
    assert "essential[torque_nm].max" in capsys.readouterr().out
    assert main(["procedure", "diff", "copper_lid", str(SHIPPED)]) == 0


def test_what_is_wrong_is_said_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["procedure", "check", str(tmp_path / "none.yaml")]) == 1
    error = capsys.readouterr().err
    assert "cannot read procedure" in error and "copper_lid" in error and error.count("\n") == 1
