"""A package's C library: compiled on the machine where it runs, its header read by cffi.

The library is stored in the user's cache under a name derived from sources, flags and processor:
it is built once, cannot be stale, and is not loaded by a different machine that shares the home
folder. A package may also ship a library (``setup.py``, ``scripts/wheel_kernels.py``), which is
used if it was built from the same sources. Without a system compiler, the ziglang wheel is used.
"""

from __future__ import annotations

import ctypes
import hashlib
import os
import platform
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from fsw_control.schema.files import replacing, user_cache

# no contraction of multiply-add: identical results on all machines, whatever their vector width
PORTABLE = ("-std=c99", "-O3", "-ffp-contract=off")
FLAGS = (*PORTABLE, "-fPIC", "-shared", "-Wall", "-Wextra", "-Wno-unused-parameter")
#: for a library that stays on this machine; left out where the compiler does not support it
NATIVE = "-march=native"
_LONGEST_BUILD_S = 600.0

#: set by the ROS 2 wheels when they restart the interpreter with their libraries in
#: LD_LIBRARY_PATH
_WHEELS_READY = "_ROS_WHEELS_BOOTSTRAP_COMPLETE"
_PATH = "LD_LIBRARY_PATH"


def tool_environment() -> dict[str, str]:
    """Return this process's environment without the library path that the ROS 2 wheels added.

    A sourced ROS 2 keeps its own.
    """
    environment = dict(os.environ)
    if environment.pop(_WHEELS_READY, None) is None:
        return environment
    own = os.path.join(sys.prefix, "lib")
    paths = environment.pop(_PATH, "").split(os.pathsep)
    kept = [path for path in paths if path and not path.startswith(own)]
    return environment | ({_PATH: os.pathsep.join(kept)} if kept else {})


def compiler() -> list[str] | None:
    """Command of the C compiler: ``CC``, else cc, gcc or clang, else that of the ziglang wheel."""
    requested = shlex.split(os.environ.get("CC", ""))
    for command in [requested, ["cc"], ["gcc"], ["clang"]]:
        if command and shutil.which(command[0]):
            return command
    return [sys.executable, "-m", "ziglang", "cc"] if find_spec("ziglang") else None


def needed_compiler() -> list[str]:
    """As :func:`compiler`; RuntimeError if there is none."""
    command = compiler()
    if command is None:
        raise RuntimeError("no C compiler found: install one, set CC, or 'pip install ziglang'")
    return command


