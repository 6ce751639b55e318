"""Ament package of the experiments."""

from setuptools import find_packages, setup

package_name = "fsw_experiment"

setup(
    name=package_name,
    version="0.1.0",
    packages=find_packages(exclude=["test"]),
    package_data={package_name: ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{package_name}"]),
        (f"share/{package_name}", ["package.xml"]),
    ],
    install_requires=["setuptools"],
    zip_safe=False,
    maintainer="FSW Control maintainers",
    maintainer_email="maintainers@fsw-control.invalid",
    description="Weld experiments as scenarios, run in one process or in the graph; figures of merit and figures",
    license="Apache-2.0",
    tests_require=["pytest"],
    entry_points={
        "console_scripts": [
            "fsw = fsw_experiment.cli.main:main",
        ]
    },
)
