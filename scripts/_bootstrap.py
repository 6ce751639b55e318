"""Sets up the environment of every script here, with nothing but the standard library.

``ensure()`` makes ``.venv`` in the workspace, installs the pinned locks into it (wheels only) and
continues inside it. ROS 2 comes as wheels, too, and this project's messages are built for it
(``_interfaces.py``). Where there is no C compiler for the controllers, or no npm for the page, one
is installed as a wheel. When all is done already it only takes the few milliseconds of a new
interpreter. In a shell where ROS 2 is sourced, a second environment (``.venv-ros``) sees the
system's packages, and that ROS 2 is used.
"""

import os
import signal


def _end(*_):
    os.write(2, b"interrupted\n")
    os._exit(130)


# Ctrl-C while libraries are still being loaded must not be an exception, for it could come out of
# any of them, with a traceback or as another one. What ignores it, as a background job does, goes
# on ignoring it.
INTERRUPTIBLE = signal.getsignal(signal.SIGINT) is signal.default_int_handler
if INTERRUPTIBLE:
    signal.signal(signal.SIGINT, _end)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})  # of one that came before

import contextlib
import fcntl
import hashlib
import importlib
import itertools
import platform
import re
import shutil
import subprocess
import sys
import venv
from pathlib import Path

WORKSPACE = Path(__file__).resolve().parent.parent
SOURCES = WORKSPACE / "src"
#: folders of the distributions: core, quality, lab; the core works without the others
DISTRIBUTIONS = tuple(
    folder for name in ("src", "quality", "lab") if (folder := WORKSPACE / name).is_dir()
)
#: further folders that the environment imports from
SEARCHED = (WORKSPACE / "lab" / "studies", WORKSPACE / "test" / "support")
#: interface packages that the wheels of ROS 2 lack
INTERFACES = (SOURCES / "fsw_msgs", SOURCES / "fsw_recorder" / "interfaces" / "rosbag2_interfaces")
OLDEST = (3, 11)
DEFINITIONS = (".msg", ".srv", ".action")
#: lock of the wheels of ROS 2
ROS = "ros"
#: lock of the page's server
PAGE = "hmi"
#: pure Python, for which its authors offer no wheel
SOURCE_ONLY = "empy"
#: first and last Python that there are wheels of ROS 2 for, and the oldest glibc
ROS_PYTHONS = ((3, 10), (3, 14))
ROS_GLIBC = (2, 28)
# This folder is searched last, because fsw.py and others here are named as packages are.
_HERE = Path(__file__).resolve().parent
sys.path[:] = [*(path for path in sys.path if Path(path).resolve() != _HERE), str(_HERE)]
#: set by the wheels of ROS 2 when they have set LD_LIBRARY_PATH, for which they start the
#: interpreter again
WHEELS_READY = "_ROS_WHEELS_BOOTSTRAP_COMPLETE"
# with a sourced ROS 2 this comes from it: its message packages are compiled against its numpy
FROM_ROS = ("numpy",)
#: extras that the tests need; those of the second line are not there in the oldest supported
#: versions
TEST_EXTRAS = ("fmu", "machine", "hmi", "canister", "signing", "pdf", "completion")
NEWER_TEST_EXTRAS = ("campaign", "build", "science", "gym")


def with_sourced_ros():
    """Whether a ROS 2 is sourced in this shell."""
    return bool(os.environ.get("ROS_DISTRO") and os.environ.get("AMENT_PREFIX_PATH"))


def why_no_middleware():
    """Why neither a ROS 2 is sourced nor its wheels can be used here, and the remedy.

    Empty if one of them can.

    Without it welds run in one process.
    """
    import _interfaces  # from this folder, which is in the search path now

    if with_sourced_ros():
        return ""
    libc, version = platform.libc_ver()
    old = libc != "glibc" or tuple(map(int, version.split(".")[:2])) < ROS_GLIBC
    if (sys.platform, platform.machine()) != ("linux", "x86_64") or old:
        return (
            "the wheels of ROS 2 are for Linux on x86-64 with glibc "
            f"{ROS_GLIBC[0]}.{ROS_GLIBC[1]}: source a ROS 2"
        )
    if not ROS_PYTHONS[0] <= sys.version_info[:2] <= ROS_PYTHONS[1]:
        first, last = map(_words, (max(OLDEST, ROS_PYTHONS[0]), ROS_PYTHONS[1]))
        return (
            f"the wheels of ROS 2 are for Python {first} to {last}: use one of "
            "these, or source a ROS 2"
        )
    missing = {}
    if _interfaces.compiler() is None:
        missing["g++"] = "a C++ compiler"
    if not (_interfaces.python_headers() / "Python.h").exists():
        missing[f"python{_minor(sys.version)}-dev"] = "Python's headers"
    needs = f"{' and '.join(missing.values())} (Debian, Ubuntu: apt install {' '.join(missing)})"
    return f"it needs {needs}" if missing else ""


