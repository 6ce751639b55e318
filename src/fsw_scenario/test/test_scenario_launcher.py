"""The launcher: processes start, are watched, and end whatever happens."""

import signal
import subprocess
import sys
import textwrap
import time
from types import SimpleNamespace

import pytest

from fsw_control.free_domain import free_domain
from fsw_scenario import launcher as launcher_module
from fsw_scenario.launcher import REFUSED, Launcher, LaunchError, Respawn
from fsw_test_support.waiting import PATIENCE_S, has_ended, wait_for_text

pytestmark = pytest.mark.slow

STUBBORN = """
    import signal
    def ignore(*_):
        print("no", flush=True)
    def main():
        signal.signal(signal.SIGINT, ignore)
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


@pytest.fixture
def patient(monkeypatch):
    """Gives a child's launcher a clock that stands still until the child has said no to the last signal."""

    def give(child):
        sent, passed, send_signal = [], [], child.process.send_signal

        def send(number):
            sent.append(number)
            send_signal(number)

        def sleep(seconds):
            time.sleep(seconds)
            if child.text().split().count("no") == len(sent):
                passed.append(seconds)

        monkeypatch.setattr(child.process, "send_signal", send)
        clock = SimpleNamespace(monotonic=lambda: sum(passed), sleep=sleep)
        monkeypatch.setattr(launcher_module, "time", clock)

    return give


def test_a_discovery_server_is_not_used(modules, tmp_path, monkeypatch):
    """Its graph has the nodes of all domains."""
    monkeypatch.setenv("ROS_DISCOVERY_SERVER", "127.0.0.1:11811")
    modules("child_a", "import os\ndef main():\n    print('ROS_DISCOVERY_SERVER' in os.environ)\n")
    with Launcher(tmp_path / "log", 77) as launcher:
        child = launcher.start("a", "child_a")
        child.process.wait(PATIENCE_S)
        assert child.text().strip() == "False"


def test_arguments_environment_and_exit_code(modules, tmp_path):
    modules(
        "child_a",
        "import os, sys\ndef main():\n    print(sys.argv[1:], "
        "os.environ['ROS_DOMAIN_ID'])\n    return 3\n",
    )
    with Launcher(tmp_path / "log", 77) as launcher:
        child = launcher.start("a", "child_a", ["x", "y"])
        child.process.wait(PATIENCE_S)
        assert child.text().strip() == "['x', 'y'] 77"
        with pytest.raises(LaunchError, match=r"^a .* code 3\b"):
            launcher.check()


def test_status_is_that_of_the_present_run(modules, tmp_path):
    modules(
        "child_w",
        """
        import sys
        from fsw_control.schema.files import write_status
        def main():
            if len(sys.argv) > 1:
                write_status(said=1)
                write_status(url="x", number=2.5)
                print("[INFO] [1.0] [w]: hello")
                print("it broke")
            return 3
        """,
    )
    with Launcher(tmp_path, 77) as launcher:
        first = launcher.start("w", "child_w", ["tell"])
        assert first.process.wait() == 3
        assert (first.status(), first.last_lines()) == ({"url": "x", "number": 2.5}, "it broke")
        again = launcher.start("w", "child_w")
        again.process.wait()
        assert (again.status(), again.last_lines()) == ({}, "it printed nothing")


def test_wait_ends_at_its_condition_or_times_out(modules, tmp_path, patient):
    modules("child_b", STUBBORN.format(term="signal.SIG_DFL"))
    with Launcher(tmp_path, 77, patience_s=0.2) as launcher:
        child = launcher.start("b", "child_b")
        assert wait_for_text(launcher, "b", r"re\w+") == "ready"
        with pytest.raises(LaunchError, match="running already"):
            launcher.start("b", "child_b")
        with pytest.raises(LaunchError, match="a miracle"):
            launcher.wait_until(lambda: False, 0.1, "a miracle")
        patient(child)
    assert not child.running
    assert child.process.returncode == -signal.SIGTERM


def test_process_that_ignores_signals_is_killed(modules, tmp_path, patient):
    modules("child_c", STUBBORN.format(term="ignore"))
    with Launcher(tmp_path, 77, patience_s=0.2) as launcher:
        child = launcher.start("c", "child_c")
        wait_for_text(launcher, "c", "ready")
        patient(child)
    assert child.process.returncode == -signal.SIGKILL
    assert child.text().split() == ["ready", "no", "no"]


