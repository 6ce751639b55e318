"""Builds the C library of a package, when a C compiler is there.

The library goes into the user's cache, under a name made from sources, flags and processor; so it is built once, is
never stale and is never taken by another kind of machine that shares the home folder. A package may also bring a
library (``setup.py``); it is used if it was made from the same sources. Where there is no compiler, the ziglang wheel
brings one.
"""

from __future__ import annotations

import ctypes
import hashlib
import os
import platform
import shlex
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

# no contraction: the same results on every machine, whatever the width of its vectors
PORTABLE = ("-std=c99", "-O3", "-ffp-contract=off")
FLAGS = (*PORTABLE, "-fPIC", "-shared", "-Wall", "-Wextra", "-Wno-unused-parameter")
#: for a library that stays on this machine; left out where the compiler does not support it
NATIVE = "-march=native"
_LONGEST_BUILD_S = 120.0


def compiler() -> list[str] | None:
    """Command of the C compiler: ``CC``, the first of cc, gcc, clang, or the one in the ziglang wheel."""
    wanted = shlex.split(os.environ.get("CC", ""))
    for command in [wanted, ["cc"], ["gcc"], ["clang"]]:
        if command and shutil.which(command[0]):
            return command
    return [sys.executable, "-m", "ziglang", "cc"] if find_spec("ziglang") else None


def _processor() -> str:
    """What identifies this processor's instruction set, empty if nothing does."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""
    lines = [line for line in text.splitlines() if line.startswith(("flags", "Features", "model name"))]
    return platform.machine() + "".join(dict.fromkeys(lines))


@dataclass(frozen=True)
class CLibrary:
    """The C library of a package.

    Attributes
    ----------
    package : str
        Name of the package, and of its folder in the user's cache.
    folder : Path
        Where the sources and headers are, in the package's folder.
    identify : str
        C function that returns the digest of the sources; in capitals, the macro by which the build hands it in.
    """

    package: str
    folder: Path
    identify: str

    @property
    def sources(self) -> tuple[str, ...]:
        """Names of the C files."""
        return tuple(sorted(path.name for path in self.folder.glob("*.c")))

    def source_id(self) -> str:
        """Digest of the sources, which a library carries to show where it is from."""
        digest = hashlib.sha256()
        for path in sorted(self.folder.glob("*.[ch]")):
            digest.update(path.name.encode() + b"\0" + path.read_bytes())
        return digest.hexdigest()[:16]

    def cache_path(self) -> Path:
        """Where the library for these sources and this machine is kept."""
        cache = os.environ.get("XDG_CACHE_HOME", "")
        folder = Path(cache) if os.path.isabs(cache) else Path.home() / ".cache"
        text = "\0".join([self.source_id(), *FLAGS, platform.system(), platform.machine(), _processor()])
        return folder / self.package / f"kernel-{hashlib.sha256(text.encode()).hexdigest()[:16]}.so"

    def is_usable(self, library: Path) -> bool:
        """Whether a library can be loaded and was made from these sources."""
        try:
            identify = getattr(ctypes.CDLL(str(library)), self.identify)
        except (OSError, AttributeError):
            return False
        identify.restype = ctypes.c_char_p
        return bool(identify() == self.source_id().encode())

    def find(self) -> Path | None:
        """A usable library that is built already, None if there is none."""
        try:
            built = self.cache_path()
        except RuntimeError:  # there is no home folder
            built = None
        packaged = sorted(self.folder.parent.glob("_kernel*.so"))
        for library in [*([built] if built else []), *packaged]:
            if library.exists() and self.is_usable(library):
                return library
        return None

    def ensure(self) -> Path:
        """A usable library, built now if need be.

        Raises
        ------
        RuntimeError
            If there is none and none can be built; the message says why.
        """
        return self.find() or self.build()

    def build(self, library: Path | None = None, extra_flags: tuple[str, ...] = (), native: bool = True) -> Path:
        """Compile the library.

        Parameters
        ----------
        library : Path, optional
            Where the shared library goes, the user's cache by default; replaced at once, so that running controllers
            keep theirs.
        extra_flags : tuple of str
            More compiler flags, e.g. for sanitizers.
        native : bool
            Whether to use all that this machine's processor can do.

        Raises
        ------
        RuntimeError
            If there is no compiler or it fails; the message has the compiler's words.
        """
        command = compiler()
        if command is None:
            raise RuntimeError("no C compiler found: install one, set CC, or 'pip install ziglang'")
        try:
            library = library or self.cache_path()
            library.parent.mkdir(parents=True, exist_ok=True)
            with tempfile.NamedTemporaryFile(dir=library.parent, suffix=".tmp", delete=False) as scratch:
                target = Path(scratch.name)
        except OSError as error:
            raise RuntimeError(f"no place for the kernel's library: {error} (set XDG_CACHE_HOME)") from None
        try:
            attempts = [(NATIVE,), ()] if native and _processor() else [()]
            for flags in attempts:
                words = self._compile([*command, *FLAGS, *flags, *extra_flags], target)
                if words is None:
                    target.chmod(0o755)
                    target.replace(library)
                    return library
            raise RuntimeError(f"the kernel did not compile with {' '.join(command)}:\n{words}")
        finally:
            target.unlink(missing_ok=True)

    def _compile(self, command: list[str], target: Path) -> str | None:
        """Compile into ``target``; returns None, or the compiler's words if it fails."""
        identity = f'-D{self.identify.upper()}="{self.source_id()}"'
        files = [str(self.folder / name) for name in self.sources]
        try:
            run = subprocess.run(
                [*command, identity, *files, "-o", str(target), "-lm"],
                capture_output=True,
                text=True,
                timeout=_LONGEST_BUILD_S,
                check=False,
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            return str(error)
        return run.stderr if run.returncode else None

    def extension(self) -> dict[str, Any]:
        """Arguments of setuptools' ``Extension``, for a package that brings the library with it.

        The library is loaded with ctypes. Its build may fail there: then it is built at the first start.
        """
        return {
            "name": f"{self.package}._kernel",
            "sources": [os.path.relpath(self.folder / name) for name in self.sources],
            "define_macros": [(self.identify.upper(), f'"{self.source_id()}"')],
            "extra_compile_args": list(PORTABLE),
            "optional": True,
        }

    def main(self) -> int:
        """Build the library ahead and print where it is; returns the exit code."""
        try:
            print(self.build())
        except RuntimeError as error:
            print(error, file=sys.stderr)
            return 1
        return 0
