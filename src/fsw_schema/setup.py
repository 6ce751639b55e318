from setuptools import find_packages, setup

package_name = "fsw_schema"

setup(
    name=package_name,
    version="0.1.0",
    packages=find_packages(exclude=["test"]),
    package_data={package_name: ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/" + package_name]),
        ("share/" + package_name, ["package.xml"]),
    ],
    install_requires=["setuptools"],
    zip_safe=False,
    maintainer="FSW Control maintainers",
    maintainer_email="maintainers@fsw-control.invalid",
    description="What people write in files and requests: its schema, ranges and YAML.",
    license="Apache-2.0",
    tests_require=["pytest"],
)
