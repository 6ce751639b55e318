"""Ament package fsw_hmi."""

import runpy
from pathlib import Path

import npm_packages
from setuptools.command.build_py import build_py

COMMON = runpy.run_path(str(Path(__file__).resolve().parents[2] / "scripts/_ament_package.py"))


class BuildPage(build_py):
    """Puts uPlot into the page before its files are copied."""

    def run(self):
        npm_packages.main()
        super().run()


COMMON["set_up"](
    __file__, data=["*.yaml", "page/*", "page/uplot/*"], cmdclass={"build_py": BuildPage}
)
