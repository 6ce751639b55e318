"""The exported C: compiles everywhere without a warning and answers as Python does.

Bad input is reported in one line.
"""

import re
import shutil
import subprocess
import sys

import pytest

from fsw.main import main
from fsw_control.c_library import compiler
from fsw_export.sources import sources_of
from fsw_nmpc import NmpcController
from fsw_test_support.c_code import STRICT, compile_c
from fsw_test_support.c_targets import (
    TARGETS,
    build,
    check_vectors,
    largest_difference,
    stack_bytes,
)
from fsw_test_support.exports import c_folder, c_objects

CONTROLLERS = ("nmpc", "decentral")


@pytest.fixture(scope="session")
def exported(tmp_path_factory):
    """Folder of each controller."""
    return {name: c_folder(tmp_path_factory, name) for name in CONTROLLERS}


@pytest.fixture(scope="session")
def objects(tmp_path_factory):
    """Compiled sources of each controller."""
    return {name: c_objects(tmp_path_factory, name) for name in CONTROLLERS}


@pytest.mark.slow
@pytest.mark.parametrize("controller", CONTROLLERS)
@pytest.mark.parametrize("compiler", ["gcc", "clang"])
def test_strict_c99_without_a_warning(exported, compiler, controller):
    if shutil.which(compiler) is None:
        pytest.skip(f"{compiler} is not installed")
    folder = exported[controller]
    files = [str(path) for path in (folder / "main.c", *sorted((folder / "src").glob("*.c")))]
    built = compile_c(
        [*STRICT, "-I", str(folder), "-I", str(folder / "src"), "-fsyntax-only", *files],
        [compiler],
    )
    assert built.returncode == 0, built.stderr


@pytest.mark.slow
@pytest.mark.parametrize("controller", CONTROLLERS)
@pytest.mark.parametrize("target", [name for name in TARGETS if name != "cortex_m7_sp"])
@pytest.mark.full
def test_same_answers_on_every_processor(exported, target, controller, tmp_path):
    """A weld of 240 s.

    Strict C99 without a warning, and every output within 1e-9 of this machine's.
    """
    if missing := TARGETS[target].missing():
        pytest.skip(missing)
    build(exported[controller], TARGETS[target], tmp_path)
    check_vectors(exported[controller], tmp_path)
    assert largest_difference(exported[controller], tmp_path) <= 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("controller", CONTROLLERS)
@pytest.mark.full
def test_vectors_under_sanitizers(exported, controller, tmp_path):
    if missing := TARGETS["gcc"].missing():
        pytest.skip(missing)
    flags = "-fsanitize=address,undefined -fno-sanitize-recover=all"
    build(exported[controller], TARGETS["gcc"], tmp_path, f"-DCMAKE_C_FLAGS={flags}")
    check_vectors(exported[controller], tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("controller", CONTROLLERS)
@pytest.mark.full
def test_a_wrong_answer_is_noticed(exported, objects, controller, tmp_path):
    folder = tmp_path / "copy"
    subprocess.run(["cp", "-r", str(exported[controller]), str(folder)], check=True)
    expected = folder / "vectors" / "weld_expected.csv"
    lines = expected.read_text().splitlines()
    first, _, rest = lines[7].partition(",")
    lines[7] = f"{float(first) + 2e-9!r},{rest}"
    expected.write_text("\n".join(lines) + "\n")
    program = str(tmp_path / "example")
    flags = ["-std=c99", "-I", str(folder), "-I", str(folder / "src")]
    subprocess.run(
        [*compiler(), *flags, str(folder / "main.c"), *objects[controller], "-o", program, "-lm"],
        check=True,
    )
    ran = subprocess.run([program], cwd=folder, capture_output=True, text=True, check=False)
    assert ran.returncode == 1
    assert "line 8: force_kn is" in ran.stderr


@pytest.mark.slow
@pytest.mark.parametrize("controller", CONTROLLERS)
@pytest.mark.full
def test_stack_has_a_bound(exported, controller, tmp_path):
    """No recursion, no array of variable size.

    The compiler's call graph gives the largest stack.
    """
    if missing := TARGETS["gcc"].missing():
        pytest.skip(missing)
    build(exported[controller], TARGETS["gcc"], tmp_path, "-DFSW_STACK_USAGE=1")
    assert 0 < stack_bytes(tmp_path, f"fsw_{controller}_step") < 32_768
    report = "\n".join(path.read_text() for path in tmp_path.rglob("*.ci"))
    assert "bytes (dynamic)" not in report


@pytest.mark.slow
@pytest.mark.parametrize("controller", CONTROLLERS)
@pytest.mark.full
def test_nothing_but_the_listed_library_functions(objects, controller):
    """No heap, no files, and of libm only what the header lists."""
    listed = subprocess.run(
        ["nm", *objects[controller]], capture_output=True, text=True, check=True
    ).stdout
    outside = set(re.findall(r"^ +U (\w+)$", listed, re.MULTILINE)) - set(
        re.findall(r" T (\w+)$", listed, re.MULTILINE)
    )
    outside -= set(re.findall(r" [RrDd] (\w+)$", listed, re.MULTILINE))
    allowed = {"nmpc": {"sqrt", "fmin", "fmax"}, "decentral": {"exp"}}[controller]
    assert (
        outside - {"memcpy", "memset", "memmove", "__stack_chk_fail", "_GLOBAL_OFFSET_TABLE_"}
        <= allowed
    )
    assert not re.search(r" [bBcC] \w+$", listed, re.MULTILINE), "writable globals"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--model", "nowhere.yaml"], "nowhere.yaml: No such file"),
        (["--model", "wrong.yaml"], "copper_lag_s is -1"),
        (["--model", "fast.yaml"], "'dead_time_s' is 0.5: the NMPC needs at least 0.9 s"),
        (["--model", "unknown.yaml"], "unknown"),
        (["--tuning", "wrong.yaml"], "copper_lag_s is an unknown key"),
        (["--parameter", "calmness=1e9"], "calmness"),
        (["--parameter", "calmness"], "NAME=VALUE"),
        (["--out", "full"], "full: holds something else"),
        (["--out", "full", "--force"], "full: holds something else"),
        (["--out", "nowhere/made"], "cannot write"),
        (
            ["--model", "strong.yaml"],
            "this model",
        ),  # nothing is usable, or with other versions a few proposals
        (["--model", "far.yaml"], "cannot weld with this model"),
    ],
)
def test_bad_input_is_one_line(arguments, words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "wrong.yaml").write_text("copper_lag_s: -1\n")
    (tmp_path / "fast.yaml").write_text("dead_time_s: 0.5\n")
    (tmp_path / "unknown.yaml").write_text("coper_lag_s: 1\n")
    (tmp_path / "far.yaml").write_text("operating_force_kn: 300.0\n")
    (tmp_path / "strong.yaml").write_text("thermal_gain_c_per_kw: 20000\n")
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "letter.txt").write_text("mine")
    before = sorted(tmp_path.rglob("*"))
    out = [] if "--out" in arguments else ["--out", "made"]
    assert main(["export", "c", *arguments, *out]) == 1
    line = capsys.readouterr().err.strip().splitlines()[-1]
    assert line.startswith("error: ")
    assert words in line
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.slow
@pytest.mark.full
def test_another_model_and_tuning(tmp_path):
    """The model's numbers are in the tables.

    An export again moves the one before aside, if it may.
    """
    (tmp_path / "model.yaml").write_text("dead_time_s: 1.83\ncopper_lag_s: 20.0\n")
    out = tmp_path / "made"
    command = [sys.executable, "-c", "import sys; from fsw.main import main; sys.exit(main())"]
    command += [
        "export",
        "c",
        "--model",
        "model.yaml",
        "--parameter",
        "depth_aggressiveness=0.5",
        "--out",
        out.name,
    ]
    for force, code in (([], 0), ([], 1), (["--force"], 0)):
        ran = subprocess.run(
            [*command, *force], cwd=tmp_path, capture_output=True, text=True, check=False
        )
        assert ran.returncode == code, ran.stderr
        assert code == 0 or "--force" in ran.stderr
    checks = [line for line in ran.stdout.splitlines() if line.endswith("difference 0: passed")]
    assert sorted(int(re.search(r"(\d+) ticks", line)[1]) for line in checks) == [600, 2400]
    assert ".dead_time_s = 1.83," in (out / "src" / "fsw_nmpc_tables.c").read_text()
    assert ".depth_time_s = 2.0," in (out / "src" / "fsw_nmpc_tables.c").read_text()


