"""Ament package of the recorder, the replayer and the bag tools."""

from setuptools import find_packages, setup

package_name = "fsw_recorder"

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
        "console_scripts": [
            "recorder = fsw_control.schema.entry:fsw_recorder.recorder_node.main",
            "replay = fsw_control.schema.entry:fsw_recorder.replay_node.main",
        ],
        "fsw.nodes": [
            "recorder = fsw_recorder.recorder_node:main",
            "replay = fsw_recorder.replay_node:main",
        ],
        "fsw.schemas": [
            "manifest = fsw_recorder.manifest:Manifest",
            "parameters-recorder = fsw_recorder.parameters:RecorderParameters",
            "parameters-replay = fsw_recorder.parameters:ReplayParameters",
        ],
    },
)
