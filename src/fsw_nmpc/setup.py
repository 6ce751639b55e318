from pathlib import Path
from runpy import run_path

from setuptools import Extension, find_packages, setup

package_name = "fsw_nmpc"
build = run_path(str(Path(package_name, "kernel_build.py")))

setup(
    name=package_name,
    version="0.1.0",
    packages=find_packages(exclude=["test"]),
    package_data={package_name: ["*.yaml", "py.typed", "kernel/*.c", "kernel/*.h"]},
    # The kernel is loaded with ctypes. It may fail to build here: then it is built at the first start.
    ext_modules=[
        Extension(
            "fsw_nmpc._kernel",
            [str(Path(package_name, "kernel", name)) for name in build["SOURCES"]],
            define_macros=[("FSW_CONTROLLER_ID", f'"{build["source_id"]()}"')],
            extra_compile_args=["-std=c99", "-O3", "-ffp-contract=off"],
            optional=True,
        )
    ],
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/" + package_name]),
        ("share/" + package_name, ["package.xml"]),
    ],
    install_requires=["setuptools"],
    zip_safe=False,
    maintainer="FSW Control maintainers",
    maintainer_email="maintainers@fsw-control.invalid",
    description="Nonlinear model predictive control of depth and temperature of the weld, in real time.",
    license="Apache-2.0",
    tests_require=["pytest"],
    entry_points={"console_scripts": ["nmpc = fsw_nmpc.nmpc_node:main"]},
)
