"""Compiling C in tests: strictly, under sanitizers, to compare the layout of structs."""

from __future__ import annotations

import subprocess
from collections.abc import Sequence
from pathlib import Path

from fsw_control import c_library
from fsw_control.c_library import CLibrary

STRICT = (
    "-std=c99",
    "-pedantic",
    "-Wall",
    "-Wextra",
    "-Wconversion",
    "-Wsign-conversion",
    "-Werror",
)
SANITIZE = (
    "-g",
    "-O1",
    "-fsanitize=address,undefined",
    "-fno-sanitize-recover=all",
    "-fno-omit-frame-pointer",
)


def compile_c(
    arguments: Sequence[str], command: Sequence[str] | None = None
) -> subprocess.CompletedProcess[str]:
    """Run ``command``, by default the compiler that builds the libraries."""
    compiler = command or c_library.compiler() or ["cc"]
    return subprocess.run([*compiler, *arguments], capture_output=True, text=True, check=False)


def has_sanitizers(folder: Path) -> bool:
    """Whether the compiler links with the sanitizers; ``folder`` is for scratch files."""
    (folder / "probe.c").write_text("int main(void) { return 0; }\n", encoding="utf-8")
    return (
        compile_c([*SANITIZE, str(folder / "probe.c"), "-o", str(folder / "probe")]).returncode
        == 0
    )


def check_layout(library: CLibrary, folder: Path) -> None:
    """Check that every struct of the header is laid out by the C compiler as cffi has it."""
    ffi, lines, layout = library.ffi, [], []
    for name in ffi.list_types()[0]:
        kind = ffi.typeof(name)
        if kind.kind != "struct":
            continue
        for field, value in kind.fields:
            lines.append(f'printf("%zu\\n", offsetof({name}, {field}));')
            layout.append(value.offset)
        lines.append(f'printf("%zu\\n", sizeof({name}));')
        layout.append(ffi.sizeof(kind))
    head = [
        "#include <stddef.h>",
        "#include <stdio.h>",
        f'#include "{library.package}.h"',
        "int main(void) {",
    ]
    (folder / "sizes.c").write_text("\n".join([*head, *lines, "return 0; }"]), encoding="utf-8")
    program = str(folder / "sizes")
    built = compile_c(
        ["-std=c99", "-I", str(library.folder), str(folder / "sizes.c"), "-o", program]
    )
    assert built.returncode == 0, built.stderr
    printed = subprocess.run([program], capture_output=True, text=True, check=True).stdout
    assert [int(word) for word in printed.split()] == layout
