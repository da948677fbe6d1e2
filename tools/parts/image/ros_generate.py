# SPDX-License-Identifier: GPL-2.0-or-later
"""Sources of a package of messages for rclpy: ros_generate.py FOLDER; FOLDER/msg has the .msg files, and FOLDER's name
is that of the package. Runs with the Python of tools/parts/image/peers.py; `rosidl generate` needs CMake."""
from __future__ import annotations

import importlib
import pathlib
import sys
import types
from typing import Any


def module(name: str) -> Any:
    return importlib.import_module(name)


def main() -> None:
    folder = pathlib.Path(sys.argv[1])
    # The converter of messages imports it to look for services' packages.
    package: Any = types.ModuleType("catkin_pkg.package")
    package.package_exists_at = package.parse_package = None
    sys.modules |= {"catkin_pkg": types.ModuleType("catkin_pkg"), "catkin_pkg.package": package}
    convert = module("rosidl_adapter.msg").convert_msg_to_idl
    for path in sorted((folder / "msg").glob("*.msg")):
        convert(folder, folder.name, pathlib.Path("msg") / path.name, folder / "msg")
    idl = [f"{folder}:msg/{path.name}" for path in sorted((folder / "msg").glob("*.idl"))]
    common = (folder.name, idl, [f"{sys.prefix}/share"], folder)
    hashes = module("rosidl_generator_type_description.cli").HashTypeDescription("").generate_type_hashes(*common)
    module("rosidl_generator_c.cli").GenerateC("").generate(*common, hashes)
    module("rosidl_typesupport_fastrtps_c.cli").GenerateFastRTPSCTypesupport("").generate(*common)
    module("rosidl_typesupport_introspection_c.cli").GenerateIntrospectionCTypesupport("").generate(*common)
    module("rosidl_typesupport_c.cli").GenerateCTypesupport("", typesupport_implementations=[
        "rosidl_typesupport_fastrtps_c", "rosidl_typesupport_introspection_c"]).generate(*common)
    module("rosidl_generator_py.cli").GeneratePython(
        "", typesupport_implementations=["rosidl_typesupport_c"]).generate(*common)


main()
