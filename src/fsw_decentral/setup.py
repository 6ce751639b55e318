"""Ament package fsw_decentral."""

import sys
from pathlib import Path

from setuptools import Extension

WORKSPACE = Path(__file__).resolve().parents[2]
sys.path += [str(WORKSPACE / "scripts"), str(WORKSPACE / "src" / "fsw_control")]
from _ament import setup_package  # noqa: E402

from fsw_control.c_library import CLibrary  # noqa: E402

LIBRARY = CLibrary("fsw_decentral", Path("fsw_decentral", "kernel"))
setup_package(
    __file__, "*.yaml", "kernel/*.c", "kernel/*.h", ext_modules=[Extension(**LIBRARY.extension())]
)
