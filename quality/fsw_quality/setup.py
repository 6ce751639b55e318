"""Ament package of the record of a weld."""

from setuptools import find_packages, setup

package_name = "fsw_quality"

setup(
    name=package_name,
    version="0.3.0",
    packages=find_packages(exclude=["test"]),
    package_data={package_name: ["*.yaml", "py.typed", "templates/*.j2"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{package_name}"]),
        (f"share/{package_name}", ["package.xml"]),
    ],
    extras_require={"test": ["pytest"]},
    entry_points={
        "console_scripts": ["monitor = fsw_control.schema.entry:fsw_quality.monitor_node.main"],
        "fsw.commands": [
            "bag.evidence = fsw_quality.commands.bag_evidence",
            "history = fsw_quality.commands.history",
            "monitor = fsw_quality.commands.monitor",
            "procedure = fsw_quality.commands.procedure",
            "record = fsw_quality.commands.record_command",
        ],
        "fsw.nodes": ["monitor = fsw_quality.monitor_node:main"],
        "fsw.pages": ["history = fsw_quality.record_hook:history_page"],
        "fsw.record_hooks": ["record = fsw_quality.record_hook:command"],
        "fsw.api": ["record = fsw_quality.api:record"],
        "fsw.schemas": [
            "attestation = fsw_quality.attestation:Attestation",
            "parameters-monitor = fsw_quality.parameters:MonitorParameters",
            "record = fsw_quality.record:Record",
        ],
    },
)
