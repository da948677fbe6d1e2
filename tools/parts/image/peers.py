# SPDX-License-Identifier: GPL-2.0-or-later
"""Programs of others that talk to the catalog in tests: ROS 2, a tool of DDS, and what hashes types as ROS does.

PyPI has ROS 2 without a ROS installation. It finds its libraries beside its Python, so it needs an environment of its
own.
"""
import pathlib
from collections.abc import Mapping

from parts.common import TOP, fingerprint, run
from parts.image import foreign

PACKAGES = TOP / "tools/peer-packages.txt"


def make(tree: pathlib.Path) -> None:
    run(["/usr/bin/python3", "-m", "venv", tree])
    run([tree / "bin/python", "-m", "pip", "--quiet", "--disable-pip-version-check", "install", "--no-deps",
         "--no-build-isolation", "--require-hashes", "--requirement", PACKAGES])


def peers() -> pathlib.Path:
    """The environment: bin/python, bin/cyclonedds. The network is needed the first time only."""
    return foreign.kept("peers", fingerprint([PACKAGES, pathlib.Path(__file__)]), make)


GENERATE = pathlib.Path(__file__).with_name("ros_generate.py")
# Libraries of ROS that a package's library is linked with.
LIBRARIES = ["std_msgs__rosidl_generator_c", "std_msgs__rosidl_generator_py", "std_msgs__rosidl_typesupport_c",
             "std_msgs__rosidl_typesupport_fastrtps_c", "std_msgs__rosidl_typesupport_introspection_c",
             "builtin_interfaces__rosidl_generator_c", "rosidl_runtime_c", "rosidl_typesupport_c",
             "rosidl_typesupport_fastrtps_c", "rosidl_typesupport_fastrtps_cpp", "rosidl_typesupport_introspection_c",
             "fastcdr", "rcutils", "stdc++"]


def ros_package(name: str, messages: Mapping[str, str]) -> pathlib.Path:
    """A package of messages, text by name, for rclpy: a folder for PYTHONPATH and LD_LIBRARY_PATH."""
    others = peers()

    def make(tree: pathlib.Path) -> None:
        package = tree / name
        (package / "msg").mkdir(parents=True)
        (package / "__init__.py").touch()
        for message, text in messages.items():
            (package / f"msg/{message}.msg").write_text(text)
        run([others / "bin/python", GENERATE, package], env={"AMENT_PREFIX_PATH": str(others)})
        headers = [others / "include", *sorted((others / "include").iterdir()), "/usr/include/python3.11",
                   next(others.glob("lib/python*/site-packages/numpy/_core/include")), tree]
        library = f"{name}_s__rosidl_typesupport_c.so"
        run(["gcc", "-shared", "-fPIC", "-w", *(f"-I{folder}" for folder in headers),
             *sorted(package.rglob("*.c")), *sorted(package.rglob("*.cpp")), "-o", package / library,
             f"-L{others}/lib", f"-Wl,-rpath,{others}/lib", *(f"-l{one}" for one in LIBRARIES)])
        for kind in ("fastrtps", "introspection"):
            (tree / f"lib{name}__rosidl_typesupport_{kind}_c.so").symlink_to(f"{name}/{library}")

    key = fingerprint([PACKAGES, pathlib.Path(__file__), GENERATE], name, repr(sorted(messages.items())))
    return foreign.kept("ros-package", key, make)
