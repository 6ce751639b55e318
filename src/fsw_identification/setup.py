"""Ament package of the identification."""

from setuptools import find_packages, setup

package_name = "fsw_identification"

setup(
    name=package_name,
    version="0.1.0",
    packages=find_packages(exclude=["test"]),
    package_data={package_name: ["py.typed", "templates/*.j2"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{package_name}"]),
        (f"share/{package_name}", ["package.xml"]),
    ],
    install_requires=["setuptools"],
    zip_safe=False,
    maintainer="FSW Control maintainers",
    maintainer_email="maintainers@fsw-control.invalid",
    description="Parameters of the process model from recorded welds, with standard deviations",
    license="Apache-2.0",
    tests_require=["pytest"],
)