@pytest.mark.slow
def test_both_in_one_program_in_cpp(exported, objects, tmp_path):
    """The headers work in C++, the two controllers beside each other, and each knows what it was made from."""
    if shutil.which("g++") is None:
        pytest.skip("apt-get install g++")
    folders = [exported[name] / "src" for name in CONTROLLERS]
    (tmp_path / "both.cpp").write_text(
        '#include "fsw_nmpc_tables.h"\n#include "fsw_decentral_tables.h"\n#include <cstring>\n'
        "static fsw_nmpc a;\nstatic fsw_decentral b;\nint main() {\n"
        "  if (fsw_nmpc_init(&a, &fsw_nmpc_exported_model, &fsw_nmpc_exported_tuning)) return 1;\n"
        "  if (fsw_decentral_init(&b, &fsw_decentral_exported_tuning)) return 2;\n"
        "  fsw_nmpc_input in;\n  fsw_nmpc_output out;\n  fsw_nmpc_input_clear(&in);\n  fsw_nmpc_step(&a, &in, &out);\n"
        "  return out.healthy || std::strlen(fsw_nmpc_id()) != 16 || std::strlen(fsw_decentral_id()) != 16;\n}\n"
    )
    compiled = [path for name in CONTROLLERS for path in objects[name]]
    include = [option for folder in folders for option in ("-I", str(folder))]
    program = str(tmp_path / "both")
    subprocess.run(
        ["g++", *include, str(tmp_path / "both.cpp"), *compiled, "-o", program], check=True
    )
    assert subprocess.run([program], check=False).returncode == 0


@pytest.mark.slow
@pytest.mark.parametrize("controller", CONTROLLERS)
def test_fast_math_is_refused(exported, controller):
    folder = exported[controller] / "src"
    source = {"nmpc": "controller.c", "decentral": "decentral.c"}[controller]
    command = [*compiler(), "-std=c99", "-ffast-math", "-fsyntax-only", str(folder / source)]
    ran = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ran.returncode != 0
    assert "NaN" in ran.stderr


@pytest.mark.parametrize(
    "tuning",
    [
        "approach: {longest_lead_s: 29.0}",
        "approach: {beyond_bound_kw: 0.16}",
        "second_solve_distance: 0.6",
        "second_solve_iterations: 13",
    ],
)
def test_digest_of_an_export_has_the_whole_tuning(tmp_path, tuning):
    file = tmp_path / "tuning.yaml"
    file.write_text(tuning)
    changed = sources_of(NmpcController({"tuning_file": str(file)}))
    assert changed.digest != sources_of(NmpcController()).digest
