"""The operator's command, as far as it needs no graph."""

import argparse
import errno
import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

import fsw
from fsw.command import picture
from fsw.console import new_folder
from fsw.errors import CommandError, exit_code
from fsw.main import GROUP, parser
from fsw_control.schema.extensions import extensions
from fsw_test_support.command_line import replaces_nothing, run
from fsw_test_support.sample_weld import write_sample_weld


def test_simulate_writes_results(capsys, tmp_path):
    out = tmp_path / "results"
    code, printed, _ = run(
        capsys,
        "simulate",
        "quick",
        "--no-noise",
        "--controller",
        "decentral:tight",
        "--controller",
        "decentral",
        "--out",
        str(out),
    )
    assert code == 0
    assert "IAE depth" in printed
    assert {path.name for path in out.glob("[!.]*")} == {
        "kpi.json",
        "kpi.md",
        "overview.png",
        "signals_decentral.csv",
        "signals_decentral_tight.csv",
    }
    assert [entry["label"] for entry in json.loads((out / "kpi.json").read_text())] == [
        "decentral:tight",
        "decentral",
    ]
    assert len((out / "signals_decentral.csv").read_text().splitlines()) == 601


def test_parameters_of_a_controller(capsys, tmp_path):
    def signals(*arguments):
        out = tmp_path / str(len(arguments))
        assert (
            run(capsys, "simulate", "quick", "--no-figures", "--out", str(out), *arguments)[0] == 0
        )
        return (out / "signals_decentral.csv").read_bytes()

    assert signals("--parameter", "decentral.tuning=tight") != signals()


def test_nothing_is_overwritten(capsys, tmp_path):
    (tmp_path / "precious").write_text("x")
    code, _, error = run(capsys, "simulate", "quick", "--out", str(tmp_path))
    assert code == 1
    assert "not empty" in error
    assert [path.name for path in tmp_path.iterdir()] == ["precious"]


def test_force_replaces_the_folder_of_an_earlier_run(capsys, tmp_path):
    out = tmp_path / "out"
    again = ("simulate", "quick", "--no-figures", "--out", str(out))
    assert run(capsys, *again)[0] == 0
    (out / "signals_decentral.csv").write_text("")
    assert run(capsys, *again)[0] == 1
    assert run(capsys, *again, "--force")[0] == 0
    assert (out / "signals_decentral.csv").stat().st_size
    (tmp_path / "precious").write_text("x")
    assert run(capsys, *again[:-1], str(tmp_path), "--force")[0] == 1
    assert (tmp_path / "precious").exists() and out.exists()


def test_ctrl_c_while_modules_are_loaded_ends_in_a_line():
    program = """
import os, signal, sys

class Interrupt:
    def find_spec(self, name, path=None, target=None):
        if name == "fsw.main":
            os.kill(os.getpid(), signal.SIGINT)

sys.meta_path.insert(0, Interrupt())
from fsw.__main__ import main
main()
"""
    ran = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert (ran.returncode, ran.stderr) == (130, "interrupted\n")


@pytest.mark.parametrize("form", ["{}", "nmpc.tuning_file={}"])
def test_force_keeps_files_that_the_command_reads(tmp_path, form):
    out = tmp_path / "out"
    used, figure = out / "model.yaml", out / "figure.png"
    out.mkdir()
    for file in (used, figure, out / ".fsw_results"):
        file.touch()
    arguments = argparse.Namespace(out=out, force=True, text=[form.format(used)], png=figure)
    with pytest.raises(CommandError):
        new_folder(arguments, "", outputs=[figure])
    assert used.exists() and figure.exists()
    new_folder(argparse.Namespace(out=out, force=True, png=figure), "", outputs=[figure])
    assert not used.exists() and (tmp_path / "out_1" / "model.yaml").exists()


