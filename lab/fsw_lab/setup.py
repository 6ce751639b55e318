"""Ament package fsw_lab."""

from setuptools import find_packages, setup

package_name = "fsw_lab"

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
        "fsw.commands": [
            "bag.replay = fsw_lab.bag_replay",
            "campaign = fsw_lab.campaign_command",
            "canister = fsw_lab.canister",
            "commission = fsw_lab.commission",
            "export = fsw_lab.export_command",
            "identify = fsw_lab.identify_command",
            "learn = fsw_lab.learn_command",
            "tune = fsw_lab.tune_command",
        ],
        "fsw.api": [
            "Identified = fsw_lab.identify:Identified",
            "campaign = fsw_lab.tasks:campaign",
            "export_c = fsw_lab.tasks:export_c",
            "export_fmu = fsw_lab.tasks:export_fmu",
            "identify = fsw_lab.identify:identify",
            "read_table = fsw_lab.identify:read_table",
            "tune = fsw_lab.tasks:tune",
        ],
    },
)
