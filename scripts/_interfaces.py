"""Builds interface packages (messages, services, actions) for the wheels of ROS 2.

usage: python _interfaces.py [--prefix FOLDER] PACKAGE_FOLDER ...

Calls rosidl's generators and the C++ compiler directly; CMake and colcon are not needed. Only what
rclpy and rmw_fastrtps_cpp load is built: Python classes, the C type support, and that of Fast DDS
with its introspection. The files are laid out as ``colcon build --merge-install`` does it.
``_bootstrap.py`` calls this.
"""

import argparse
import functools
import io
import os
import shlex
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from concurrent.futures import ThreadPoolExecutor
from contextlib import redirect_stdout
from pathlib import Path

KINDS = ("msg", "srv", "action")
#: libraries of a package, each after those that it needs
LIBRARIES = (
    "rosidl_generator_c",
    "rosidl_typesupport_fastrtps_c",
    "rosidl_typesupport_introspection_c",
    "rosidl_typesupport_c",
    "rosidl_generator_py",
)
SUPPORTS = LIBRARIES[1:3]
#: -O1: the code copies fields, and optimising it further takes time and gains nothing
FLAGS = ["-O1", "-fPIC", "-w", "-DNDEBUG"]


def compiler() -> list[str] | None:
    """Command of the C++ compiler: ``CXX``, or the first of c++, g++, clang++.

    None if there is none.
    """
    candidates = [shlex.split(os.environ.get("CXX", "")), ["c++"], ["g++"], ["clang++"]]
    return next((command for command in candidates if command and shutil.which(command[0])), None)


def python_headers() -> Path:
    """Folder of ``Python.h``; it need not exist."""
    return Path(sysconfig.get_paths()["include"])


def _generate(folder: Path, build: Path) -> None:
    """Write the sources of a package.

    ``build/idl``, one folder for each library, and ``build/python``.
    """
    from rosidl_parser import parser

    parser.parse_idl_file = functools.cache(
        parser.parse_idl_file
    )  # each generator would parse each file again
    from rosidl_adapter.action import convert_action_to_idl
    from rosidl_adapter.msg import convert_msg_to_idl
    from rosidl_adapter.srv import convert_srv_to_idl
    from rosidl_generator_c.cli import GenerateC
    from rosidl_generator_py.cli import GeneratePython
    from rosidl_generator_type_description.cli import HashTypeDescription
    from rosidl_typesupport_c.cli import GenerateCTypesupport
    from rosidl_typesupport_fastrtps_c.cli import GenerateFastRTPSCTypesupport
    from rosidl_typesupport_introspection_c.cli import GenerateIntrospectionCTypesupport

    name = folder.name
    converters = dict(
        zip(KINDS, (convert_msg_to_idl, convert_srv_to_idl, convert_action_to_idl), strict=True)
    )
    files = []
    for kind, convert in converters.items():
        for path in sorted((folder / kind).glob(f"*.{kind}")):
            convert(folder, name, path.relative_to(folder), build / "idl" / kind)
            files.append(f"{build / 'idl'}:{kind}/{path.stem}.idl")
            (build / "python" / name / kind).mkdir(parents=True, exist_ok=True)
    others = [Path(os.environ["AMENT_PREFIX_PATH"]) / "share"]
    hashes = HashTypeDescription("").generate_type_hashes(name, files, others, build / "idl")

    def write(library, generator, *more):
        generator.generate(name, files, others, build / library / name, *more)

    write("rosidl_generator_c", GenerateC(""), hashes)
    write("rosidl_typesupport_fastrtps_c", GenerateFastRTPSCTypesupport(""))
    write("rosidl_typesupport_introspection_c", GenerateIntrospectionCTypesupport(""))
    write(
        "rosidl_typesupport_c", GenerateCTypesupport("", typesupport_implementations=[*SUPPORTS])
    )
    write("python", GeneratePython("", typesupport_implementations=["rosidl_typesupport_c"]))
    (build / "python" / name / "__init__.py").touch()


