"""Other processors on which exported C is built and run, emulated by QEMU."""

from __future__ import annotations

import csv
import re
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

_QEMU_M7 = [
    "qemu-system-arm",
    "-M",
    "mps2-an500",
    "-display",
    "none",
    "-monitor",
    "none",
    "-serial",
    "none",
    "-icount",
    "shift=0",
    "-semihosting-config",
    "enable=on,target=native,arg=fsw_example,arg=vectors/weld.csv",
    "-kernel",
]
#: instructions of QEMU's virtual time (1 ns each) in a tick of the board's clock (25 MHz)
_PER_TICK = 40
_COUNTER = 1 << 24
_NODE = re.compile(
    r'node: \{ title: "([^"]+)" label: "[^"]*?(\d+) bytes \((?:static|dynamic,bounded)\)"'
)


@dataclass(frozen=True, slots=True)
class Target:
    """A processor.

    Attributes
    ----------
    title : str
    needs : tuple of str
        Programs.
    packages : str
        Debian packages that bring them.
    options : tuple of str
        Of cmake.
    counts : bool
        Whether its emulator counts instructions.
    """

    title: str
    needs: tuple[str, ...]
    packages: str
    options: tuple[str, ...]
    counts: bool = False

    def missing(self) -> str:
        """What has to be installed first, empty if nothing."""
        absent = [program for program in ("cmake", *self.needs) if shutil.which(program) is None]
        return f"apt-get install cmake {self.packages} (no {', '.join(absent)})" if absent else ""


def _linux(compiler: str, emulator: str) -> tuple[str, ...]:
    return (
        "-DCMAKE_SYSTEM_NAME=Linux",
        f"-DCMAKE_C_COMPILER={compiler}",
        "-DCMAKE_EXE_LINKER_FLAGS=-static",
        f"-DCMAKE_CROSSCOMPILING_EMULATOR={emulator}",
    )


_M7 = ("-DCMAKE_TOOLCHAIN_FILE=cortex_m7/toolchain.cmake",)
_M7_PACKAGES = "gcc-arm-none-eabi libnewlib-arm-none-eabi qemu-system-arm"
TARGETS = {
    "gcc": Target("x86-64, gcc", ("gcc",), "gcc", ("-DCMAKE_C_COMPILER=gcc",)),
    "clang": Target("x86-64, clang", ("clang",), "clang", ("-DCMAKE_C_COMPILER=clang",)),
    "cortex_m7": Target(
        "Cortex-M7", ("arm-none-eabi-gcc", "qemu-system-arm"), _M7_PACKAGES, _M7, True
    ),
    "cortex_m7_sp": Target(
        "Cortex-M7, FPU of single precision only",
        ("arm-none-eabi-gcc", "qemu-system-arm"),
        _M7_PACKAGES,
        (*_M7, "-DFSW_FPU=-mfpu=fpv5-sp-d16 -mfloat-abi=hard"),
        True,
    ),
    "armhf": Target(
        "ARMv7, 32 bit, Linux",
        ("arm-linux-gnueabihf-gcc", "qemu-arm"),
        "gcc-arm-linux-gnueabihf libc6-dev-armhf-cross qemu-user",
        _linux("arm-linux-gnueabihf-gcc", "qemu-arm"),
    ),
    "powerpc": Target(
        "PowerPC, 32 bit, big-endian, Linux",
        ("powerpc-linux-gnu-gcc", "qemu-ppc"),
        "gcc-powerpc-linux-gnu libc6-dev-powerpc-cross qemu-user",
        _linux("powerpc-linux-gnu-gcc", "qemu-ppc"),
    ),
}


def _command(command: list[str], cwd: Path) -> str:
    ran = subprocess.run(
        command, cwd=cwd, capture_output=True, text=True, check=False, timeout=600
    )
    if ran.returncode:
        raise AssertionError(f"{' '.join(command)}:\n{ran.stdout[-2000:]}{ran.stderr[-2000:]}")
    return ran.stdout


