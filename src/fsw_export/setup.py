from setuptools import find_packages, setup

package_name = "fsw_export"

setup(
    name=package_name,
    version="0.1.0",
    packages=find_packages(exclude=["test"]),
    package_data={package_name: ["py.typed", "targets.json", "c/*", "c/cortex_m7/*", "fmi/*", "templates/*"]},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/" + package_name]),
        ("share/" + package_name, ["package.xml"]),
    ],
    install_requires=["setuptools"],
    zip_safe=False,
    maintainer="FSW Control maintainers",
    maintainer_email="maintainers@fsw-control.invalid",
    description="Controllers and plant for use outside ROS 2: C99 for a PLC, FMUs.",
    license="Apache-2.0",
    tests_require=["pytest"],
)
