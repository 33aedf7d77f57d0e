"""The package of `swath ros2 package`, built by rosidl's own generators and a C compiler, no colcon."""

import contextlib
import importlib
import inspect
import io
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

from rosidl_adapter.msg import convert_msg_to_idl
from rosidl_generator_type_description.cli import HashTypeDescription

PREFIX = Path(sys.prefix)
NEEDED = ("std_msgs", "geometry_msgs", "builtin_interfaces")
C, PYTHON = "rosidl_generator_c", "rosidl_generator_py"
TYPE_SUPPORTS = ("fastrtps_c", "introspection_c")
SUPPORT_LIBRARIES = {
    "fastrtps_c": ("rosidl_typesupport_fastrtps_c", "rosidl_typesupport_fastrtps_cpp", "fastcdr", "rmw"),
    "introspection_c": ("rosidl_typesupport_introspection_c",),
}


def build(package: Path, out: Path, compiled: set[str]) -> dict[str, str]:
    """Read every message of a package as rosidl does, compile some; environment variables that offer them."""
    name = package.name
    idl = out / "idl" / "msg"
    idl.mkdir(parents=True)
    with contextlib.redirect_stdout(io.StringIO()):
        for file in sorted((package / "msg").glob("*.msg")):
            convert_msg_to_idl(package, name, Path("msg") / file.name, idl)
        what = {
            "package_name": name,
            "interface_files": [f"{out}/idl:msg/{file.name}" for file in sorted(idl.glob("*.idl"))],
            "include_paths": [str(PREFIX / "share")],
        }
        found = HashTypeDescription.generate_type_hashes(None, **what, output_path=out / "hash")
        hashes = [str(file) for file in found if Path(file).stem in compiled]
        what["interface_files"] = [f"{out}/idl:msg/{message}.idl" for message in sorted(compiled)]
        for module in (C, *(f"rosidl_typesupport_{kind}" for kind in (*TYPE_SUPPORTS, "c")), PYTHON):
            _generate(module, out / module / name, what, hashes)
    return _compile(name, out)


def _generate(module, folder, what, hashes):
    classes = inspect.getmembers(importlib.import_module(f"{module}.cli"), inspect.isclass)
    ((name, kind),) = [(n, c) for n, c in classes if c.__module__ == f"{module}.cli"]
    generator = kind.__new__(kind)
    supports = [f"rosidl_typesupport_{kind}" for kind in TYPE_SUPPORTS]
    supports = ["rosidl_typesupport_c", *supports] if module == PYTHON else supports
    setattr(generator, f"_{name}__typesupport_implementations", supports)
    if "type_description_files" in inspect.signature(kind.generate).parameters:
        what = what | {"type_description_files": hashes}
    generator.generate(**what, output_path=folder)


def _compile(name, out):
    import numpy

    libraries, site = out / "lib", out / "site" / name
    libraries.mkdir()
    python = out / PYTHON / name
    shutil.copytree(python, site, ignore=shutil.ignore_patterns("*.c"))
    include = PREFIX / "include"
    folders = [*(f for f in out.iterdir() if f.name.startswith("rosidl")), include, *include.iterdir()]
    folders += [sysconfig.get_path("include"), numpy.get_include()]
    options = ["-O0", "-w", "-fPIC", "-shared", *(f"-I{f}" for f in folders)]
    paths = [f"-L{PREFIX}/lib", f"-L{libraries}"]

    def library(target, sources, linked):
        names = [f"-l{library}" for library in (*linked, "rosidl_runtime_c", "rcutils")]
        files = [str(file) for file in sources]
        done = subprocess.run(
            ["gcc", *options, "-o", str(target), *files, *paths, *names, "-lstdc++"],
            capture_output=True,
            text=True,
        )
        assert done.returncode == 0, done.stderr[-3000:]

    def of_needed(part):
        return [f"{package}__{part}" for package in NEEDED]

    def own(part):
        return f"{name}__{part}"

    def sources(module):
        return [*(out / module).rglob("*.c"), *(out / module).rglob("*.cpp")]

    def target(part):
        return libraries / f"lib{own(part)}.so"

    library(target(C), sources(C), of_needed(C))
    for kind in TYPE_SUPPORTS:
        module = f"rosidl_typesupport_{kind}"
        library(target(module), sources(module), [own(C), *of_needed(module), *SUPPORT_LIBRARIES[kind]])
    main = "rosidl_typesupport_c"
    library(target(main), sources(main), [own(C), "rosidl_typesupport_c", "rcpputils"])
    library(target(PYTHON), (python / "msg").glob("*_s.c"), [own(C), *of_needed(PYTHON), *of_needed(C)])
    for module in (main, *(f"rosidl_typesupport_{kind}" for kind in TYPE_SUPPORTS)):
        made = site / f"{name}_s__{module}.so"
        library(made, [python / f"_{name}_s.ep.{module}.c"], [own(PYTHON), own(module), own(C)])
    return {"PYTHONPATH": str(site.parent), "LD_LIBRARY_PATH": f"{libraries}:{PREFIX}/lib"}