def test_an_error_in_the_context_ends_the_children(modules, tmp_path):
    modules("child_d", STUBBORN.format(term="signal.SIG_DFL"))
    with (
        pytest.raises(RuntimeError, match="on purpose"),
        Launcher(tmp_path, 77, patience_s=0.2) as launcher,
    ):
        child = launcher.start("d", "child_d")
        wait_for_text(launcher, "d", "ready")
        raise RuntimeError("on purpose")
    assert not child.running


class Kept:
    """Processes that are started again, and a clock by hand."""

    def __init__(self, launcher, *names):
        self.launcher, self.now_s, self.told = launcher, 1000.0, []
        self.respawn = Respawn(launcher, names, self.told.append, lambda: self.now_s)

    def child(self, name):
        return self.launcher.children[name]

    def ends(self, name):
        """Wait for its end; returns the process that comes in its place once the pause is over."""
        ended = self.child(name)
        ended.process.wait(PATIENCE_S)
        self.respawn.update()
        assert self.child(name) is ended
        self.now_s += 9.0
        self.respawn.update()
        return self.child(name)


@pytest.mark.requirement("S34")
def test_killed_process_is_reported_and_restarted(modules, tmp_path):
    modules("child_f", STUBBORN.format(term="signal.SIG_DFL"))
    with Launcher(tmp_path, 77, patience_s=0.2) as launcher:
        first, other = [launcher.start(name, "child_f") for name in ("f", "g")]
        wait_for_text(launcher, "f", "ready")
        kept = Kept(launcher, "f", "g")
        first.process.kill()
        again = kept.ends("f")
        launcher.wait_until(
            lambda: again.log.read_text().count("ready") == 2,
            PATIENCE_S,
            "the second start in the same log",
        )
        assert (again.running, other.running, launcher.children["g"]) == (True, True, other)
        assert len(kept.told) == 1
        assert "exit code -9" in kept.told[0]
        kept.respawn.update()
        assert launcher.children["f"] is again


def test_repeated_early_ends_stop_the_restarts(modules, tmp_path):
    modules("child_h", "def main():\n    return 1\n")
    with Launcher(tmp_path, 77) as launcher:
        launcher.start("h", "child_h")
        kept = Kept(launcher, "h")
        starts = [kept.ends("h") for _ in range(6)]
        assert len(set(map(id, starts))) == 5  # the sixth end was the last
        assert "given up" in kept.told[-1]
        assert len(kept.told) == 6


def test_late_ends_are_always_restarted(modules, tmp_path):
    modules("child_i", f"def main():\n    return {REFUSED}\n")
    with Launcher(tmp_path, 77) as launcher:
        launcher.start("i", "child_i").process.wait()
        kept = Kept(launcher, "i")
        with pytest.raises(LaunchError, match=f"exit code {REFUSED}"):
            kept.respawn.update()  # its first start
    modules(
        "child_j",
        f"import os\ndef main():\n    return {REFUSED} if os.path.exists('{tmp_path}/j') else 1\n",
    )
    with Launcher(tmp_path, 77) as launcher:
        launcher.start("j", "child_j").process.wait()
        kept = Kept(launcher, "j")
        (tmp_path / "j").touch()
        for _ in range(8):
            before = kept.child("j")
            kept.now_s += 11.0
            assert kept.ends("j") is not before


@pytest.mark.skipif(
    sys.platform != "linux", reason="only Linux tells a child that its parent has died"
)
def test_no_orphans_when_the_parent_is_killed(modules, tmp_path):
    modules("child_e", STUBBORN.format(term="signal.SIG_DFL"))
    script = f"""
        import sys
        sys.path[:0] = {sys.path!r}
        from pathlib import Path
        from fsw_scenario.launcher import Launcher
        from fsw_test_support.waiting import wait_for_text
        with Launcher(Path({str(tmp_path)!r}), 77) as launcher:
            child = launcher.start("e", "child_e")
            wait_for_text(launcher, "e", "ready")
            print(child.process.pid, flush=True)
            child.process.wait()
    """
    parent = subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(script)], stdout=subprocess.PIPE, text=True
    )
    try:
        child = int(parent.stdout.readline())
        assert not has_ended(child, 0.0), "the child runs"
    finally:
        parent.kill()
        parent.wait()
        parent.stdout.close()
    assert has_ended(child), "the child has ended"


def test_free_domains_are_distinct_and_not_reused():
    with free_domain() as first, free_domain() as second:
        assert first != second
    with free_domain() as again:
        assert again not in (first, second), "who was killed lingers in his domain"
