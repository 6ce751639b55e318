"""The self-contained folder with a controller in C: sources, example, test vectors, board support, function block."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from collections.abc import Mapping
from importlib import resources
from pathlib import Path

from fsw_export import c_text, documents
from fsw_export.c_library import ControllerSources
from fsw_export.vectors import VectorRecorder, csv_text
from fsw_nmpc import kernel_build

#: as in the exported CMakeLists.txt
FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-Wall", "-Wextra", "-Wconversion", "-pedantic", "-Werror")
_MARK = "fsw_example.h"


class ExportError(Exception):
    """An export is not possible; the message says what, where and what to do."""


def check_folder(out: Path, replace: bool = False) -> None:
    """Refuse a folder that :func:`write_folder` could not write; ExportError says why."""
    if not out.absolute().parent.is_dir():
        raise ExportError(f"cannot write {out}: there is no folder {out.parent}")
    if out.exists() and not (out.is_dir() and (not any(out.iterdir()) or (replace and (out / _MARK).exists()))):
        again = "; --force deletes it" if (out / _MARK).exists() else ""
        kind = "an earlier export" if again else "something else"
        raise ExportError(f"{out}: holds {kind}; give a folder that does not exist yet, or an empty one{again}")


def write_folder(
    sources: ControllerSources, vectors: Mapping[str, VectorRecorder], origin: str, out: Path, replace: bool = False
) -> str:
    """Write the folder, compile its example and run it on the vectors.

    Parameters
    ----------
    sources : ControllerSources
    vectors : mapping of str to VectorRecorder
        The test vectors by name.
    origin : str
        From which model and tuning, in words.
    out : Path
        Must not exist yet, or be empty.
    replace : bool
        Whether an earlier export there is deleted, with all that has been put into it.

    Returns
    -------
    str
        What the example said.

    Raises
    ------
    ExportError
        If the folder holds something else or cannot be written, or the example fails.
    """
    check_folder(out, replace)
    out = out.absolute()  # the example is compiled in a folder of its own
    try:
        with tempfile.TemporaryDirectory(dir=out.parent, prefix=f".{out.name}.") as scratch:
            made = Path(scratch) / "export"
            _fill(made, sources, vectors)
            said = _run_example(made)
            documents.write(made, sources, origin, said)
            if out.exists():
                shutil.rmtree(out)
            os.rename(made, out)
    except OSError as error:
        raise ExportError(f"cannot write {error.filename or out}: {error.strerror}") from None
    return said


def _fill(folder: Path, sources: ControllerSources, vectors: Mapping[str, VectorRecorder]) -> None:
    """Sources, example and vectors."""
    for part in ("src", "vectors", "cortex_m7"):
        (folder / part).mkdir(parents=True)
    for name, text in sources.files().items():
        (folder / "src" / name).write_text(text, encoding="utf-8")
    templates = resources.files("fsw_export").joinpath("c")
    for name in ("main.c", "CMakeLists.txt"):
        text = templates.joinpath(name).read_text(encoding="utf-8").replace("@NAME@", f"fsw_{sources.name}")
        (folder / name).write_text(text, encoding="utf-8")
    for entry in templates.joinpath("cortex_m7").iterdir():
        (folder / "cortex_m7" / entry.name).write_text(entry.read_text(encoding="utf-8"), encoding="utf-8")
    (folder / _MARK).write_text(_example_header(sources), encoding="utf-8")
    for name, one in vectors.items():
        (folder / "vectors" / f"{name}.csv").write_text(csv_text(sources.inputs, one.ticks), encoding="utf-8")
        expected = folder / "vectors" / f"{name}_expected.csv"
        expected.write_text(csv_text(sources.outputs, one.answers), encoding="utf-8")


def _example_header(sources: ControllerSources) -> str:
    """What the example's main.c knows of this controller."""
    tables = [
        c_text.columns(table, struct, {s.name: (s.in_c, s.is_int) for s in signals})
        for table, struct, signals in (
            ("INPUTS", sources.input_type, sources.inputs),
            ("OUTPUTS", sources.output_type, sources.outputs),
        )
    ]
    return "\n".join(
        [
            "/* The controller and the columns of the CSV files, for main.c. */",
            f'#include "{sources.tables_name}.h"\n',
            f"#define CONTROLLER {sources.prefix}",
            f"#define INPUT {sources.input_type}",
            f"#define OUTPUT {sources.output_type}",
            f"#define START(controller) {sources.prefix}_init(controller, {sources.start})",
            f"#define RESET(controller, in) "
            f"{sources.prefix}_reset(controller, (in)->applied_force_kn, (in)->applied_speed_rpm)",
            f"#define CLEAR(in) {sources.input_type}_clear(in)",
            f"#define STEP(controller, in, out) {sources.prefix}_step(controller, in, out)\n",
            "typedef struct { const char *name; size_t offset; int is_int; } column;\n",
            *tables,
        ]
    )


def _run_example(folder: Path) -> str:
    """Compile the example with this machine's compiler and run it on the vectors; returns its last line."""
    compiler = kernel_build.compiler()
    if compiler is None:
        return "not compiled: no C compiler found"
    program = folder / "fsw_example"
    files = [str(folder / "main.c"), *map(str, sorted((folder / "src").glob("*.c")))]
    try:
        for command in (
            [*compiler, *FLAGS, "-I", str(folder), "-I", str(folder / "src"), *files, "-o", str(program), "-lm"],
            [str(program)],
        ):
            ran = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=300, check=False)
            if ran.returncode:
                words = (ran.stderr or ran.stdout).strip().splitlines()
                raise ExportError(f"the exported example failed: {words[0] if words else f'exit {ran.returncode}'}")
    except subprocess.TimeoutExpired:
        raise ExportError("the exported example did not end within 300 s") from None
    finally:
        program.unlink(missing_ok=True)
    return ran.stdout.strip()
