"""What the commands of the lab refuse."""

import pytest

from fsw_test_support.command_line import replaces_nothing, run


@pytest.mark.parametrize(
    "arguments",
    [
        ["tune", "--model", "/usr/bin/env", "--out", "/nowhere/at/all"],
        ["tune", "--model", "/dev/null", "--out", "/nowhere/at/all"],
        ["identify", "--design", "--model", "/usr/bin/env"],
    ],
)
def test_bad_input_is_one_line_and_a_bad_exit_code(capsys, arguments):
    code, _, error = run(capsys, *arguments)
    assert code == 1
    assert error.startswith("error: ")
    assert error.count("\n") == 1


@pytest.mark.parametrize(
    "arguments",
    [
        ["identify", "--design", "--drive-lag", "nan"],
        ["identify", "--design", "--drive-lag=-1"],
        ["identify", "--design", "--duration", "5"],
        ["canister", "--power", "-1"],
        ["canister", "--power", "201"],
        ["tune", "--model", "m.yaml", "--out", "o", "--evaluations", "0"],
        ["tune", "--model", "m.yaml", "--out", "o", "--evaluations", "2.5"],
    ],
)
def test_wrong_arguments_tell_the_usage(capsys, arguments):
    code, _, error = run(capsys, *arguments)
    assert code == 2
    assert "usage:" in error


def test_zsh_completes_the_file_of_a_figure(capsys):
    script = run(capsys, "completion", "zsh")[1].splitlines()
    pictures = [line for line in script if ":FILE.png:" in line]
    assert pictures and [line for line in pictures if ":_files" not in line] == []


OVERWRITING = [
    ["campaign", "report", "{folder}", "--out", "{file}.md"],
    ["identify", "{bag}", "--out", "{file}"],
    ["bag", "shadow", "{bag}", "--controller", "decentral", "--json", "{file}"],
]


@pytest.mark.parametrize("arguments", OVERWRITING, ids=" ".join)
def test_no_file_is_replaced_without_force(capsys, tmp_path, arguments):
    replaces_nothing(capsys, tmp_path, arguments)


@pytest.mark.parametrize("command", ["export c", "export fmu decentral"])
def test_an_export_is_refused_before_any_work(capsys, tmp_path, monkeypatch, command):
    monkeypatch.setattr(
        "fsw_export.vectors.make", lambda *_: pytest.fail("the controller was made")
    )
    monkeypatch.setattr("fsw_export.fmu.make", lambda *_: pytest.fail("the unit was made"))
    for name in ("taken", "taken.fmu"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "letter").write_text("x")
    end = ".fmu" if "fmu" in command else ""
    for out, words in (
        (f"taken{end}", ("holds something else", "exists already")),
        (f"no/out{end}", ("cannot write",)),
    ):
        code, _, error = run(capsys, *command.split(), "--out", str(tmp_path / out))
        assert code == 1 and any(word in error for word in words)
