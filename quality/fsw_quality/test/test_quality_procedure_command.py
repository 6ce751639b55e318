"""The commands on procedures."""

from pathlib import Path

import pytest

from fsw.main import main
from fsw_recorder.signature import fingerprint, load_trusted
from fsw_scenario import procedure
from fsw_test_support.keys import make_key

SHIPPED = Path(procedure.__file__).parent / "procedures" / "copper_lid.yaml"


def test_check_and_show(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["procedure", "check", "copper_lid"]) == 0
    assert procedure.load("copper_lid").sha256 in capsys.readouterr().out
    assert main(["procedure", "show", str(SHIPPED)]) == 0
    shown = capsys.readouterr().out
    assert "temperature_c 790 to 910" in shown and "lup.lub.lu.se/record/1961682" in shown


def test_diff(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    other = tmp_path / "other.yaml"
    other.write_text(
        SHIPPED.read_text(encoding="utf-8").replace("max: 1600.0", "max: 1500.0"), encoding="utf-8"
    )
    assert main(["procedure", "diff", "copper_lid", str(other)]) == 1
    said = capsys.readouterr()
    assert "essential[torque_nm].max" in said.out and "copper_lid revision B" in said.err
    assert main(["procedure", "diff", "copper_lid", str(SHIPPED)]) == 0


def test_what_is_wrong_is_said_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["procedure", "check", str(tmp_path / "none.yaml")]) == 1
    error = capsys.readouterr().err
    assert "cannot read procedure" in error and "copper_lid" in error and error.count("\n") == 1


def test_limits_that_the_drives_cannot_keep_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Before a weld: otherwise the supervisor would not start."""
    other = tmp_path / "other.yaml"
    text = SHIPPED.read_text(encoding="utf-8")
    other.write_text(
        text.replace("min: 60.0\n    max: 97.0", "min: 10.0\n    max: 20.0"), encoding="utf-8"
    )
    assert main(["procedure", "check", str(other)]) == 1
    error = capsys.readouterr().err
    assert "force_kn" in error and error.count("\n") == 1


@pytest.mark.parametrize(
    ("before", "after", "said"),
    [
        (
            "max: 1600.0",
            "max: 100.0",
            "torque_nm at most 100 is impossible: 1053 is what the model needs at 2.66 mm",
        ),
        ("max: 66.0", "max: 6.0", "power_kw at most 6 is impossible: 44.94"),
        (
            "min: 60.0\n    max: 97.0",
            "min: 80.0\n    max: 97.0",
            "force_kn 80 to 97 is impossible: 78.4",
        ),
        ("max: 500.0", "max: 350.0", "speed_rpm 300 to 350 is impossible: 407.6"),
    ],
)
def test_limits_that_its_own_set_points_violate_are_refused(
    before: str, after: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = tmp_path / "other.yaml"
    text = SHIPPED.read_text(encoding="utf-8")
    assert before in text
    other.write_text(text.replace(before, after), encoding="utf-8")
    assert main(["procedure", "check", str(other)]) == 1
    error = capsys.readouterr().err
    assert said in error and error.count("\n") == 1


def test_a_signed_revision_is_not_edited_unnoticed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip(
        "securesystemslib", reason="not installed: pip install -r requirements/signing.lock"
    )
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    mine, key, other = tmp_path / "mine.yaml", tmp_path / "key", tmp_path / "other"
    mine.write_bytes(SHIPPED.read_bytes())

    def run(*words: object) -> tuple[int, str]:
        code = main([str(word) for word in words])
        said = capsys.readouterr()
        return code, said.out + said.err

    assert run("procedure", "check", mine, "--trusted", "none.pub")[0] == 1
    assert run("procedure", "sign", mine)[0] == 1  # no key yet
    make_key(key)
    make_key(other)
    out = ("--procedure", mine, "--out", tmp_path / "out")
    for words in (
        ("procedure", "check", mine),
        ("record", tmp_path, *out),
        ("simulate", "quick", "--bag", *out),
    ):
        code, said = run(*words, "--require-signed")
        assert code == 1 and "has no signature" in said
    assert run("simulate", "quick", "--require-signed")[0] == 1, "of no procedure"
    assert run("procedure", "sign", mine, "--key", key)[0] == 0
    assert "signed by key SHA256:" in run("procedure", "check", mine)[1]
    assert run("procedure", "check", mine, "--trusted", f"{key}.pub", "--require-signed")[0] == 0
    untrusted = run("procedure", "check", mine, "--trusted", f"{other}.pub")
    (public,) = load_trusted([Path(f"{key}.pub")])
    assert untrusted[0] == 1 and fingerprint(public.key) in untrusted[1]
    again = run("procedure", "sign", mine, "--key", key)
    assert again[0] == 1 and "--force" in again[1]
    mine.write_text(
        mine.read_text(encoding="utf-8").replace("max: 910.0", "max: 911.0"), encoding="utf-8"
    )
    for words in (("check", mine), ("show", mine), ("diff", "copper_lid", mine)):
        code, said = run("procedure", *words)
        assert (
            code == 1 and "mine.yaml: " in said and "signature" in said and said.count("\n") == 1
        )
    assert run("procedure", "sign", mine, "--key", key, "--force")[0] == 0  # a new revision
    assert run("procedure", "check", mine)[0] == 0
