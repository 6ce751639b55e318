"""Ament package of the identification."""

from setuptools import find_packages, setup

package_name = "fsw_identification"

setup(
    name=package_name,
    version="0.3.0",
    packages=find_packages(exclude=["test"]),
    package_data={package_name: ["py.typed", "templates/*.j2"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{package_name}"]),
        (f"share/{package_name}", ["package.xml"]),
    ],
    extras_require={"test": ["pytest"]},
)