def ensure(dev=False, oldest=False, extras=()):
    """Go on inside the project's environment, made first if need be.

    Parameters
    ----------
    dev : bool
        Install the tools of the tests as well.
    oldest : bool
        Take an environment of its own (``.venv-oldest``) with the oldest supported versions, for
        tests.
    extras : sequence of str
        Lock files without their suffix of what only some commands need.

    Raises
    ------
    SystemExit
        With one clear line, if Python is too old or the packages cannot be installed.
    """
    prefer_a_python_of_the_wheels()
    if sys.version_info < OLDEST:
        sys.exit(
            f"needs Python {_words(OLDEST)} or newer, this is {sys.version.split()[0]} "
            f"({sys.executable})"
        )
    home = WORKSPACE / (
        ".venv-oldest" if oldest else ".venv-ros" if with_sourced_ros() else ".venv"
    )
    names = ("oldest.lock",) if oldest else ("runtime.lock", *(("dev.lock",) if dev else ()))
    reason = why_no_middleware()
    if not with_sourced_ros() and not reason:
        names = (names[0], f"{ROS}.lock", *names[1:])
    names = (*names, *(f"{extra}.lock" for extra in extras))
    if not os.environ.get("CC") and not any(map(shutil.which, ("cc", "gcc", "clang"))):
        names = (*names, "compiler.lock")
    if "hmi" in extras and not shutil.which("npm"):  # gets what draws the trends of the page
        names = (*names, "node.lock")
    locks = [WORKSPACE / "requirements" / name for name in names]
    inside = Path(sys.prefix).resolve() == home.resolve()
    made_with = _made_with(home)
    if not inside and made_with not in ("", _minor(sys.version)):
        # nodes may be running in it
        print(
            f"[set-up] {home.name} is of Python {made_with}; "
            f"delete it to use {_minor(sys.version)}",
            file=sys.stderr,
        )
        _go_on(home)
    stale = inside and not _is_from_source(
        home
    )  # a folder to import from is missing in this process
    if not _is_ready(home, locks):
        try:
            with open(home.with_suffix(".lock"), "w") as turn:
                _wait_for(turn)  # several nodes may be started at once on a fresh machine
                if not _is_ready(home, locks):
                    if reason:
                        print(
                            f"[set-up] no ROS 2: {reason}; welds run in one process",
                            file=sys.stderr,
                        )
                    _make(home, locks, turn)
        except (OSError, subprocess.CalledProcessError) as error:
            advice = "[set-up] run this once as a user who may write there"
            sys.exit(f"[set-up] cannot write {home} ({', '.join(names)}): {error}\n{advice}")
    prefixes = os.environ["AMENT_PREFIX_PATH"].split(os.pathsep) if with_sourced_ros() else []
    if prefixes and not any((Path(prefix) / "share" / "fsw_msgs").is_dir() for prefix in prefixes):
        print(
            "fsw_msgs is not built: run 'colcon build' and source 'install/setup.bash'",
            file=sys.stderr,
        )
    if not inside or stale:
        _go_on(home)
    _on_interrupt(signal.default_int_handler)


def prefer_a_python_of_the_wheels():
    """Run this script again by a Python that the wheels of ROS 2 fit, if this one is another."""
    first, last = max(OLDEST, ROS_PYTHONS[0]), ROS_PYTHONS[1]
    if with_sourced_ros() or first <= sys.version_info[:2] <= last:
        return
    for minor in range(last[1], first[1] - 1, -1):
        python = shutil.which(f"python3.{minor}")
        if python:
            print(
                f"[set-up] Python {_minor(sys.version)} has no wheels of ROS 2: using {python}",
                file=sys.stderr,
            )
            _run_again(python)


def _go_on(home):
    """Run this script again, by the interpreter of an environment."""
    _run_again(str(_python(home)))


def _run_again(python):
    os.environ.pop(WHEELS_READY, None)  # of another environment
    if INTERRUPTIBLE:  # it waits until the next interpreter is here
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    os.execv(python, [python, *sys.argv])


def _on_interrupt(handler):
    if INTERRUPTIBLE:
        signal.signal(signal.SIGINT, handler)


