"""The set-up of the environment.

Which Python, whether ROS 2 can be had, and building messages for it.
"""

import fcntl
import os
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPTS = Path(__file__).resolve().parents[1] / "scripts"
BEGIN = f"import sys; sys.path.insert(0, {str(SCRIPTS)!r}); import _bootstrap, _interfaces\n"


def in_python(program, *arguments, **environment):
    """Run a program that has imported ``_bootstrap``, outside of any sourced ROS 2.

    Returns its output.
    """
    kept = {
        name: value
        for name, value in os.environ.items()
        if name not in ("ROS_DISTRO", "AMENT_PREFIX_PATH")
    }
    command = [sys.executable, "-c", BEGIN + program, *map(str, arguments)]
    return subprocess.run(
        command, capture_output=True, text=True, timeout=600, check=False, env=kept | environment
    )


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ("", ""),
        ("sys.platform = 'darwin'", "for Linux on x86-64 with glibc 2.28: source a ROS 2"),
        ("_bootstrap.platform.machine = lambda: 'aarch64'", "for Linux on x86-64"),
        ("_bootstrap.platform.libc_ver = lambda: ('glibc', '2.17')", "for Linux on x86-64"),
        ("_bootstrap.platform.libc_ver = lambda: ('', '')", "for Linux on x86-64"),
        (
            "sys.version_info = (3, 15, 0)",
            "for Python 3.11 to 3.14: use one of these, or source a ROS 2",
        ),
        (
            "_interfaces.compiler = lambda: None",
            "a C++ compiler (Debian, Ubuntu: apt install g++)",
        ),
        (
            "_interfaces.python_headers = lambda: _bootstrap.Path('/none')",
            "headers (Debian, Ubuntu: apt install",
        ),
        (
            "import os; os.environ |= {'ROS_DISTRO': 'jazzy', 'AMENT_PREFIX_PATH': '/opt'}; "
            "sys.platform = 'any'",
            "",
        ),
    ],
)
def test_reason_why_there_is_no_middleware(change, reason):
    ran = in_python(f"{change}\nprint(_bootstrap.why_no_middleware())")
    assert reason in ran.stdout and bool(reason) is bool(ran.stdout.strip()), ran.stderr


def test_a_python_with_wheels_is_found_on_the_search_path(tmp_path):
    """The newest; the script and its arguments are the same."""
    for minor in (9, 12, 13, 15):
        python = tmp_path / f"python3.{minor}"
        python.write_text(f"#!/bin/sh\necho 3.{minor} $*\n")
        python.chmod(0o755)
    program = "sys.version_info, sys.version = (3, 15, 0), '3.15.0'\n_bootstrap.ensure()"
    ran = in_python(program, "an argument", PATH=str(tmp_path))
    assert (ran.returncode, ran.stdout) == (0, "3.13 -c an argument\n")
    assert "Python 3.15" in ran.stderr and f"using {tmp_path / 'python3.13'}" in ran.stderr
    ran = in_python("sys.version_info = (3, 9, 0)\n_bootstrap.ensure()", PATH="/nowhere")
    assert ran.returncode == 1 and "Python 3.11" in ran.stderr


def test_an_environment_whose_making_was_interrupted_is_made_again(tmp_path):
    """It has an interpreter, but no pip."""
    home = tmp_path / ".venv"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", home], check=True)
    program = """
_bootstrap._run_with_progress = lambda command, what, turn: None
_bootstrap._install_from_source = lambda home: None
locks = [_bootstrap.WORKSPACE / "requirements" / "runtime.lock"]
with open(sys.argv[1] + ".lock", "w") as turn:
    _bootstrap._make(_bootstrap.Path(sys.argv[1]), locks, turn)
"""
    ran = in_python(program, home)
    assert ran.returncode == 0, ran.stderr
    subprocess.run([home / "bin" / "python", "-m", "pip", "--version"], check=True)
    kept = home / "kept"
    kept.touch()
    assert in_python(program, home).returncode == 0 and kept.exists()


def test_who_waits_for_another_set_up_says_so(tmp_path):
    program = """
with open(sys.argv[1], "w") as turn:
    _bootstrap._wait_for(turn)
"""
    lock = tmp_path / "set-up.lock"
    assert "waiting" not in in_python(program, lock).stderr
    with lock.open("w") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        waiting = subprocess.Popen(
            [sys.executable, "-c", BEGIN + program, str(lock)], stderr=subprocess.PIPE, text=True
        )
        assert "waiting" in waiting.stderr.readline()
    with waiting:
        assert waiting.wait(600) == 0


