"""Ament package of the welding procedure and the record of a weld."""

from setuptools import find_packages, setup

package_name = "fsw_quality"

setup(
    name=package_name,
    version="0.3.0",
    packages=find_packages(exclude=["test"]),
    package_data={package_name: ["*.yaml", "py.typed", "procedures/*.yaml", "templates/*.j2"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{package_name}"]),
        (f"share/{package_name}", ["package.xml"]),
    ],
    extras_require={"test": ["pytest"]},
    entry_points={
        "console_scripts": [
            "monitor = fsw_schema.entry:fsw_quality.monitor_node.main",
            "procedure = fsw_schema.entry:fsw_quality.procedure_node.main",
        ]
    },
)
