"""Ament package fsw_hmi."""

import sys
from pathlib import Path

import npm_packages
from setuptools.command.build_py import build_py

sys.path.append(str(Path(__file__).resolve().parents[2] / "scripts"))
from _ament import setup_package


class BuildPage(build_py):
    """Puts uPlot into the page before its files are copied."""

    def run(self):
        npm_packages.main()
        super().run()


setup_package(__file__, "*.yaml", "page/*", "page/uplot/*", cmdclass={"build_py": BuildPage})
