"""Ament package fsw_heat."""

from setuptools import find_packages, setup

package_name = "fsw_heat"

setup(
    name=package_name,
    version="0.3.0",
    packages=find_packages(exclude=["test"]),
    package_data={package_name: ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{package_name}"]),
        (f"share/{package_name}", ["package.xml"]),
    ],
    extras_require={"test": ["pytest"]},
    entry_points={
        "fsw.processes": ["canister = fsw_heat:load_or_compact"],
    },
)
