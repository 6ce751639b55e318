from setuptools import find_packages, setup

package_name = "fsw_control"

setup(
    name=package_name,
    version="0.3.0",
    packages=find_packages(exclude=["test"]),
    package_data={package_name: ["*.xml", "py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/" + package_name]),
        ("share/" + package_name, ["package.xml"]),
    ],
    extras_require={"test": ["pytest"]},
    entry_points={
        "fsw.schemas": [
            "footprint = fsw_control.depth_footprint:Footprint",
            "parameters-controller = fsw_control.common_parameters:ControllerParameters",
        ]
    },
)
