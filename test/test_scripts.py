"""The entry scripts: what they tell and refuse before anything runs."""

import importlib
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from fsw_control.parameters import describe
from fsw_decentral.parameters import DecentralParameters
from fsw_hmi.parameters import HmiParameters
from fsw_machine.parameters import GatewayParameters
from fsw_nmpc.parameters import NmpcParameters
from fsw_plant.parameters import PlantParameters
from fsw_recorder.parameters import RecorderParameters, ReplayParameters
from fsw_scenario.parameters import PlayerParameters
from fsw_supervisor.parameters import SupervisorParameters

pytestmark = pytest.mark.slow
SCRIPTS = Path(__file__).resolve().parents[1] / "scripts"
#: parameters of each node's script
NODES = {
    "run_nmpc": NmpcParameters,
    "run_decentral": DecentralParameters,
    "run_plant": PlantParameters,
    "run_supervisor": SupervisorParameters,
    "run_recorder": RecorderParameters,
    "run_replay": ReplayParameters,
    "run_scenario": PlayerParameters,
    "run_hmi": HmiParameters,
    "run_machine": GatewayParameters,
}


def run(script, *arguments, **options):
    command = [sys.executable, str(SCRIPTS / f"{script}.py"), *arguments]
    return subprocess.run(
        command, capture_output=True, text=True, timeout=600, check=False, **options
    )


@pytest.mark.parametrize(
    "script",
    [
        name if name in ("run_plant", "run_hmi") else pytest.param(name, marks=pytest.mark.full)
        for name in NODES
    ],
)
def test_help_lists_the_parameters_and_wrong_names_are_refused(script, tmp_path):
    ran = run(script, "--help")
    assert ran.returncode == 0 and ran.stderr == ""
    assert [name for name in describe(NODES[script]) if f"  {name}  (" not in ran.stdout] == []
    ran = run(script, "--ros-args", "-p", "nmae:=1", cwd=tmp_path)
    assert ran.returncode == 2
    assert ran.stderr.count("\n") == 1 and "unknown parameters nmae" in ran.stderr
    assert not list(tmp_path.iterdir())


def test_a_test_that_holds_the_interpreters_lock_for_ever_ends_the_run(tmp_path):
    """As Fast DDS does: the run ends, and says which test and where.

    With workers in place of dead ones xdist waits.
    """
    ends = (
        "import ctypes\n\ndef test_{0}(): pass\n\n"
        "def test_stuck(): ctypes.PyDLL(None).sleep({1})\n"
    )
    for name, stuck_s in (("first", 0), ("last", 600)):
        (tmp_path / f"test_{name}.py").write_text(ends.format(name, stuck_s))
    project = SCRIPTS.parent
    options = ["-c", project / "pyproject.toml", "-p", "conftest", "-o", "faulthandler_timeout=2"]
    workers = ["-n", "2", "--dist", "loadfile", "--no-loadscope-reorder"]
    ended = subprocess.run(
        [sys.executable, "-m", "pytest", "--rootdir", tmp_path, *options, *workers, tmp_path],
        env={**os.environ, "PYTHONPATH": str(project)},
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    assert ended.returncode == 1
    assert "crashed while running 'test_last.py::test_stuck'" in ended.stdout
    assert 'test_last.py", line 5 in test_stuck' in ended.stderr


def test_lines_are_counted_now_and_at_another_revision(tmp_path, monkeypatch, capsys):
    monkeypatch.syspath_prepend(str(SCRIPTS))
    counter = importlib.import_module("count_lines")
    monkeypatch.setattr(counter, "WORKSPACE", tmp_path)
    texts = {
        "src/fsw_a/fsw_a/part.py": '"""What it is."""\n\nx = (\n    1\n)  # a remark\n',
        "src/fsw_a/fsw_a/kernel/part.c": "/* a\n   remark */\nint x = 1;\n",
        "src/fsw_a/test/test_part.py": "x = 1\n",
        "lab/studies/canister/part.py": "x = 1\ny = 2\n",
    }
    for name, text in texts.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text, encoding="utf-8")
    git = ["git", "-C", str(tmp_path), "-c", "user.name=a", "-c", "user.email=a@b"]
    for words in (["init", "-q"], ["add", "."], ["commit", "-q", "-m", "first"]):
        subprocess.run([*git, *words], check=True)
    with (tmp_path / "src/fsw_a/fsw_a/part.py").open("a", encoding="utf-8") as file:
        file.write("# another remark\ny = 2\n")
    monkeypatch.setattr(sys, "argv", ["count_lines.py", "HEAD"])
    assert counter.main() == 0
    packages, sums, _ = capsys.readouterr().out.split("\n\n")
    rows = {tuple(line.split()[:2]): line.split()[2:] for line in packages.splitlines()}
    assert rows == {
        ("lab/studies/canister", "Python"): ["2", "2", "+0"],
        ("src/fsw_a", "C"): ["1", "1", "+0"],
        ("src/fsw_a", "Python"): ["4", "3", "+1"],
    }
    assert ["core", "Python", "4", "3", "+1", "20000"] in map(str.split, sums.splitlines())
    monkeypatch.setattr(sys, "argv", ["count_lines.py", "no_such_revision"])
    assert counter.main() == 2


