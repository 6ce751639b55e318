"""Packaging of fsw_supervisor for colcon."""

from setuptools import setup

PACKAGE = "fsw_supervisor"

setup(
    name=PACKAGE,
    version="0.1.0",
    packages=[PACKAGE],
    package_data={PACKAGE: ["*.yaml", "py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
    ],
    install_requires=["setuptools"],
    zip_safe=True,
    maintainer="FSW Control maintainers",
    maintainer_email="maintainers@fsw-control.invalid",
    description="The arbiter: the only writer of /fsw/command; checks, swaps and replaces controllers.",
    license="Apache-2.0",
    tests_require=["pytest"],
    entry_points={"console_scripts": [f"supervisor = {PACKAGE}.supervisor_node:main"]},
)