def test_what_an_interrupted_set_up_left_running_keeps_the_lock(tmp_path):
    """It writes into the environment that the next script would make again."""
    program = """
with open(sys.argv[1], "w") as turn:
    _bootstrap._wait_for(turn)
    _bootstrap._run_with_progress(["sh", "-c", "echo Installing; read line"], "", turn)
"""
    command = [sys.executable, "-c", BEGIN + program, str(tmp_path / "lock")]
    pipes = {"stdin": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with (tmp_path / "lock").open("w") as lock, subprocess.Popen(command, **pipes) as script:
        assert script.stderr.read(1) == "."
        script.kill()
        script.wait(600)
        with pytest.raises(BlockingIOError):
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        script.stdin.close()
        fcntl.flock(lock, fcntl.LOCK_EX)


def test_pip_knows_the_extras_of_a_clone():
    program = """
for file, text in _bootstrap._installed_from_source(_bootstrap.Path(sys.prefix)).items():
    print(text if file.match("fsw_lab-*/METADATA") else "")
"""
    lines = in_python(program).stdout.splitlines()
    assert "Provides-Extra: gym" in lines
    assert 'Requires-Dist: fsw-lab[campaign,canister,fmu,gym]; extra == "all"' in lines


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Prefix with an interface package of all kinds, built from three definitions."""
    folder = tmp_path_factory.mktemp("interfaces")
    package = folder / "small_msgs"
    for name, text in {
        "msg/Reading.msg": "std_msgs/Header header\nfloat64[] values\nstring unit",
        "srv/Ask.srv": "string question\n---\nReading answer",
        "action/Weld.action": "float64 angle\n---\nbool done\n---\nfloat64 share",
    }.items():
        (package / name).parent.mkdir(parents=True)
        (package / name).write_text(text.replace("Reading answer", "small_msgs/Reading answer"))
    command = [
        sys.executable,
        str(SCRIPTS / "_interfaces.py"),
        "--prefix",
        str(folder / "prefix"),
        str(package),
    ]
    ran = subprocess.run(command, capture_output=True, text=True, timeout=600, check=False)
    assert ran.returncode == 0, ran.stderr
    return folder / "prefix"


def test_built_messages_travel(built):
    """Also in services and actions, which use the same type support."""
    (site,) = built.glob("lib/python3*/site-packages")
    program = f"""
sys.path.insert(0, {str(site)!r})
from rclpy.serialization import deserialize_message, serialize_message
from small_msgs.action import Weld
from small_msgs.msg import Reading
from small_msgs.srv import Ask
sent = Reading(values=[1.5, -2.0], unit="mm")
sent.header.frame_id = "tool"
assert deserialize_message(serialize_message(sent), Reading) == sent
answer = Ask.Response(answer=sent)
assert deserialize_message(serialize_message(answer), Ask.Response) == answer
assert deserialize_message(serialize_message(Weld.Feedback(share=0.5)), Weld.Feedback).share == 0.5
"""
    libraries = os.pathsep.join([str(built / "lib"), os.environ.get("LD_LIBRARY_PATH", "")])
    ran = in_python(program, LD_LIBRARY_PATH=libraries)
    assert ran.returncode == 0, ran.stderr


def test_built_package_is_laid_out_as_by_colcon(built):
    share = built / "share"
    assert (share / "small_msgs" / "msg" / "Reading.msg").exists()
    assert (share / "small_msgs" / "msg" / "Reading.idl").exists()
    index = share / "ament_index" / "resource_index"
    assert (index / "packages" / "small_msgs").exists()
    assert "msg/Reading.msg" in (index / "rosidl_interfaces" / "small_msgs").read_text().split()


def test_a_folder_without_definitions_is_one_error_and_nothing_is_installed(tmp_path):
    (tmp_path / "empty_msgs" / "msg").mkdir(parents=True)
    for name in ("no_such_msgs", "empty_msgs"):
        folder, prefix = tmp_path / name, tmp_path / "prefix"
        script = str(SCRIPTS / "_interfaces.py")
        command = [sys.executable, script, "--prefix", str(prefix), str(folder)]
        ran = subprocess.run(command, capture_output=True, text=True, timeout=600, check=False)
        assert (ran.returncode, ran.stdout, ran.stderr.count("\n")) == (1, "", 1)
        assert str(folder) in ran.stderr and not prefix.exists()


def test_a_definition_that_is_wrong_is_one_error(tmp_path):
    (tmp_path / "bad_msgs" / "msg").mkdir(parents=True)
    (tmp_path / "bad_msgs" / "msg" / "Bad.msg").write_text("float64 lower lower")
    command = [
        sys.executable,
        str(SCRIPTS / "_interfaces.py"),
        "--prefix",
        str(tmp_path),
        str(tmp_path / "bad_msgs"),
    ]
    ran = subprocess.run(command, capture_output=True, text=True, timeout=600, check=False)
    assert ran.returncode == 1 and "bad_msgs" in ran.stderr and "Traceback" not in ran.stderr


def test_a_compiler_that_fails_is_one_error(tmp_path):
    (tmp_path / "small_msgs" / "msg").mkdir(parents=True)
    (tmp_path / "small_msgs" / "msg" / "Empty.msg").write_text("")
    command = [
        sys.executable,
        str(SCRIPTS / "_interfaces.py"),
        "--prefix",
        str(tmp_path / "prefix"),
    ]
    command.append(str(tmp_path / "small_msgs"))
    ran = subprocess.run(
        command,
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
        env=os.environ | {"CXX": "false"},
    )
    assert ran.returncode == 1 and "false" in ran.stderr and "Traceback" not in ran.stderr
    assert not (tmp_path / "prefix").exists()


def test_messages_that_cannot_be_built_do_not_end_the_set_up(tmp_path):
    (tmp_path / "small_msgs" / "msg").mkdir(parents=True)
    (tmp_path / "small_msgs" / "msg" / "Empty.msg").write_text("")
    ran = in_python(
        "_bootstrap._python = lambda home: sys.executable\n"
        "_bootstrap.INTERFACES = [_bootstrap.Path(sys.argv[1]) / 'small_msgs']\n"
        "_bootstrap._build_interfaces(_bootstrap.Path(sys.argv[1]), open('/dev/null'))",
        tmp_path,
        CXX="false",
    )
    assert ran.returncode == 0 and str(tmp_path / "ros.installed") in ran.stderr