def run_compiler(command: Sequence[str]) -> None:
    """Compile; RuntimeError with the compiler's output if that fails."""
    try:
        run = subprocess.run(
            command,
            env=tool_environment(),
            capture_output=True,
            text=True,
            timeout=_LONGEST_BUILD_S,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise RuntimeError(f"the compiler failed: {error}") from None
    if run.returncode:
        raise RuntimeError(f"the sources did not compile with {command[0]}:\n{run.stderr}")


def _processor() -> str:
    """Identification of this processor's instruction set; empty if unknown."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""
    names = "flags", "Features", "model name"
    lines = [line for line in text.splitlines() if line.startswith(names)]
    return platform.machine() + "".join(dict.fromkeys(lines))


def _declarations(header: Path) -> str:
    """Return a header as cffi accepts it.

    Included headers are inlined; of the preprocessor lines only integer constants are kept.
    """
    text = re.sub(
        r'#include "(.+)"',
        lambda include: _declarations(header.parent / include[1]),
        header.read_text("utf-8"),
    )
    text = re.sub(r"#ifdef __cplusplus.*?#endif", "", text, flags=re.DOTALL)
    return re.sub(r"^#(?!define \w+ +\d+ *(/\*.*)?$)(.*\\\n)*.*", "", text, flags=re.MULTILINE)


@dataclass(frozen=True)
class CLibrary:
    """The C library of a package."""

    #: name of the package, of its folder in the user's cache, and of the header; prefix of all
    #: functions. ``<package>_id`` returns the digest of the sources, which the build passes in by
    #: the macro of the same name in capitals
    package: str
    folder: Path  #: where the sources and headers are, in the package's folder

    @cached_property
    def ffi(self) -> Any:
        """The parsed header."""
        from cffi import FFI  # setup.py does without

        ffi = FFI()
        ffi.cdef(_declarations(self.folder / f"{self.package}.h"))
        return ffi

    @cached_property
    def lib(self) -> Any:
        """Functions and constants of the library, built if necessary; raises as :meth:`ensure`."""
        return self.ffi.dlopen(str(self.ensure()))

    def new(self, kind: str, **fields: Any) -> Any:
        """Return an owning pointer to a new struct of the header; omitted fields are 0."""
        return self.ffi.new(f"{kind} *", fields)

    def enum(self, kind: str, prefix: str) -> Any:
        """Return an enumeration of the header as ``IntEnum``, its names without ``prefix``."""
        names = sorted(self.ffi.typeof(kind).elements.items())
        return IntEnum(kind, {name.removeprefix(prefix): value for value, name in names})

    @property
    def sources(self) -> tuple[str, ...]:
        """Names of the C files."""
        return tuple(sorted(path.name for path in self.folder.glob("*.c")))

    @property
    def _macro(self) -> str:
        return f"{self.package}_id".upper()

    def source_id(self) -> str:
        """Digest of the sources, stored in the library to identify them."""
        digest = hashlib.sha256()
        for path in sorted(self.folder.glob("*.[ch]")):
            digest.update(path.name.encode() + b"\0" + path.read_bytes())
        return digest.hexdigest()[:16]

    def cache_path(self) -> Path:
        """Path of the cached library for these sources and this machine."""
        machine = platform.system(), platform.machine(), _processor()
        text = "\0".join([self.source_id(), *FLAGS, *machine])
        digest = hashlib.sha256(text.encode()).hexdigest()[:16]
        return user_cache(self.package) / f"kernel-{digest}.so"

    def is_usable(self, library: Path) -> bool:
        """Whether a library can be loaded and was built from these sources."""
        try:
            identify = getattr(ctypes.CDLL(str(library)), f"{self.package}_id")
        except (OSError, AttributeError):
            return False
        identify.restype = ctypes.c_char_p
        return bool(identify() == self.source_id().encode())

    def find(self) -> Path | None:
        """An existing usable library, or None."""
        try:
            built = self.cache_path()
        except OSError:  # there is no cache
            built = None
        packaged = sorted(self.folder.parent.glob("_kernel*.so"))
        for library in [*([built] if built else []), *packaged]:
            if library.exists() and self.is_usable(library):
                return library
        return None

    def ensure(self) -> Path:
        """Return a usable library, built now if necessary; RuntimeError if that is impossible."""
        return self.find() or self.build()

    def build(self, library: Path | None = None, portable: Sequence[str] | None = None) -> Path:
        """Compile the library for this machine, or for all of its architecture.

        Parameters
        ----------
        library : Path, optional
            Output path, by default in the user's cache. The file is replaced atomically, so
            running controllers keep their copy.
        portable : sequence of str, optional
            Compiler command for a library meant for other machines; by default
            :func:`needed_compiler` compiles for the processor of this machine.

        Raises
        ------
        RuntimeError
            Without a compiler, or if it fails; the message contains the compiler's output.
        """
        command = list(portable or needed_compiler())
        native = [NATIVE] if _processor() and portable is None else []
        identity = f'-D{self._macro}="{self.source_id()}"'
        files = [str(self.folder / name) for name in self.sources]
        try:
            library = library or self.cache_path()
            library.parent.mkdir(parents=True, exist_ok=True)
            with replacing(library) as target:
                arguments = [*FLAGS, identity, *files, "-o", str(target), "-lm"]
                try:
                    run_compiler([*command, *native, *arguments])
                except RuntimeError:
                    if not native:
                        raise
                    run_compiler([*command, *arguments])
                target.chmod(0o755)
        except OSError as error:
            raise RuntimeError(f"cannot write the kernel's library: {error}") from None
        return library

    def extension(self) -> dict[str, Any]:
        """Arguments of setuptools' ``Extension``, for a package that ships the library.

        cffi loads the library. The build may fail during installation; the library is then built
        at the first start.
        """
        return {
            "name": f"{self.package}._kernel",
            "sources": [os.path.relpath(self.folder / name) for name in self.sources],
            "define_macros": [(self._macro, f'"{self.source_id()}"')],
            "extra_compile_args": list(PORTABLE),
            "optional": True,
        }


class CController:
    """A controller of a loaded library ``fsw_NAME``: its memory and the common functions.

    ``lib`` defaults to ``library.lib``, ``refusal`` is the error text if the library rejects a
    tuning, and ``data`` are the arguments of ``fsw_NAME_init``. ``state`` is the controller's
    memory, a ``fsw_NAME *``; ``input`` and ``output`` are the arguments of :meth:`step`.

    Raises
    ------
    RuntimeError, OSError
        If the library cannot be built or loaded.
    ValueError
        If the library rejects the data.
    """

    def __init__(self, library: CLibrary, lib: Any, refusal: str, *data: Any) -> None:
        name, self._refusal = library.package, refusal
        self.lib = lib = lib or library.lib
        self.state, self.input, self.output = (
            library.new(f"{name}{part}") for part in ("", "_input", "_output")
        )
        init, self._configure, self._reset, self._step = (
            getattr(lib, f"{name}_{verb}") for verb in ("init", "configure", "reset", "step")
        )
        if init(self.state, *data):
            raise ValueError(refusal)

    def configure(self, tuning: Any) -> None:
        """Use another tuning, bumplessly; ValueError if it is invalid, and the old one stays."""
        if self._configure(self.state, tuning):
            raise ValueError(self._refusal)

    def reset(self, force_kn: float, speed_rpm: float) -> None:
        """Forget the past."""
        self._reset(self.state, force_kn, speed_rpm)

    def take(self, measurement: Any, reference: Any, applied: Any, dt_s: float) -> None:
        """Set what every controller gets: samples, set-points, the command in force, the time."""
        inputs = self.input
        inputs.depth_mm, inputs.torque_nm = measurement.depth_mm, measurement.torque_nm
        inputs.temperature_c, inputs.dt_s = measurement.temperature_c, dt_s
        inputs.reference_depth_mm = reference.depth_mm
        inputs.reference_temperature_c = reference.temperature_c
        inputs.applied_force_kn, inputs.applied_speed_rpm = applied

    def step(self) -> None:
        """Compute one tick, from ``input`` to ``output``."""
        self._step(self.state, self.input, self.output)
