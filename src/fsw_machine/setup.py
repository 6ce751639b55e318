from setuptools import find_packages, setup

package_name = "fsw_machine"

setup(
    name=package_name,
    version="0.3.0",
    packages=find_packages(exclude=["test"]),
    package_data={package_name: ["*.yaml", "py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/" + package_name]),
        ("share/" + package_name, ["package.xml"]),
    ],
    extras_require={"test": ["pytest"]},
    entry_points={
        "console_scripts": ["machine = fsw_control.schema.entry:fsw_machine.machine_node.main"],
        "fsw.nodes": ["machine = fsw_machine.machine_node:main"],
        "fsw.schemas": [
            "machine = fsw_machine.machine_file:MachineFile",
            "parameters-machine = fsw_machine.parameters:GatewayParameters",
        ],
    },
)
