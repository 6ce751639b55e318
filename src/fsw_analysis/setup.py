"""Ament package of the analysis of recorded welds."""

from setuptools import find_packages, setup

package_name = "fsw_analysis"

setup(
    name=package_name,
    version="0.3.0",
    packages=find_packages(exclude=["test"]),
    package_data={package_name: ["py.typed", "rule_book.yaml"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{package_name}"]),
        (f"share/{package_name}", ["package.xml"]),
    ],
    extras_require={"test": ["pytest"]},
    entry_points={"fsw.schemas": ["procedure = fsw_analysis.procedure:Procedure"]},
)
