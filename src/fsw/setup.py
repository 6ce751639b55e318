"""Ament package of the command line and the launch files."""

from glob import glob

from setuptools import find_packages, setup

package_name = "fsw"

setup(
    name=package_name,
    version="0.3.0",
    packages=find_packages(exclude=["test"]),
    package_data={package_name: ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{package_name}"]),
        (f"share/{package_name}", ["package.xml"]),
        (f"share/{package_name}/launch", sorted(glob("launch/*.launch.py"))),
        (f"share/{package_name}/config", sorted(glob("config/*"))),
    ],
    extras_require={"test": ["pytest"]},
    entry_points={
        "console_scripts": ["fsw = fsw.__main__:main"],
        "fsw.commands": [
            "acknowledge = fsw.graph",
            "bag = fsw.bags",
            "bag.export = fsw.bag_weld",
            "bag.info = fsw.bag_info",
            "bag.kpi = fsw.bag_weld",
            "bag.plot = fsw.bag_weld",
            "bag.recover = fsw.bag_info",
            "completion = fsw.completion",
            "controllers = fsw.graph",
            "demo = fsw.demo",
            "disturb = fsw.graph",
            "fault = fsw.graph",
            "footprint = fsw.footprint_command",
            "hmi = fsw.hmi",
            "lifecycle = fsw.graph",
            "mode = fsw.graph",
            "node = fsw.node",
            "param = fsw.graph",
            "reference = fsw.graph",
            "schema = fsw.schema_command",
            "simulate = fsw.simulate_command",
            "status = fsw.graph",
            "switch = fsw.graph",
            "weld = fsw.graph",
        ],
    },
)
