"""The launcher: processes start, are watched, and end whatever happens."""

import os
import select
import signal
import subprocess
import sys
import textwrap

import pytest

from fsw_control.free_domain import free_domain
from fsw_experiment.launcher import Launcher, LaunchError

pytestmark = pytest.mark.slow

STUBBORN = """
    import signal
    def main():
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGTERM, {term})
        print("ready", flush=True)
        while True:
            signal.pause()
"""


@pytest.fixture
def modules(tmp_path, monkeypatch):
    """A folder of modules that children can import."""
    folder = tmp_path / "modules"
    folder.mkdir()
    monkeypatch.syspath_prepend(str(folder))

    def write(name, text):
        (folder / f"{name}.py").write_text(textwrap.dedent(text))

    return write


def test_arguments_environment_and_exit_code(modules, tmp_path):
    modules(
        "child_a", "import os, sys\ndef main():\n    print(sys.argv[1:], os.environ['ROS_DOMAIN_ID'])\n    return 3\n"
    )
    with Launcher(tmp_path / "log", 77) as launcher:
        child = launcher.start("a", "child_a", ["x", "y"])
        child.process.wait(20.0)
        assert child.text().strip() == "['x', 'y'] 77"
        with pytest.raises(LaunchError, match="a has ended with exit code 3"):
            launcher.check()


def test_waiting_for_text_and_for_too_long(modules, tmp_path):
    modules("child_b", STUBBORN.format(term="signal.SIG_DFL"))
    with Launcher(tmp_path, 77, patience_s=0.2) as launcher:
        child = launcher.start("b", "child_b")
        assert launcher.wait_for_text("b", r"re\w+") == "ready"
        with pytest.raises(LaunchError, match="running already"):
            launcher.start("b", "child_b")
        with pytest.raises(LaunchError, match="without success for a miracle"):
            launcher.wait_until(lambda: False, 0.1, "a miracle")
    assert not child.running
    assert child.process.returncode == -signal.SIGTERM


def test_whoever_ignores_everything_is_killed(modules, tmp_path):
    modules("child_c", STUBBORN.format(term="signal.SIG_IGN"))
    with Launcher(tmp_path, 77, patience_s=0.2) as launcher:
        child = launcher.start("c", "child_c")
        launcher.wait_for_text("c", "ready")
    assert child.process.returncode == -signal.SIGKILL


def test_an_error_in_the_context_ends_the_children(modules, tmp_path):
    modules("child_d", STUBBORN.format(term="signal.SIG_DFL"))
    with pytest.raises(RuntimeError, match="on purpose"), Launcher(tmp_path, 77, patience_s=0.2) as launcher:
        child = launcher.start("d", "child_d")
        launcher.wait_for_text("d", "ready")
        raise RuntimeError("on purpose")
    assert not child.running


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells a child that its parent has died")
def test_no_orphans_when_the_parent_is_killed(modules, tmp_path):
    modules("child_e", STUBBORN.format(term="signal.SIG_DFL"))
    script = f"""
        import sys
        sys.path[:0] = {sys.path!r}
        from pathlib import Path
        from fsw_experiment.launcher import Launcher
        with Launcher(Path({str(tmp_path)!r}), 77) as launcher:
            child = launcher.start("e", "child_e")
            launcher.wait_for_text("e", "ready")
            print(child.process.pid, flush=True)
            child.process.wait()
    """
    parent = subprocess.Popen([sys.executable, "-c", textwrap.dedent(script)], stdout=subprocess.PIPE, text=True)
    try:
        child = os.pidfd_open(int(parent.stdout.readline()))
        assert select.select([child], [], [], 0.0)[0] == [], "the child runs"
    finally:
        parent.kill()
        parent.wait()
        parent.stdout.close()
    assert select.select([child], [], [], 20.0)[0] == [child], "the child has ended"
    os.close(child)


def test_every_user_of_the_machine_gets_a_domain_of_its_own():
    with free_domain() as first, free_domain() as second:
        assert first != second
    with free_domain() as again:
        assert again not in (first, second), "who was killed lingers in his domain"
