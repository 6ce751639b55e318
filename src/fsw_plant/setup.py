from setuptools import find_packages, setup

package_name = "fsw_plant"

setup(
    name=package_name,
    version="0.3.0",
    packages=find_packages(exclude=["test"]),
    package_data={package_name: ["*.yaml", "py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/" + package_name]),
        ("share/" + package_name, ["package.xml"]),
    ],
    extras_require={"test": ["pytest"]},
    entry_points={
        "console_scripts": ["plant = fsw_schema.entry:fsw_plant.plant_node.main"],
        "fsw.nodes": ["plant = fsw_plant.plant_node:main"],
    },
)
