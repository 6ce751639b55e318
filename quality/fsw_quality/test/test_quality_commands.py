"""The commands of the quality distribution among those of the command line."""

import subprocess
import sys
from pathlib import Path

import pytest

from fsw.main import parser
from fsw_control.schema.extensions import all_loaded
from fsw_test_support.command_line import run


@pytest.mark.parametrize("name", ["fsw.py", "fsw"])
@pytest.mark.parametrize("command", [("bag", "attest"), ("bag", "verify-evidence")])
def test_help_names_commands_as_the_user_types_them(capsys, monkeypatch, name, command):
    monkeypatch.setattr(sys, "argv", [f"/somewhere/{name}"])
    _, printed, _ = run(capsys, *command, "--help")
    assert f"{name} " in printed and ("fsw.py" in printed) == (name == "fsw.py")


@pytest.mark.slow
def test_they_need_no_extra_for_help():
    code = """
import sys
from fsw.main import parser
extras = "skfem meshio distributed pyarrow cryptography fpdf shtab gymnasium pandas xarray asyncua"
sys.modules.update(dict.fromkeys([*extras.split(), "starlette", "rclpy"]))
assert "verify-evidence" in parser("fsw.py", "bag").format_help() + parser().parse_args(["bag", "verify-evidence"]).verb
"""
    subprocess.run([sys.executable, "-c", code], check=True)


def test_the_record_of_a_weld_by_a_procedure_is_written_after_its_recording():
    (words,) = [make("{bag}", "some.yaml") for make in all_loaded("fsw.record_hooks").values()]
    assert words[1:3] == ["-m", "fsw.main"]
    parsed = parser("fsw.py", "record").parse_args(words[3:])
    assert (parsed.bag, parsed.procedure, parsed.out) == (
        [Path("{bag}")],
        "some.yaml",
        Path("{bag}/record"),
    )