def start(program, extras=()):
    """Continue in the project's environment; exit with the result of a node or a ``main``.

    What commands and nodes need of extras is installed when they ask for it
    (``fsw_control.schema.extensions``).
    """
    try:
        ensure(extras=extras)
        _on_interrupt(_end)
        with contextlib.suppress(ImportError):
            importlib.import_module("fsw_control.schema.extensions").install = lambda extra: (
                ensure(extras=(extra,))
            )
        path = f"{program}.main"
        if "." not in program:
            path = importlib.import_module("fsw_control.schema.extensions").program_path(program)
        module, _, function = path.rpartition(".")
        main = getattr(importlib.import_module(module), function)
        _on_interrupt(signal.default_int_handler)
        code = main()
        if sys.stdout is not None:  # closed by the parent process
            sys.stdout.flush()
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        code = 130
    except BrokenPipeError:
        # whoever read our output has seen enough; nothing is left to be flushed at exit
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = 1
    sys.exit(code)


def _python(home):
    return home / "bin" / "python"


def _minor(version):
    return ".".join(version.split(".")[:2])


def _words(version):
    return ".".join(map(str, version))


def _made_with(home):
    """Python's version, as in "3.11", of an environment that can be used; else nothing."""
    try:
        lines = (home / "pyvenv.cfg").read_text().splitlines() if _python(home).exists() else []
    except OSError:
        return ""
    return next(
        (_minor(line.split("=")[1].strip()) for line in lines if line.startswith("version =")), ""
    )


def _stamp(lock):
    """What must be equal for an installed lock to be still right."""
    parts = [f"{sys.version_info[:2]}\n" + "\n".join(_packages(lock))]
    if lock.stem == ROS:
        sources = [
            path
            for folder in INTERFACES
            for path in folder.glob("*/*")
            if path.suffix in DEFINITIONS
        ]
        sources.append(_HERE / "_interfaces.py")
        parts += [path.read_text() for path in sorted(sources)]
    if lock.stem == PAGE:
        parts.append((SOURCES / "fsw_hmi" / "fsw_hmi" / "package-lock.json").read_text())
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()


def _installed_from_source(home):
    """Files, by path, by which the environment knows the source folders and their entry points.

    A .pth file, and for each distribution what an editable installation by pip leaves of its
    pyproject.toml.
    """
    import tomllib  # older Pythons, which are refused, lack it

    lines = sorted(
        str(path.parent) for folder in DISTRIBUTIONS for path in folder.glob("*/package.xml")
    )
    lines += [str(folder) for folder in SEARCHED if folder.is_dir()]
    [site] = (home / "lib").glob("python3*/site-packages")
    files = {site / "fsw_workspace.pth": "".join(f"{line}\n" for line in lines)}
    source = (SOURCES / "fsw" / "fsw" / "__init__.py").read_text()
    version = re.search(r'^__version__ = "(.*)"', source, re.MULTILINE)[1]
    for folder in DISTRIBUTIONS:
        file = (WORKSPACE if folder == SOURCES else folder) / "pyproject.toml"
        project = tomllib.loads(file.read_text())["project"]
        info = site / f"{project['name'].replace('-', '_')}-{version}.dist-info"
        groups = {"console_scripts": project.get("scripts", {}), **project["entry-points"]}
        files[info / "METADATA"] = (
            f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {version}\n"
            + "".join(_extras(project.get("optional-dependencies", {})))
        )
        files[info / "entry_points.txt"] = "".join(
            f"[{group}]\n" + "".join(f"{name} = {value}\n" for name, value in points.items())
            for group, points in groups.items()
        )
    return files


def _extras(extras):
    """Lines by which pip knows the extras, so that the line that installs one is the same here."""
    for name, requirements in extras.items():
        yield f"Provides-Extra: {name}\n"
        for requirement in requirements:
            yield f'Requires-Dist: {requirement}; extra == "{name}"\n'


def _is_from_source(home):
    try:
        return all(path.read_text() == text for path, text in _installed_from_source(home).items())
    except (OSError, ValueError):
        return False


def _install_from_source(home):
    """Write files that are missing or differ, and remove distributions that are gone."""
    files = _installed_from_source(home)
    kept = {path.parent for path in files}
    for name in ("control", "quality", "lab"):
        for old in (
            set((home / "lib").glob(f"python3*/site-packages/fsw_{name}-*.dist-info")) - kept
        ):
            shutil.rmtree(old)
    for path, text in files.items():
        path.parent.mkdir(exist_ok=True)
        scratch = path.with_name(
            f"{path.name}.{os.getpid()}"
        )  # whole at once: nodes may be starting
        scratch.write_text(text)
        scratch.replace(path)


def _is_ready(home, locks):
    return _has_installed(home, locks) and _is_from_source(home)


