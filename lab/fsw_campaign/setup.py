"""Ament package of the campaigns."""

from setuptools import find_packages, setup

package_name = "fsw_campaign"

setup(
    name=package_name,
    version="0.3.0",
    packages=find_packages(exclude=["test"]),
    package_data={package_name: ["*.yaml", "campaigns/*.yaml", "templates/*.j2", "py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{package_name}"]),
        (f"share/{package_name}", ["package.xml"]),
    ],
    extras_require={"test": ["pytest"]},
    entry_points={"fsw.schemas": ["campaign = fsw_campaign.definition:Campaign"]},
)
