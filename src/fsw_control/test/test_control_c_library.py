"""Libraries in C: when one is built, found and taken.

Their structs and constants as the header has them.
"""

import os

import pytest

from fsw_control import c_library
from fsw_control.c_library import CLibrary

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

#ifdef __cplusplus
extern "C" {
#endif
#ifndef TOY_SIDE
#define TOY_SIDE 3       /* of the square */
#endif
#define TOY_SHARE 0.5
enum { TOY_MOST = 2 * TOY_SIDE };
#include "toy_reason.h"
typedef struct { int low[2][TOY_MOST]; double ratio, share; } toy_part; /* in one line */

typedef struct {
  toy_part part;         /* nested; with a semicolon; and a comma */
  const int *more;
} toy_data;
int toy_sum(const toy_data *d);
#ifdef __cplusplus
}
#endif
#endif
"""


@pytest.fixture
def toy(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    folder = tmp_path / "toy" / "kernel"
    folder.mkdir(parents=True)
    (folder / "toy.c").write_text(SOURCE, encoding="utf-8")
    (folder / "toy.h").write_text(HEADER, encoding="utf-8")
    (folder / "toy_reason.h").write_text(
        "typedef enum { TOY_NO_LUCK = 4, TOY_NONE = 1, TOY_NO_TIME = 2 } toy_reason;\n"
    )
    return CLibrary("toy", folder)


@pytest.mark.slow
def test_built_once_and_again_when_a_source_changes(toy, tmp_path):
    assert toy.find() is None
    built = toy.ensure()
    assert built.is_relative_to(tmp_path / "cache" / "toy")
    assert toy.is_usable(built) and toy.find() == built
    changed = built.stat().st_mtime_ns
    assert toy.ensure() == built and built.stat().st_mtime_ns == changed
    (toy.folder / "toy.h").write_text(HEADER.replace("3 ", "4 "), encoding="utf-8")
    assert toy.find() is None and not toy.is_usable(built)
    assert toy.ensure() not in (None, built)


@pytest.mark.slow
def test_a_library_in_the_package_is_used_if_its_sources_are_these(toy):
    packaged = toy.build(toy.folder.parent / "_kernel.abi3.so")
    assert toy.find() == packaged
    (toy.folder / "more.c").write_text("int more;\n", encoding="utf-8")
    assert toy.sources == ("more.c", "toy.c")
    assert toy.find() is None


def test_extension_arguments_for_setuptools(toy, monkeypatch):
    monkeypatch.chdir(toy.folder.parent)
    arguments = toy.extension()
    assert arguments["name"] == "toy._kernel" and arguments["optional"]
    assert arguments["sources"] == [os.path.join("kernel", "toy.c")]
    assert arguments["define_macros"] == [("TOY_ID", f'"{toy.source_id()}"')]


def test_missing_compiler_error_is_one_line_with_a_remedy(toy, monkeypatch):
    monkeypatch.setattr(c_library, "compiler", lambda: None)
    with pytest.raises(RuntimeError, match="C compiler") as raised:
        toy.ensure()
    assert "\n" not in str(raised.value) and "CC" in str(raised.value)


def test_a_compiler_that_fails_is_named(toy, monkeypatch):
    monkeypatch.setattr(c_library, "compiler", lambda: ["false"])
    with pytest.raises(RuntimeError, match="with false"):
        toy.build()
    assert toy.find() is None


def test_invalid_library_file_is_not_loaded(toy, tmp_path):
    (tmp_path / "broken.so").write_bytes(b"no library")
    assert not toy.is_usable(tmp_path / "broken.so")


def test_a_library_that_cannot_be_written_is_an_error(toy, monkeypatch, tmp_path):
    (tmp_path / "file").touch()
    monkeypatch.setattr(c_library, "compiler", lambda: ["cc"])
    with pytest.raises(RuntimeError, match="file"):
        toy.build(tmp_path / "file" / "library.so")


@pytest.mark.slow
def test_structs_and_functions_are_read_from_the_header(toy):
    hundred = toy.ffi.new("int *", 100)
    data = toy.new("toy_data", more=hundred)
    data.part.low[1] = list(range(6))
    assert toy.lib.toy_sum(data) == 115
    assert toy.lib.TOY_SIDE == 3 and toy.lib.TOY_MOST == 6


def test_an_enumeration_is_in_the_order_of_its_values(toy):
    assert [(reason.name, reason.value) for reason in toy.enum("toy_reason", "TOY_")] == [
        ("NONE", 1),
        ("NO_TIME", 2),
        ("NO_LUCK", 4),
    ]


def test_unknown_header_name_raises(toy):
    with pytest.raises(KeyError, match="colour"):
        toy.new("toy_data", colour=1)
