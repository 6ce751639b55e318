"""The core without the other distributions.

README's demo and the core's fast tests, in a copy that lacks them.

The copy has the files that git knows or would add, and an environment of its own: hard links to
that of this clone, but for what makes it import from here.
"""

import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

from _bootstrap import WHEELS_READY, WORKSPACE

PLACE = WORKSPACE / "out" / "core"
OTHERS = ("quality", "lab")
#: of the environment: what is installed from source, which the copy writes itself
OWN = ("fsw_workspace.pth", "fsw_*.dist-info")
DEMO = ["scripts/demo.py"]  #: as README has it
TESTS = ["-n", "2", "--dist", "loadfile", "-m", "core", "src"]


def _copy_tree() -> None:
    listed = subprocess.run(
        ["git", "ls-files", "-z", "-co", "--exclude-standard"],
        cwd=WORKSPACE,
        stdout=subprocess.PIPE,
        check=True,
    )
    for name in listed.stdout.decode().split("\0"):
        if name and name.partition("/")[0] not in OTHERS and (WORKSPACE / name).is_file():
            (PLACE / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(WORKSPACE / name, PLACE / name)
    uplot = Path("src", "fsw_hmi", "fsw_hmi", "page", "uplot")  # which git does not know
    if (WORKSPACE / uplot).is_dir():
        shutil.copytree(WORKSPACE / uplot, PLACE / uplot)


def _copy_environment(home: Path) -> Path:
    """Interpreter of the copy's environment."""
    copy = PLACE / home.name
    shutil.copytree(
        home, copy, symlinks=True, copy_function=os.link, ignore=shutil.ignore_patterns(*OWN)
    )
    return copy / "bin" / "python"


def check(options: list[str]) -> int:
    """Run them, pytest with options; the exit code is the first that is not 0."""
    began = time.monotonic()
    print(f"== the core alone, in {PLACE}", flush=True)
    shutil.rmtree(PLACE, ignore_errors=True)
    PLACE.mkdir(parents=True)
    _copy_tree()
    python = _copy_environment(Path(sys.prefix))
    environment = {
        name: value
        for name, value in os.environ.items()
        if name not in (WHEELS_READY, "LD_LIBRARY_PATH")
    }
    for words in (
        DEMO,
        ["-m", "pytest", *TESTS, *options],
    ):
        print(f"== {' '.join(words)}, {time.monotonic() - began:.0f} s", flush=True)
        code = subprocess.run([str(python), *words], cwd=PLACE, env=environment).returncode
        if code:
            return code
    print(f"== the core alone: {time.monotonic() - began:.0f} s", flush=True)
    shutil.rmtree(PLACE)
    return 0
