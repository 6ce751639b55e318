import npm_packages
from setuptools import find_packages, setup
from setuptools.command.build_py import build_py

package_name = "fsw_hmi"


class BuildPage(build_py):
    """Puts uPlot into the page before its files are copied."""

    def run(self):
        npm_packages.main()
        super().run()


setup(
    name=package_name,
    version="0.3.0",
    packages=find_packages(exclude=["test"]),
    package_data={package_name: ["*.yaml", "py.typed", "page/*", "page/uplot/*"]},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/" + package_name]),
        ("share/" + package_name, ["package.xml"]),
    ],
    cmdclass={"build_py": BuildPage},
    extras_require={"test": ["pytest"]},
    entry_points={
        "console_scripts": ["hmi = fsw_control.schema.entry:fsw_hmi.main.main"],
        "fsw.schemas": ["parameters-hmi = fsw_hmi.parameters:HmiParameters"],
        "fsw.nodes": ["hmi = fsw_hmi.main:main"],
    },
)