def test_force_follows_a_link_and_refuses_the_current_folder(capsys, tmp_path, monkeypatch):
    (tmp_path / "disk").mkdir()
    (tmp_path / "link").symlink_to("disk")
    again = ("simulate", "quick", "--no-figures", "--force", "--out")
    for _ in range(2):
        assert run(capsys, *again, str(tmp_path / "link"))[0] == 0
    assert {path.name for path in tmp_path.iterdir()} == {"link", "disk", "disk_1"}
    assert (tmp_path / "link").is_symlink()
    monkeypatch.chdir(tmp_path / "disk")
    assert run(capsys, *again, ".")[0] == 1
    assert any((tmp_path / "disk").iterdir())


def test_force_keeps_files_added_later(capsys, tmp_path):
    again = ("simulate", "quick", "--no-figures", "--out", str(tmp_path / "out"))
    assert run(capsys, *again)[0] == 0
    (tmp_path / "out" / "notes").write_text("x")
    assert run(capsys, *again, "--force")[0] == 0
    assert (tmp_path / "out_1" / "notes").exists()


@pytest.mark.parametrize(
    "arguments",
    [
        ["simulate", "nothing_of_the_kind"],
        ["simulate"],
        ["simulate", "quick", "--controller", "nobody"],
        ["simulate", "quick", "--set", "plant.colour=red"],
        ["simulate", "quick", "--parameter", "decentral.colour=red"],
        ["simulate", "quick", "--parameter", "decentral.tuning"],
        ["simulate", "quick", "--parameter", "nmpc.preset=paper"],
        ["simulate", "open_loop_force_steps", "--controller", "decentral"],
        ["simulate", "quick", "--set", "plant.model_file=/usr/bin/env"],
        ["simulate", "quick", "--set", "plant.model_file=/dev/null"],
        ["simulate", "quick", "--heat", "nothing_of_the_kind.yaml"],
        ["simulate", "quick", "--heat", "/dev/null"],
        ["demo", "--heat", "heat.yaml"],
        ["demo", "--live", "--model", "/dev/null"],
        [
            "simulate",
            "quick",
            "--controller",
            "nmpc",
            "--parameter",
            "nmpc.model_file=/usr/bin/env",
        ],
        ["simulate", "quick", "--params-file", "/usr/bin/env"],
        ["simulate", "quick", "--parameter", ".tuning=tight"],
        ["simulate", "quick", "--parameter", "decentral=tight"],
        ["bag", "kpi", "/nowhere/at/all"],
        ["reference"],
        ["disturb", "depth", "step", "5"],
        ["disturb", "temperature", "step", "nan"],
        ["disturb", "temperature", "step"],
        ["disturb", "temperature", "step", "5", "--period", "3"],
        ["disturb", "temperature", "ramp", "5"],
        ["disturb", "temperature", "clear", "5"],
        ["fault", "depth", "freeze", "0.1"],
        ["fault", "depth", "bias"],
        ["fault", "depth", "delay", "100"],
        ["mode", "manual"],
        ["mode", "hold", "--axial-force", "80"],
    ],
)
def test_bad_input_is_one_line_and_a_bad_exit_code(capsys, arguments):
    code, _, error = run(capsys, *arguments)
    assert code == 1
    assert error.startswith("error: ")
    assert error.count("\n") == 1


@pytest.mark.timeout(60)
@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (None, "not a regular file"),
        (
            "\n".join(f"a{n}: &a{n} [{f'*a{n - 1}, ' * 9 * (n > 0)}x]" for n in range(9)),
            "than 100000 values",
        ),
        ("events: " + "[" * 3000 + "]" * 3000, "than 50 levels"),
    ],
)
@pytest.mark.parametrize("option", [[], ["quick", "--params-file"]])
def test_hostile_file_is_one_line_at_once(capsys, tmp_path, option, text, problem):
    path = tmp_path / "weld.yaml"
    if text is None:
        os.mkfifo(path)
    else:
        path.write_text(text)
    code, _, error = run(capsys, "simulate", *option, str(path), "--out", str(tmp_path / "out"))
    assert code == 1 and error.startswith("error: ") and error.count("\n") == 1
    assert str(path) in error and problem in error


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["fly"],
        ["reference", "--depth", "9"],
        ["reference", "--depth", "deep"],
        ["reference", "--dept", "2.7"],
        ["fault", "nose", "nan"],
        ["bag", "shadow", "/nowhere", "--controller", "decentral", "--duration=-5"],
        ["bag", "shadow", "/nowhere", "--controller", "decentral", "--duration", "nan"],
        ["bag", "verify", "/nowhere", "--tolerance=-1"],
    ],
)
def test_wrong_arguments_tell_the_usage(capsys, arguments):
    code, _, error = run(capsys, *arguments)
    assert code == 2
    assert "usage:" in error


