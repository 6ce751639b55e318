"""Libraries in C: when one is built, found and taken; their structs as the header has them."""

import ctypes
import os
from dataclasses import replace

import pytest

from fsw_control import c_library
from fsw_control.c_library import CLibrary
from fsw_control.c_structs import Header

SOURCE = """
#include "toy.h"
const char *toy_id(void) { return TOY_ID; }
int toy_sum(const toy_data *d) {
  int sum = *d->more;
  for (int i = 0; i < TOY_MOST; i++) sum += d->part.low[1][i];
  return sum;
}
"""
HEADER = """
#ifndef TOY_H
#define TOY_H

#define TOY_SIDE 3       /* of the square */
#define TOY_MOST (2 * TOY_SIDE)
typedef struct { int low[2][TOY_MOST]; double ratio, share; } toy_part; /* in one line */

typedef struct {
  toy_part part;         /* nested; with a semicolon; and a comma */
  const int *more;
  toy_hidden hidden;
  int last;
} toy_data;
#endif
"""


@pytest.fixture
def toy(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    folder = tmp_path / "toy" / "kernel"
    folder.mkdir(parents=True)
    (folder / "toy.c").write_text(SOURCE, encoding="utf-8")
    (folder / "toy.h").write_text(HEADER.replace("  toy_hidden hidden;\n", ""), encoding="utf-8")
    return CLibrary("toy", folder, "toy_id")


@pytest.mark.slow
def test_built_once_and_again_when_a_source_changes(toy, tmp_path):
    assert toy.find() is None
    built = toy.ensure()
    assert built.is_relative_to(tmp_path / "cache" / "toy")
    assert toy.is_usable(built) and toy.find() == built
    changed = built.stat().st_mtime_ns
    assert toy.ensure() == built and built.stat().st_mtime_ns == changed
    (toy.folder / "toy.h").write_text(
        HEADER.replace("  toy_hidden hidden;\n", "").replace("3 ", "4 "), encoding="utf-8"
    )
    assert toy.find() is None and not toy.is_usable(built)
    assert toy.ensure() not in (None, built)


@pytest.mark.slow
def test_a_library_in_the_package_is_used_if_its_sources_are_these(toy):
    packaged = toy.build(toy.folder.parent / "_kernel.abi3.so", native=False)
    assert toy.find() == packaged
    assert replace(toy, identify="other_id").find() is None
    (toy.folder / "more.c").write_text("int more;\n", encoding="utf-8")
    assert toy.sources == ("more.c", "toy.c")
    assert toy.find() is None


def test_what_setup_py_is_given(toy, monkeypatch):
    monkeypatch.chdir(toy.folder.parent)
    given = toy.extension()
    assert given["name"] == "toy._kernel" and given["optional"]
    assert given["sources"] == [os.path.join("kernel", "toy.c")]
    assert given["define_macros"] == [("TOY_ID", f'"{toy.source_id()}"')]


def test_without_a_compiler_one_line_says_what_to_do(toy, monkeypatch, capsys):
    monkeypatch.setattr(c_library, "compiler", lambda: None)
    assert toy.main() == 1
    assert capsys.readouterr().err == "no C compiler found: install one, set CC, or 'pip install ziglang'\n"


def test_without_a_place_for_it_one_line_says_what_to_do(toy, monkeypatch, tmp_path):
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    monkeypatch.setattr(c_library, "compiler", lambda: ["cc"])
    with pytest.raises(RuntimeError, match=r"no place for the kernel's library: .* \(set XDG_CACHE_HOME\)"):
        toy.build()


@pytest.mark.slow
def test_structs_are_read_from_the_header(toy):
    header = Header(toy.folder / "toy.h")

    @header.struct("toy_part")
    class Part(ctypes.Structure):
        pass

    @header.struct("toy_data")
    class Data(ctypes.Structure):
        pass

    assert header.size("TOY_MOST") == 6 and header.defined["TOY_SIDE"] == "3"
    assert [name for name, *_ in Part._fields_] == ["low", "ratio", "share"]
    data = Data(more=ctypes.pointer(ctypes.c_int(100)))
    data.part.low[1][:] = range(6)
    assert ctypes.CDLL(str(toy.ensure())).toy_sum(ctypes.byref(data)) == 115


def test_fields_end_before_a_struct_that_is_not_known(tmp_path):
    (tmp_path / "toy.h").write_text(HEADER, encoding="utf-8")
    header = Header(tmp_path / "toy.h")
    header.struct("toy_part")(type("Part", (ctypes.Structure,), {}))
    data = header.struct("toy_data")(type("Data", (ctypes.Structure,), {}))
    assert [name for name, *_ in data._fields_] == ["part", "more"]


def test_a_declaration_that_cannot_be_read_is_named(tmp_path):
    (tmp_path / "bad.h").write_text("typedef struct { int; } bad;\n", encoding="utf-8")
    with pytest.raises(ValueError, match=r"bad\.h: cannot read 'int' of bad"):
        Header(tmp_path / "bad.h").struct("bad")(type("Bad", (ctypes.Structure,), {}))