def build(folder: Path, target: Target, build_folder: Path, *options: str) -> None:
    """Build an exported folder."""
    _command(
        [
            "cmake",
            "-S",
            str(folder),
            "-B",
            str(build_folder),
            "-DFSW_STRICT=1",
            *target.options,
            *options,
        ],
        folder,
    )
    _command(["cmake", "--build", str(build_folder)], folder)


def check_vectors(folder: Path, build_folder: Path) -> None:
    """Run the test vectors; raises AssertionError with the example's words if they do not pass."""
    _command(["ctest", "--test-dir", str(build_folder), "--output-on-failure"], folder)


def run_vectors(folder: Path, build_folder: Path) -> None:
    """Run the test vectors, whether they pass or not; see :func:`largest_difference`."""
    subprocess.run(
        ["ctest", "--test-dir", str(build_folder)], cwd=folder, capture_output=True, check=False
    )


def largest_difference(folder: Path, build_folder: Path) -> float:
    """Of the outputs from those expected, as the example told it."""
    log = (build_folder / "Testing" / "Temporary" / "LastTest.log").read_text(encoding="utf-8")
    differences = re.findall(r"largest difference (\S+):", log)
    if len(differences) != 2:
        raise AssertionError(f"the example said no difference:\n{log}")
    return max(map(float, differences))


def instructions(folder: Path, build_folder: Path) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Instructions of every tick of the vectors, and the solver's iterations (zeros where there is no solver).

    The build must have ``FSW_COUNTER``.
    """
    rows = list(
        csv.DictReader(
            _command([*_QEMU_M7, str(build_folder / "fsw_example")], folder).splitlines()
        )
    )
    ticks = np.array([int(row["count"]) for row in rows]) % _COUNTER
    return ticks * _PER_TICK, np.array([int(row.get("iterations", 0)) for row in rows])


def stack_bytes(build_folder: Path, function: str) -> int:
    """Largest stack of a function with all that it calls, from the compiler's call graph (``FSW_STACK_USAGE``).

    What the C library needs for memcpy and the like is not in it.
    """
    own: dict[str, int] = {}
    calls: dict[str, list[str]] = {}
    for file in build_folder.rglob("*.ci"):
        text = file.read_text(encoding="utf-8")
        for title, size in re.findall(
            r'node: \{ title: "([^"]+)" label: "[^"]*?(\d+) bytes \((?:static|dynamic,bounded)\)"',
            text,
        ):
            own[title] = int(size)
        for source, called in re.findall(
            r'edge: \{ sourcename: "([^"]+)" targetname: "([^"]+)"', text
        ):
            calls.setdefault(source, []).append(called)

    def deepest(name: str, above: tuple[str, ...]) -> int:
        if name in above:
            raise AssertionError(f"recursion: {' > '.join((*above, name))}")
        return own.get(name, 0) + max(
            (deepest(callee, (*above, name)) for callee in calls.get(name, ())), default=0
        )

    return deepest(function, ())


def state_bytes(build_folder: Path) -> int:
    """Bytes of the controller with its input and output, as the example holds them."""
    lines = _command(["arm-none-eabi-nm", "-S", str(build_folder / "fsw_example")], build_folder)
    symbols = re.findall(r"^\w+ (\w+) [bB] (?:controller|input|output)$", lines, re.MULTILINE)
    if len(symbols) != 3:
        raise AssertionError(f"the example has no controller, input and output:\n{lines[:500]}")
    return sum(int(size, 16) for size in symbols)


def sizes(build_folder: Path) -> tuple[int, int]:
    """Bytes of code and constants, and of initialised and zeroed data, of the library alone."""
    lines = _command(
        ["arm-none-eabi-size", "--totals", *map(str, build_folder.glob("libfsw_*.a"))],
        build_folder,
    )
    text, data, bss = (int(word) for word in lines.splitlines()[-1].split()[:3])
    return text, data + bss