@pytest.mark.parametrize(
    ("arguments", "meant"),
    [
        (["--verison"], "--version"),
        (["simulat"], "simulate"),
        (["bag", "inf"], "info"),
        (["hmi", "user", "ad"], "add"),
        (["simulate", "quick", "--no-figure"], "--no-figures"),
        (["bag", "info", "--jsn", "bag"], "--json"),
    ],
)
def test_misspelt_word_gets_a_suggestion(capsys, arguments, meant):
    code, _, error = run(capsys, *arguments)
    assert code == 2 and meant in error.split("usage:")[-1].splitlines()[-1]


@pytest.mark.parametrize(
    "words", [("identify", "weld"), ("bag", "verify", "weld"), ("record", "--help")]
)
def test_missing_command_names_its_distribution(capsys, monkeypatch, words):
    core = {name: at for name, at in extensions(GROUP).items() if at.value.startswith("fsw.")}
    monkeypatch.setattr("fsw.main.extensions", lambda group: core)
    code, _, error = run(capsys, *words)
    assert code == 2 and ("fsw-quality" if words[0] == "record" else "fsw-lab") in error


def test_missing_api_name_names_its_distribution(monkeypatch):
    monkeypatch.delitem(vars(fsw), "identify", raising=False)
    monkeypatch.setattr("fsw_control.schema.extensions.extensions", lambda group: {})
    with pytest.raises(AttributeError, match="fsw-lab"):
        assert fsw.identify


def test_dashes_alone_suggest_nothing(capsys):
    assert "did you mean" not in run(capsys, "bag", "plot", "x", "--set", "a=1")[2]


def test_help_is_a_command_too(capsys):
    assert run(capsys, "help", "bag", "info") == run(capsys, "bag", "info", "--help")
    assert run(capsys, "help")[0] == 0


@pytest.mark.parametrize("words", [("simulate", "refer"), ("simulate", "--controller", "decen")])
def test_bash_completes_scenarios_and_controllers(capsys, tmp_path, words):
    pytest.importorskip("shtab")
    script = tmp_path / "completion.bash"
    script.write_text(run(capsys, "completion", "bash")[1])
    program = """
source "$1"; shift
COMP_WORDS=("$@") COMP_CWORD=$(($# - 1))
_shtab_fsw "$1" "${@: -1}" ""
echo "${COMPREPLY[*]}"
"""
    completed = subprocess.run(
        ["bash", "-c", program, "bash", script, "fsw", *words],
        capture_output=True,
        text=True,
        check=True,
        cwd=tmp_path,
    )
    assert completed.stdout.split() == [
        "reference_tracking" if words[-1] == "refer" else "decentral"
    ]


def test_zsh_completes_scenarios_and_controllers(capsys):
    lines = run(capsys, "completion", "zsh")[1].splitlines()
    specs = [line for line in lines if re.search(r':_fsw_(scenario|controller)"', line)]
    assert len(specs) > 5
    # text of an option in brackets, a message without a colon of its own, what completes
    spec = re.compile(r'\s*"\*?(--\w+\[(\\.|[^]\\])*\])?:(\\.|[^:\\])*:_fsw_\w+"')
    assert [line for line in specs if not spec.fullmatch(line)] == []


@pytest.mark.parametrize(
    ("command", "words"),
    [
        ("reference", ("1.5 to 4 mm", "750 to 950 degC")),
        ("disturb", ("-1 to 1 mm", "-20 to 20 kN", "-100 to 100 rpm")),
        ("fault", ("-5 to 5 mm", "N m", "0 to 60 s")),
        ("mode", ("60 to 95 kN", "300 to 500 rpm")),
        ("switch", ("0 to 600 s",)),
        ("status", ("0.1 to 600 s",)),
    ],
)
def test_help_lists_units_and_ranges(capsys, command, words):
    code, printed, _ = run(capsys, command, "--help")
    assert code == 0
    text = " ".join(printed.split())
    assert all(word in text for word in words)


