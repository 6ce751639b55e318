"""The self-contained folder with a controller in C.

Sources, example, test vectors, board support, function block.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Mapping
from importlib import resources
from pathlib import Path

from fsw_control.c_library import compiler, run_compiler
from fsw_control.schema.files import set_aside
from fsw_control.schema.models import InputError
from fsw_export.choice import Choice, render
from fsw_export.sources import ControllerSources
from fsw_export.targets import published
from fsw_export.vectors import VectorRecorder, csv_text, recorded

_WARNINGS = ("-Wall", "-Wextra", "-Wconversion", "-Wsign-conversion", "-pedantic", "-Werror")
#: as in the exported CMakeLists.txt
FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", *_WARNINGS)
_MARK = "fsw_example.h"
#: blocks of moves of the paper's tuning
_ALL_MOVES = 54


def check_folder(out: Path, replace: bool = False) -> None:
    """Refuse a folder that :func:`write_folder` could not write; the InputError says why."""
    if not out.absolute().parent.is_dir():
        raise InputError(f"cannot write {out}: there is no folder {out.parent}")
    if out.exists() and not (
        out.is_dir() and (not any(out.iterdir()) or (replace and (out / _MARK).exists()))
    ):
        again = "; --force moves it aside" if (out / _MARK).exists() else ""
        kind = "an earlier export" if again else "something else"
        raise InputError(
            f"{out}: holds {kind}; give a folder that does not exist yet, or an empty one{again}"
        )


def write_folder(
    choice: Choice,
    out: Path,
    replace: bool = False,
    progress: Callable[[float], None] | None = None,
) -> str:
    """Record test vectors of a weld, write the folder, compile the example and run it on them.

    Returns what the example printed. The folder must not exist yet, or be empty; with ``replace``
    an earlier export there is kept as the first free ``FOLDER_1``, ``FOLDER_2``, ... ``progress``
    is called with the share of the weld that is done, 0 to 1.

    Raises
    ------
    InputError
        If the folder holds something else or cannot be written, the controller cannot control its
        model, or the example fails.
    """
    check_folder(out, replace)
    sources, vectors = recorded(choice, progress)
    out = out.absolute()  # the example is compiled in a folder of its own
    try:
        with tempfile.TemporaryDirectory(dir=out.parent, prefix=f".{out.name}.") as scratch:
            made = Path(scratch) / "export"
            fill(made, sources, vectors)
            check = _run_example(made)
            _document(made, sources, choice.origin, check)
            if out.exists() and any(out.iterdir()):
                set_aside(out)
            os.rename(made, out.resolve())
    except OSError as error:
        raise InputError(f"cannot write {error.filename or out}: {error.strerror}") from None
    return check


def fill(folder: Path, sources: ControllerSources, vectors: Mapping[str, VectorRecorder]) -> None:
    """Write sources, example and vectors into a new folder."""
    with resources.as_file(resources.files("fsw_export").joinpath("c")) as files:
        shutil.copytree(files, folder)
    texts = {f"src/{name}": text for name, text in sources.files().items()}
    texts["CMakeLists.txt"] = render("CMakeLists.txt", name=sources.name)
    texts[_MARK] = render(
        "fsw_example.h",
        prefix=sources.prefix,
        exported=sources.exported,
        inputs=sources.inputs,
        outputs=sources.outputs,
    )
    for name, made in vectors.items():
        texts[f"vectors/{name}.csv"] = csv_text(sources.inputs, made.ticks)
        texts[f"vectors/{name}_expected.csv"] = csv_text(sources.outputs, made.answers)
    for name, text in texts.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")


def _document(folder: Path, sources: ControllerSources, origin: str, check: str) -> None:
    """Write README and function block; ``check`` is what the example printed on this machine."""
    block = f"FB_Fsw{sources.name.capitalize()}"
    paper = sources.sizes.get("FSW_MAX_BLOCKS") == _ALL_MOVES
    values = {
        "title": sources.title,
        "prefix": sources.prefix,
        "block": block,
        "inputs": sources.inputs,
        "outputs": sources.outputs,
        "origin": origin,
        "check": check,
        "exported": sources.exported,
        "digest": sources.digest,
        "tuning": "its" if paper else "the default",
        "target": published("nmpc_paper" if paper else sources.name, "cortex_m7"),
    }
    for name, template in (("README.md", "README.md"), (f"{block}.st", "function_block.st")):
        (folder / name).write_text(render(template, **values), encoding="utf-8")


def _run_example(folder: Path) -> str:
    """Compile the example with this machine's compiler and run it on the vectors.

    Returns its last line.
    """
    command = compiler()
    if command is None:
        return "not compiled: no C compiler found"
    program = folder / "fsw_example"
    files = [str(folder / "main.c"), *map(str, sorted((folder / "src").glob("*.c")))]
    try:
        run_compiler(
            [
                *command,
                *FLAGS,
                f"-I{folder}",
                f"-I{folder / 'src'}",
                *files,
                "-o",
                str(program),
                "-lm",
            ]
        )
        ran = subprocess.run(
            [program], cwd=folder, capture_output=True, text=True, timeout=300, check=True
        )
    except (RuntimeError, subprocess.SubprocessError) as error:
        words = getattr(error, "stderr", None) or str(error)
        raise InputError(f"the exported example failed: {words.strip()}") from None
    finally:
        program.unlink(missing_ok=True)
    return ran.stdout.strip()
