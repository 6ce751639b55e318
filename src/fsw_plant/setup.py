import sys
from pathlib import Path

from setuptools import Extension, find_packages, setup

package_name = "fsw_plant"
sys.path.append(
    str(Path(__file__).resolve().parents[1] / "fsw_control")
)  # in the workspace; elsewhere it is installed
from fsw_control.c_library import CLibrary  # noqa: E402

setup(
    name=package_name,
    version="0.3.0",
    packages=find_packages(exclude=["test"]),
    package_data={package_name: ["py.typed", "kernel/*.c", "kernel/*.h"]},
    ext_modules=[Extension(**CLibrary(package_name, Path(package_name, "kernel")).extension())],
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/" + package_name]),
        ("share/" + package_name, ["package.xml"]),
    ],
    extras_require={"test": ["pytest"]},
    entry_points={
        "console_scripts": ["plant = fsw_control.schema.entry:fsw_plant.plant_node.main"],
        "fsw.schemas": ["parameters-plant = fsw_plant.parameters:PlantParameters"],
        "fsw.nodes": ["plant = fsw_plant.plant_node:main"],
    },
)
