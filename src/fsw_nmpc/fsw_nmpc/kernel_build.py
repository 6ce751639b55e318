"""Builds the C kernel into a shared library beside its sources, when a C compiler is there.

Run ``python -m fsw_nmpc.kernel_build``; without a compiler the controller uses its CasADi solver instead.
"""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from pathlib import Path

SOURCES = ("solve.c", "predict.c", "torque.c")
FOLDER = Path(__file__).parent / "kernel"
LIBRARY = FOLDER / f"libfsw_nmpc.{sysconfig.get_platform()}.so"
FLAGS = ("-std=c99", "-O3", "-fPIC", "-shared", "-ffp-contract=off", "-Wall", "-Wextra", "-Wno-unused-parameter")


def compiler() -> list[str] | None:
    """Command of the C compiler (``CC`` or the first of cc, gcc, clang), None if there is none."""
    wanted = shlex.split(os.environ.get("CC", ""))
    for command in [wanted, ["cc"], ["gcc"], ["clang"]]:
        if command and shutil.which(command[0]):
            return command
    return None


def is_current(library: Path = LIBRARY) -> bool:
    """Whether the library is there and not older than its sources."""
    if not library.exists():
        return False
    return all(library.stat().st_mtime >= path.stat().st_mtime for path in FOLDER.glob("*.[ch]"))


def build(library: Path = LIBRARY, extra_flags: tuple[str, ...] = ()) -> Path:
    """Compile the kernel.

    Parameters
    ----------
    library : Path
        Where the shared library goes; replaced at once, so that running controllers keep theirs.
    extra_flags : tuple of str
        More compiler flags, e.g. for sanitizers.

    Raises
    ------
    RuntimeError
        If there is no compiler or it fails; the message has the compiler's words.
    """
    command = compiler()
    if command is None:
        raise RuntimeError("no C compiler found (set CC); the 'casadi' solver works without one")
    library.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.NamedTemporaryFile(dir=library.parent, suffix=".so", delete=False) as scratch:
        target = Path(scratch.name)
    try:
        files = [str(FOLDER / name) for name in SOURCES]
        run = subprocess.run(
            [*command, *FLAGS, *extra_flags, *files, "-o", str(target), "-lm"], capture_output=True, text=True
        )
        if run.returncode:
            raise RuntimeError(f"the kernel did not compile with {' '.join(command)}:\n{run.stderr}")
        target.chmod(0o755)
        target.replace(library)
    finally:
        target.unlink(missing_ok=True)
    return library


if __name__ == "__main__":
    try:
        print(build())
    except RuntimeError as error:
        sys.exit(str(error))
