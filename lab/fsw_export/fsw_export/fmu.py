"""Writes plant and controllers as Functional Mock-up Units.

FMI 2.0 for co-simulation, with sources and binary.
"""

from __future__ import annotations

import hashlib
import sys
import tempfile
import zipfile
from collections.abc import Callable, Sequence
from importlib.util import find_spec
from pathlib import Path

from fsw_control.c_library import PORTABLE, needed_compiler, run_compiler
from fsw_control.schema.extensions import Extra
from fsw_control.schema.files import replacing
from fsw_control.schema.models import InputError
from fsw_export.choice import Choice
from fsw_export.fmu_controllers import decentral, nmpc
from fsw_export.fmu_description import Content, declarations, model_description, source
from fsw_export.fmu_plant import plant

# for any processor of its kind
FLAGS = (*PORTABLE, "-shared", "-fvisibility=hidden")
#: FMI platforms that zig cross-compiles for: its target, and the suffix of the binary
CROSS = {"linux64": ("x86_64-linux-gnu", ".so"), "win64": ("x86_64-windows-gnu", ".dll")}
_HEADERS = ("fmi2Functions.h", "fmi2FunctionTypes.h", "fmi2TypesPlatform.h")
#: what can be exported, by name
UNITS: dict[str, Callable[[Choice], Content]] = {
    "plant": plant,
    "nmpc": nmpc,
    "decentral": decentral,
}


def make(choice: Choice) -> Content:
    """Variables and sources of a unit.

    Raises
    ------
    InputError
        If the unit is not known, or a value or a file cannot be used.
    """
    if choice.unit not in UNITS:
        raise InputError(f"cannot export {choice.unit!r}; known: {', '.join(UNITS)}")
    return UNITS[choice.unit](choice)


def check_file(out: Path, replace: bool = False) -> None:
    """Refuse a file that :func:`write` could not write; the InputError says why."""
    if out.suffix != ".fmu":
        raise InputError(f"{out}: the name must end in .fmu")
    if not out.absolute().parent.is_dir():
        raise InputError(f"cannot write {out}: there is no folder {out.parent}")
    if out.exists() and not (replace and out.is_file()):
        raise InputError(f"{out} exists already; use --force to replace it")


def write(content: Content, out: Path, replace: bool = False, others: Sequence[str] = ()) -> None:
    """Compile a unit for this machine and write its FMU, ``*.fmu``.

    ``replace``: an existing file may be replaced. ``others`` are platforms of ``CROSS`` to compile
    for as well, which needs ziglang.

    Raises
    ------
    InputError, RuntimeError
        If the file cannot be written, or there is no compiler or it fails; nothing has been
        written then.
    """
    check_file(out, replace)
    sources, guid = _sources(content)
    compiled = sorted(name for name in sources if name.endswith(".c"))
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        for name, text in sources.items():
            (folder / name).write_text(text, encoding="utf-8")
        files = {
            "modelDescription.xml": model_description(content, compiled, guid).encode(),
            **{f"sources/{name}": text.encode() for name, text in sources.items()},
        }
        for command, suffix, platform in [_native(), *map(_cross, others)]:
            binary = folder / f"{content.identifier}{suffix}"
            files_c = [str(folder / name) for name in compiled]
            run_compiler([*command, *FLAGS, *files_c, "-o", str(binary), "-lm"])
            files[f"binaries/{platform}/{binary.name}"] = binary.read_bytes()
    try:
        with replacing(out) as part, zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, data in files.items():
                entry = zipfile.ZipInfo(name)  # without a date: the same file every time
                entry.external_attr = 0o644 << 16
                archive.writestr(entry, data, zipfile.ZIP_DEFLATED)
    except OSError as error:
        raise InputError(f"cannot write {out}: {error.strerror}") from None


def _sources(content: Content) -> tuple[dict[str, str], str]:
    """All C files by name, and the guid made from them."""
    headers = _fmpy() / "c-code"
    sources = {**content.sources, "fmu.c": source("fmu.c"), "fmu.h": source("fmu.h")}
    sources |= {name: (headers / name).read_text(encoding="utf-8") for name in _HEADERS}
    unnamed = sources | declarations(content, "")
    digest = hashlib.sha256(
        repr([content.variables, sorted(unnamed.items())]).encode()
    ).hexdigest()
    guid = (
        "{"
        + "-".join((digest[:8], digest[8:12], digest[12:16], digest[16:20], digest[20:32]))
        + "}"
    )
    return sources | declarations(content, guid), guid


def _fmpy() -> Path:
    """Folder of fmpy, which brings the headers of the standard."""
    Extra("fsw-lab", "fmu", ("fmpy",)).need("fmpy, which brings the headers of FMI")
    spec = find_spec("fmpy")
    assert spec is not None and spec.origin is not None
    return Path(spec.origin).parent


def _native() -> tuple[list[str], str, str]:
    """Compiler for this machine, suffix of a binary, and the machine's name in an FMU."""
    import fmpy

    return [*needed_compiler(), "-fPIC"], fmpy.sharedLibraryExtension, fmpy.platform


def _cross(platform: str) -> tuple[list[str], str, str]:
    """The same for a platform of ``CROSS``."""
    Extra("fsw-control", "compiler", ("ziglang",)).need(f"{platform}: zig's compiler")
    target, suffix = CROSS[platform]
    return [sys.executable, "-m", "ziglang", "cc", "-target", target], suffix, platform