def test_notes_on_a_damaged_bag_leave_the_output_to_the_result(capsys, tmp_path):
    write_sample_weld(tmp_path / "bag", 300)
    whole = (tmp_path / "bag" / "bag_0.mcap").read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole[: len(whole) * 2 // 3])
    code, printed, error = run(
        capsys, "bag", "kpi", str(cut), "--json", str(tmp_path / "kpi.json")
    )
    assert code == 0
    assert "note: " in error and "note: " not in printed
    assert json.loads((tmp_path / "kpi.json").read_text())


OVERWRITING = [
    ["bag", "export", "{bag}", "{file}.csv"],
    ["bag", "kpi", "{bag}", "--json", "{file}"],
    ["bag", "kpi", "{bag}", "{bag}", "--json", "{file}"],
    ["bag", "plot", "{bag}", "--out", "{folder}"],
]


@pytest.mark.parametrize("arguments", OVERWRITING, ids=" ".join)
def test_no_file_is_replaced_without_force(capsys, tmp_path, arguments):
    replaces_nothing(capsys, tmp_path, arguments)


def test_file_name_refused_by_the_system_is_one_line(capsys, tmp_path):
    code, _, error = run(
        capsys, "bag", "kpi", str(tmp_path), "--json", str(tmp_path / ("x" * 300))
    )
    assert code == 1 and error.startswith("error: ") and error.count("\n") == 1


def test_invalid_ros_environment_is_one_line(capsys, monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", "abc")
    code, _, error = run(capsys, "status", "--timeout", "0.1")
    assert (
        code == 1
        and error.startswith("error: ")
        and error.count("\n") == 1
        and "ROS_DOMAIN_ID" in error
    )


def test_list_of_scenarios(capsys):
    code, printed, _ = run(capsys, "simulate", "--list")
    assert code == 0
    assert "reference_tracking" in printed


@pytest.mark.parametrize(
    ("file", "words"), [("/x/weld.csv", "/x/weld.csv: "), (None, "writing failed: ")]
)
def test_full_disk_is_one_line_with_the_file(capsys, file, words):
    def fail():
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), file)

    assert exit_code(fail) == 1
    error = capsys.readouterr().err
    assert error.startswith("error: ") and error.count("\n") == 1
    assert error.endswith(f"{words}{os.strerror(errno.ENOSPC)}\n")


def test_standard_output_may_be_closed(monkeypatch):
    monkeypatch.setattr(sys, "stdout", None)
    assert exit_code(lambda: 0) == 0


def test_help_lists_the_commands():
    text = parser().format_help()
    for command in (
        "status",
        "reference",
        "disturb",
        "fault",
        "switch",
        "controllers",
        "mode",
        "simulate",
        "bag",
    ):
        assert command in text


@pytest.mark.parametrize("name", ["fsw.py", "fsw"])
@pytest.mark.parametrize(
    ("error", "begin"), [(CommandError, "error: "), (KeyboardInterrupt, "interrupted: ")]
)
def test_an_advised_command_has_the_name_that_the_user_types(
    capsys, monkeypatch, name, error, begin
):
    monkeypatch.setattr(sys, "argv", [f"/somewhere/{name}"])

    def fail():
        raise error("run fsw.py record")

    assert exit_code(fail) in (1, 130)
    assert capsys.readouterr().err == f"{begin}run {name} record\n"


@pytest.mark.parametrize("name", ["fsw.py", "fsw"])
@pytest.mark.parametrize("command", [("bag", "recover"), ("simulate",)])
def test_help_names_commands_as_the_user_types_them(capsys, monkeypatch, name, command):
    monkeypatch.setattr(sys, "argv", [f"/somewhere/{name}"])
    _, printed, _ = run(capsys, *command, "--help")
    assert f"{name} " in printed and ("fsw.py" in printed) == (name == "fsw.py")