@pytest.mark.parametrize(
    ("text", "language", "lines"),
    [
        (
            '"""Of a module."""\n\n# why\ndef f():\n    """Of it.\n\n    More.\n    """\n'
            '    return """a\n\nb"""\n',
            "Python",
            4,
        ),
        ("x = (\n    1,  # one\n\n)\n", "Python", 3),
        ('class C:\n    x: int = 1\n    """of a\n    field"""\n    y: str = "z"\n', "Python", 3),
        ('/* a\n b */ int x; // c\n\nchar *s = "/* no */";\n', "C", 2),
        ("// a\nlet url = `http://b`; /* c */\n/* d\n */\n", "JavaScript", 1),
    ],
)
def test_blank_lines_comments_and_docstrings_are_not_counted(monkeypatch, text, language, lines):
    monkeypatch.syspath_prepend(str(SCRIPTS))
    assert importlib.import_module("count_lines").code_lines(text, language) == lines


def test_help_of_the_tests_installs_nothing(tmp_path):
    """It works with the bare standard library, in a copy of the folder that cannot make an environment."""
    for name in ("test.py", "_bootstrap.py"):
        (tmp_path / name).write_text((SCRIPTS / name).read_text())
    ran = subprocess.run(
        [sys.executable, "-S", str(tmp_path / "test.py"), "--help"],
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
        env=os.environ | {"PYTHONDONTWRITEBYTECODE": "1"},
    )
    assert ran.returncode == 0 and "usage: test.py" in ran.stdout
    assert {path.name for path in tmp_path.iterdir()} == {"test.py", "_bootstrap.py"}


def test_an_environment_that_cannot_be_written_is_said_in_short(tmp_path):
    """By a copy of the folder, in which there is a folder in the place of the lock."""
    (tmp_path / "scripts").mkdir()
    for name in ("_bootstrap.py", "_interfaces.py"):
        (tmp_path / "scripts" / name).write_text((SCRIPTS / name).read_text())
    (tmp_path / "requirements").mkdir()
    for name in (".venv.lock", ".venv-ros.lock"):
        (tmp_path / name).mkdir(parents=True)
    program = (
        f"import sys; sys.path.insert(0, {str(tmp_path / 'scripts')!r}); import _bootstrap; "
        "_bootstrap.ensure()"
    )
    ran = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=600, check=False
    )
    assert (
        ran.returncode == 1
        and "Traceback" not in ran.stderr
        and str(tmp_path / ".venv") in ran.stderr
    )