def _run(command: list[str], cwd: Path) -> None:
    """Run a compiler; RuntimeError with its output if it fails."""
    ran = subprocess.run(
        command, cwd=cwd, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    if ran.returncode:
        raise RuntimeError(f"{shlex.join(command[:3])} ... failed:\n{ran.stdout[-3000:]}")


def _compile(library: str, build: Path, command: list[str], include: list[str]) -> None:
    """Compile the sources of a library into objects in ``build/objects/<library>``."""
    objects = build / "objects" / library
    objects.mkdir(parents=True)
    folder = build / ("python" if library == "rosidl_generator_py" else library)
    plain = [path for path in sorted(folder.rglob("*.c")) if ".ep." not in path.name]
    if plain:
        as_c = [
            word for path in plain for word in ("-x", "c", str(path))
        ]  # g++ takes "-x c" for the next file only
        _run([*command, *FLAGS, *include, "-c", *as_c], objects)
    plus = sorted(folder.rglob("*.cpp"))
    if plus:  # in one unit: their headers take nearly all of the time
        everything = objects / "all.cpp"
        everything.write_text("".join(f'#include "{path}"\n' for path in plus), encoding="utf-8")
        _run([*command, "-std=c++17", *FLAGS, *include, "-c", everything.name], objects)


def _link(name: str, build: Path, command: list[str], include: list[str], prefix: Path) -> None:
    """Make the libraries and the extension module from the objects."""
    libraries = build / "lib"
    libraries.mkdir()
    others = sorted(
        {
            path.name.removeprefix("lib").removesuffix(".so")
            for path in (prefix / "lib").glob("lib*.so")
        }
    )
    others = [
        other
        for other in others
        if not other.startswith(f"{name}__") and not other.endswith("_cpp")
    ]
    others = [
        other for other in others if "rosidl" in other or other in ("fastcdr", "rcutils", "rmw")
    ]
    end = [f"-L{libraries}", f"-L{prefix / 'lib'}", "-Wl,--as-needed"]
    end += [f"-l{other}" for other in ["rosidl_typesupport_fastrtps_cpp", *others]]
    own: list[str] = []
    for library in LIBRARIES:
        target = f"{name}__{library}"
        made = [*command, "-shared", "-s", "-Wl,-rpath,$ORIGIN", f"-Wl,-soname,lib{target}.so"]
        objects = map(str, (build / "objects" / library).glob("*.o"))
        _run([*made, "-o", str(libraries / f"lib{target}.so"), *objects, *own, *end], build)
        own = [f"-l{target}", *own]
    package = build / "python" / name
    entry = package / f"_{name}_s.ep.rosidl_typesupport_c.c"
    extension = package / f"{name}_s__rosidl_typesupport_c.so"
    made = [*command, *FLAGS, *include, "-shared", "-s", "-Wl,-rpath,$ORIGIN/../../.."]
    _run(
        [
            *made,
            "-x",
            "c",
            str(entry),
            "-x",
            "none",
            "-o",
            str(extension),
            *end[:2],
            *own,
            *end[2:],
        ],
        build,
    )


def _install(folder: Path, build: Path, prefix: Path) -> None:
    """Copy what is needed at run time."""
    name = folder.name
    site = prefix / "lib" / f"python{sys.version_info[0]}.{sys.version_info[1]}" / "site-packages"
    share = prefix / "share" / name
    shutil.rmtree(share, ignore_errors=True)
    new, old = site / f".{name}.new", site / f".{name}.old"
    for left in (new, old):  # by one that was interrupted
        shutil.rmtree(left, ignore_errors=True)
    shutil.copytree(build / "python" / name, new, ignore=shutil.ignore_patterns("*.c"))
    if (site / name).exists():
        os.replace(site / name, old)  # nodes that start meanwhile find one of both
    os.replace(new, site / name)
    shutil.rmtree(old, ignore_errors=True)
    (prefix / "lib").mkdir(parents=True, exist_ok=True)
    for library in (build / "lib").iterdir():
        shutil.copy(library, prefix / "lib" / f".{library.name}")
        os.replace(
            prefix / "lib" / f".{library.name}", prefix / "lib" / library.name
        )  # running nodes keep theirs
    for kind in KINDS:
        if (folder / kind).is_dir():
            shutil.copytree(folder / kind, share / kind)
            shutil.copytree(build / "idl" / kind, share / kind, dirs_exist_ok=True)
    for index in ("packages", "rosidl_interfaces"):
        resources = prefix / "share" / "ament_index" / "resource_index" / index
        resources.mkdir(parents=True, exist_ok=True)
        defined = sorted(
            f"{path.parent.name}/{path.name}" for kind in KINDS for path in share.glob(f"{kind}/*")
        )
        (resources / name).write_text("\n".join(defined) if index == "rosidl_interfaces" else "")


def build_package(folder: Path, into: Path) -> None:
    """Build the interface package in a folder that has its name.

    Parameters
    ----------
    folder : Path
        Holds ``msg``, ``srv`` and ``action``.
    into : Path
        Prefix of the installation, as ``sys.prefix`` or that of a colcon workspace.

    Raises
    ------
    RuntimeError
        If there is no definition, one is wrong, there is no compiler, or it fails.
    """
    if not any(path for kind in KINDS for path in folder.glob(f"{kind}/*.{kind}")):
        raise RuntimeError(f"{folder} defines no messages, services or actions")
    command = compiler()
    if command is None:
        raise RuntimeError("no C++ compiler")
    import numpy

    wheels = Path(sys.prefix)
    os.environ["AMENT_PREFIX_PATH"] = str(wheels)  # the generators find their templates by it
    with tempfile.TemporaryDirectory() as scratch:
        build = Path(scratch)
        try:
            with redirect_stdout(io.StringIO()):
                _generate(folder, build)
        except Exception as error:  # rosidl has no common one
            raise RuntimeError(f"{folder.name}: {error}") from error
        folders = [
            *(build / library for library in (*LIBRARIES[:4], "python")),
            wheels / "include",
        ]
        folders += [path for path in (wheels / "include").iterdir() if path.is_dir()]
        include = [f"-I{path}" for path in [*folders, python_headers(), numpy.get_include()]]
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            for _ in pool.map(
                lambda library: _compile(library, build, command, include), LIBRARIES
            ):
                print(".", end="", flush=True)
        _link(folder.name, build, command, include, wheels)
        _install(folder, build, into)


def main() -> int:
    """Build the packages that the command line names; returns the exit code."""
    cli = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    cli.add_argument(
        "--prefix", type=Path, default=Path(sys.prefix), help="folder (default: this environment)"
    )
    cli.add_argument("folders", type=Path, nargs="+", metavar="PACKAGE_FOLDER")
    arguments = cli.parse_args()
    for folder in arguments.folders:
        try:
            build_package(folder.resolve(), arguments.prefix.resolve())
        except RuntimeError as error:
            print(error, file=sys.stderr)
            return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