@pytest.mark.slow
def test_a_command_imports_nothing_of_others_and_no_extra_is_needed_for_help():
    code = """
import subprocess
import sys
from pathlib import Path
from fsw.main import main, parser
try:
    main(["--version"])
except SystemExit:
    assert not {"numpy", "pydantic", "rich"} & sys.modules.keys()
import fsw
fsw.simulate("quick", "decentral")
assert not {"fsw_nmpc", "matplotlib", "mcap", "rosbags"} & sys.modules.keys()
parser("fsw.py", "status").parse_args(["status", "--timeout", "1"])
assert not {"matplotlib", "scipy.signal", "rclpy"} & sys.modules.keys()
extras = "skfem meshio distributed pyarrow cryptography fpdf shtab gymnasium pandas xarray asyncua"
sys.modules.update(dict.fromkeys([*extras.split(), "starlette", "rclpy"]))
assert parser("fsw.py", "bag").parse_args(["bag", "info", "x"]).verb == "info"
assert parser().parse_args(["completion", "bash"]).shell == "bash"
"""
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize("sign", [signal.SIGINT, signal.SIGTERM])
def test_interrupted_command_leaves_no_partial_file(sign, tmp_path):
    program = """if True:
        import sys, time
        from pathlib import Path
        from fsw.errors import exit_code
        from fsw_control.schema.files import replacing

        def write():
            with replacing(Path(sys.argv[1])) as scratch:
                scratch.write_text("half")
                print("half", flush=True)
                while True:
                    time.sleep(0.1)  # a signal just before signal.pause() would never be noticed

        sys.exit(exit_code(write))
    """
    file = tmp_path / "weld.png"
    file.write_text("old")
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(
        [sys.executable, "-c", program, str(file)], **pipes, start_new_session=True
    ) as process:
        assert process.stdout.readline() == "half\n"
        process.send_signal(sign)
        _, error = process.communicate(timeout=600)
    assert (process.returncode, error) == (130, "interrupted\n")
    assert (file.read_text(), list(tmp_path.iterdir())) == ("old", [file])


@pytest.mark.parametrize(
    ("before", "within"),
    [(signal.SIG_DFL, signal.default_int_handler), (signal.SIG_IGN, signal.SIG_IGN)],
)
def test_sigterm_handler_is_restored_after_a_command(before, within):
    seen = []

    def end():
        seen.append(signal.getsignal(signal.SIGTERM))
        return 0

    handler = signal.signal(signal.SIGTERM, before)  # of a node in this process, perhaps
    try:
        assert exit_code(end) == 0
        assert seen == [within]
        assert signal.getsignal(signal.SIGTERM) is before
    finally:
        signal.signal(signal.SIGTERM, handler)


@pytest.mark.parametrize(("ending", "head"), [("svg", b"<?xml"), ("pdf", b"%PDF")])
def test_one_figure_in_a_file_of_its_format(capsys, tmp_path, weld_bag, ending, head):
    file = tmp_path / f"weld.{ending}"
    assert run(capsys, "bag", "plot", str(weld_bag), "--out", str(file))[0] == 0
    assert file.read_bytes().startswith(head)
    two = ("--figures", "6", "7", "--force")
    assert run(capsys, "bag", "plot", str(weld_bag), "--out", str(file), *two)[0] == 1
    other = ("--format", "png", "--force")
    assert run(capsys, "bag", "plot", str(weld_bag), "--out", str(file), *other)[0] == 1
    same = ("--format", ending, "--force")
    assert run(capsys, "bag", "plot", str(weld_bag), "--out", str(file), *same)[0] == 0


def test_unknown_figure_format_does_not_create_a_folder(capsys, tmp_path, weld_bag):
    assert run(capsys, "bag", "plot", str(weld_bag), "--out", str(tmp_path / "x.jpg"))[0] == 1
    assert not (tmp_path / "x.jpg").exists()


def test_the_name_of_a_figure_must_end_in_a_format(capsys):
    options = argparse.ArgumentParser()
    picture("--figure", "it")(options)
    assert options.parse_args(["--figure", "a.SVG"]).figure == Path("a.SVG")
    with pytest.raises(SystemExit, match="2"):
        options.parse_args(["--figure", "a.gif"])
