"""Compiling C in tests: strictly, under sanitizers, to ask for the layout of structs."""

from __future__ import annotations

import ctypes
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path

from fsw_control import c_library

STRICT = ("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Wconversion", "-Werror")
SANITIZE = ("-g", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-fno-omit-frame-pointer")


def compile_c(arguments: Sequence[str], command: Sequence[str] | None = None) -> subprocess.CompletedProcess[str]:
    """Run ``command``, by default the compiler that builds the libraries."""
    compiler = command or c_library.compiler() or ["cc"]
    return subprocess.run([*compiler, *arguments], capture_output=True, text=True, check=False)


def has_sanitizers(folder: Path) -> bool:
    """Whether the compiler links with the sanitizers; ``folder`` is for scratch files."""
    (folder / "probe.c").write_text("int main(void) { return 0; }\n", encoding="utf-8")
    return compile_c([*SANITIZE, str(folder / "probe.c"), "-o", str(folder / "probe")]).returncode == 0


def layout_in_c(header: Path, structs: Mapping[str, type[ctypes.Structure]], folder: Path) -> list[int]:
    """Offset of every field of ``structs`` and size of each, as the C compiler has them."""
    lines = ["#include <stddef.h>", "#include <stdio.h>", f'#include "{header.name}"', "int main(void) {"]
    for name, kind in structs.items():
        lines += [f'printf("%zu\\n", offsetof({name}, {field}));' for field, *_ in kind._fields_]
        lines.append(f'printf("%zu\\n", sizeof({name}));')
    (folder / "sizes.c").write_text("\n".join([*lines, "return 0; }"]), encoding="utf-8")
    program = str(folder / "sizes")
    built = compile_c(["-std=c99", "-I", str(header.parent), str(folder / "sizes.c"), "-o", program])
    assert built.returncode == 0, built.stderr
    told = subprocess.run([program], capture_output=True, text=True, check=True).stdout
    return [int(word) for word in told.split()]


def layout_in_python(structs: Mapping[str, type[ctypes.Structure]]) -> list[int]:
    """The same as ctypes has them."""
    layout: list[int] = []
    for kind in structs.values():
        layout += [getattr(kind, field).offset for field, *_ in kind._fields_] + [ctypes.sizeof(kind)]
    return layout