def test_an_environment_of_another_python_is_used_and_not_made_again(tmp_path):
    """Nodes may be running in it.

    By a copy of the folder, whose environment tells what it is asked to run.
    """
    (tmp_path / "scripts").mkdir()
    script = tmp_path / "scripts" / "run.py"
    script.write_text("import _bootstrap\n_bootstrap.ensure()\n")
    for name in ("_bootstrap.py", "_interfaces.py"):
        script.with_name(name).write_text((SCRIPTS / name).read_text())
    environment = dict(os.environ)
    environment.pop("ROS_DISTRO", None)
    python = tmp_path / ".venv" / "bin" / "python"
    python.parent.mkdir(parents=True)
    python.write_text("#!/bin/sh\necho ran $*\n")
    python.chmod(0o755)
    (tmp_path / ".venv" / "pyvenv.cfg").write_text("home = /nowhere\nversion = 3.99.1\n")
    command = [sys.executable, str(script), "argument"]
    ran = subprocess.run(
        command, capture_output=True, text=True, timeout=600, check=False, env=environment
    )
    assert (ran.returncode, ran.stdout) == (0, f"ran {script} argument\n")
    assert "Python 3.99" in ran.stderr and "delete it" in ran.stderr
    assert python.read_text().startswith("#!/bin/sh")


def test_python_of_an_environment_is_what_its_file_says_if_there_is_an_interpreter(tmp_path):
    """Whether it is made anew and whether it is used both follow from that."""
    for name, interpreter in (
        ("whole", True),
        ("without interpreter", False),
        ("without file", True),
    ):
        (tmp_path / name / "bin").mkdir(parents=True)
        if interpreter:
            (tmp_path / name / "bin" / "python").touch()
        if name != "without file":
            (tmp_path / name / "pyvenv.cfg").write_text("home = /nowhere\nversion = 3.99.1\n")
    homes = [
        str(tmp_path / name)
        for name in ("whole", "without interpreter", "without file", "nowhere")
    ]
    program = (
        f"import sys; sys.path.insert(0, {str(SCRIPTS)!r}); import _bootstrap\n"
        f"print([_bootstrap._made_with(_bootstrap.Path(home)) for home in {homes}])"
    )
    ran = subprocess.run(
        [sys.executable, "-S", "-c", program],
        capture_output=True,
        text=True,
        timeout=600,
        check=True,
    )
    assert ran.stdout == "['3.99', '', '', '']\n"


def test_output_that_nobody_reads():
    command = f"{sys.executable} {SCRIPTS / 'run_plant.py'} --help | true"
    ran = subprocess.run(
        ["bash", "-c", command], capture_output=True, text=True, timeout=600, check=False
    )
    assert ran.stderr == ""


@pytest.mark.parametrize(
    ("while_imported", "in_main", "code", "said"),
    [
        ("os.kill(os.getpid(), signal.SIGINT)", "return 0", 130, "interrupted\n"),
        ("", "os.kill(os.getpid(), signal.SIGINT)", 130, "interrupted\n"),
        ("", "return 3", 3, ""),
    ],
)
def test_ctrl_c_gives_no_traceback_not_even_while_libraries_are_loaded(
    tmp_path, while_imported, in_main, code, said
):
    text = f"import os, signal\n{while_imported}\ndef main():\n    {in_main}\n"
    (tmp_path / "command_of_test.py").write_text(text, encoding="utf-8")
    program = (
        f"import sys; sys.path[:0] = [{str(SCRIPTS)!r}, {str(tmp_path)!r}]\nimport _bootstrap; "
        "_bootstrap.ensure = lambda **_: None; _bootstrap.start('command_of_test')"
    )
    ran = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
        preexec_fn=lambda: signal.signal(
            signal.SIGINT, signal.SIG_DFL
        ),  # a background job ignores it
    )
    assert (ran.returncode, ran.stderr) == (code, said)
