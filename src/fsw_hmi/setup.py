from setuptools import find_packages, setup

package_name = "fsw_hmi"

setup(
    name=package_name,
    version="0.3.0",
    packages=find_packages(exclude=["test"]),
    package_data={package_name: ["*.yaml", "package*.json", "py.typed", "page/*"]},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/" + package_name]),
        ("share/" + package_name, ["package.xml"]),
    ],
    extras_require={"test": ["pytest"]},
    entry_points={
        "console_scripts": ["hmi = fsw_control.schema.entry:fsw_hmi.main.main"],
        "fsw.schemas": ["parameters-hmi = fsw_hmi.parameters:HmiParameters"],
        "fsw.nodes": ["hmi = fsw_hmi.main:main"],
    },
)
