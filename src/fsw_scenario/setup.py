"""Ament package of the scenarios."""

from setuptools import find_packages, setup

package_name = "fsw_scenario"

setup(
    name=package_name,
    version="0.3.0",
    packages=find_packages(exclude=["test"]),
    package_data={
        package_name: [
            "scenarios/*.yaml",
            "procedures/*.yaml",
            "py.typed",
        ]
    },
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{package_name}"]),
        (f"share/{package_name}", ["package.xml"]),
    ],
    extras_require={"test": ["pytest"]},
    entry_points={
        "console_scripts": [
            "scenario = fsw_control.schema.entry:fsw_scenario.scenario_node.main",
            "controller = fsw_control.schema.entry:fsw_scenario.controller_node.main",
            "open_loop = fsw_control.schema.entry:fsw_scenario.controller_node.open_loop",
            "procedure = fsw_control.schema.entry:fsw_scenario.procedure_node.main",
        ],
        "fsw.nodes": [
            "controller = fsw_scenario.controller_node:main",
            "open_loop = fsw_scenario.controller_node:open_loop",
            "procedure = fsw_scenario.procedure_node:main",
            "scenario = fsw_scenario.scenario_node:main",
        ],
        "fsw.schemas": [
            "parameters-open-loop = fsw_scenario.parameters:OpenLoopParameters",
            "parameters-procedure = fsw_scenario.parameters:ProcedureParameters",
            "parameters-scenario = fsw_scenario.parameters:PlayerParameters",
            "scenario = fsw_scenario.scenario:Scenario",
        ],
    },
)
