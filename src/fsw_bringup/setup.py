"""Ament package of the launch files."""

from glob import glob

from setuptools import setup

package_name = "fsw_bringup"

setup(
    name=package_name,
    version="0.3.0",
    packages=[],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{package_name}"]),
        (f"share/{package_name}", ["package.xml"]),
        (f"share/{package_name}/launch", sorted(glob("launch/*.launch.py"))),
        (f"share/{package_name}/config", sorted(glob("config/*"))),
    ],
    extras_require={"test": ["pytest"]},
)
