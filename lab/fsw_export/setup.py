from setuptools import find_packages, setup

package_name = "fsw_export"

setup(
    name=package_name,
    version="0.3.0",
    packages=find_packages(exclude=["test"]),
    package_data={
        package_name: ["py.typed", "targets.json", "c/*", "c/cortex_m7/*", "fmi/*", "templates/*"]
    },
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/" + package_name]),
        ("share/" + package_name, ["package.xml"]),
    ],
    extras_require={"test": ["pytest"]},
)
