"""Packaging of fsw_supervisor for colcon."""

from setuptools import setup

PACKAGE = "fsw_supervisor"

setup(
    name=PACKAGE,
    version="0.3.0",
    packages=[PACKAGE],
    package_data={PACKAGE: ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
    ],
    extras_require={"test": ["pytest"]},
    entry_points={
        "console_scripts": [
            "supervisor = fsw_control.schema.entry:fsw_supervisor.supervisor_node.main"
        ],
        "fsw.schemas": ["parameters-supervisor = fsw_supervisor.parameters:SupervisorParameters"],
        "fsw.nodes": ["supervisor = fsw_supervisor.supervisor_node:main"],
    },
)