def _has_installed(home, locks):
    marks = [home / f"{lock.stem}.installed" for lock in locks]
    try:
        return _python(home).exists() and all(
            m.read_text() == _stamp(lk) for m, lk in zip(marks, locks, strict=False)
        )
    except OSError:
        return False


def _wait_for(turn):
    """Lock a file, and say so if another script has it."""
    try:
        fcntl.flock(turn, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        print("[set-up] waiting for another script's set-up", file=sys.stderr, flush=True)
        fcntl.flock(turn, fcntl.LOCK_EX)


def _make(home, locks, turn):
    # Every child holds the lock, too: one that outlives an interrupted script still writes to
    # home. One without a lock installed may have been interrupted before pip was there.
    if _made_with(home) != _minor(sys.version) or not any(home.glob("*.installed")):
        print(
            f"[set-up] making {home.name} with Python {sys.version.split()[0]}",
            file=sys.stderr,
            flush=True,
        )
        try:
            venv.EnvBuilder(clear=True, system_site_packages=with_sourced_ros()).create(home)
            subprocess.run(
                [_python(home), "-Im", "ensurepip", "--upgrade", "--default-pip"],
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                check=True,
                pass_fds=[turn.fileno()],
            )
        except subprocess.CalledProcessError as error:
            sys.exit(
                f"{error.stdout}[set-up] cannot make {home}\n"
                "[set-up] on Debian or Ubuntu: apt install python3-venv"
            )
    # those before the first one that is new are as they were; those after it may have other
    # versions of its packages
    old = len(list(itertools.takewhile(lambda lock: _has_installed(home, [lock]), locks)))
    for lock in locks[old:]:
        names = _packages(lock)
        print(
            f"[set-up] installing {len(names)} packages of {lock.name} (once)",
            file=sys.stderr,
            flush=True,
        )
        pip = [
            str(_python(home)),
            "-m",
            "pip",
            "--disable-pip-version-check",
            "install",
            "--only-binary",
            ":all:",
        ]
        _run_with_progress([*pip, "--no-binary", SOURCE_ONLY, *names], lock.name, turn)
        if lock.stem not in (ROS, PAGE):  # more than packages is still to be got
            _mark(home, lock)
    _install_from_source(home)
    if any(lock.stem == ROS for lock in locks[old:]):
        _build_interfaces(
            home, turn
        )  # where it fails welds run in one process: the next start does not try again
    if any(lock.stem == PAGE for lock in locks[old:]):  # it, too, does not try again
        subprocess.run(
            [_python(home), SOURCES / "fsw_hmi" / "npm_packages.py"], pass_fds=[turn.fileno()]
        )
    for lock in locks[old:]:
        _mark(home, lock)


def _mark(home, lock):
    (home / f"{lock.stem}.installed").write_text(_stamp(lock))


def _build_interfaces(home, turn):
    """Build the messages that the wheels of ROS 2 lack, all packages at once."""
    print(
        f"[set-up] building {len(INTERFACES)} message packages (once)",
        file=sys.stderr,
        end="",
        flush=True,
    )
    environment = {name: value for name, value in os.environ.items() if name != WHEELS_READY}
    command = [str(_python(home)), str(_HERE / "_interfaces.py")]
    running = [
        subprocess.Popen(
            [*command, str(folder)],
            stdout=sys.stderr,
            stderr=subprocess.PIPE,
            text=True,
            env=environment,
            pass_fds=[turn.fileno()],
        )
        for folder in INTERFACES
    ]
    failed = [process.communicate()[1] for process in running]
    print("", file=sys.stderr)
    if any(process.returncode for process in running):
        again = home / f"{ROS}.installed"
        print(
            "".join(failed) + "[set-up] could not build the messages: welds run in one process; "
            f"mend the compiler, then delete {again} to try again",
            file=sys.stderr,
        )


def _packages(lock):
    lines = [line.strip() for line in lock.read_text().splitlines()]
    skipped = FROM_ROS if with_sourced_ros() else ()
    return [
        line
        for line in lines
        if line and not line.startswith("#") and line.split("==")[0] not in skipped
    ]


def _run_with_progress(command, what, turn):
    """Run pip, a dot per package, and show its words only when it fails."""
    lines = []
    with subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        pass_fds=[turn.fileno()],
    ) as process:
        for line in process.stdout or ():
            lines.append(line)
            if line.startswith(("Collecting", "Installing")):
                print(".", end="", file=sys.stderr, flush=True)
    print("", file=sys.stderr)
    if process.returncode:
        tail = "".join(lines[-15:])
        sys.exit(
            f"{tail}[set-up] could not install {what}; "
            "a package index must be reachable the first time"
        )
