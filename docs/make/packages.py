"""The page of what installs: sizes of the extras and licences of all dependencies.

python -m docs.make.packages [FILE]    default: docs/reference/packages.md; run with everything installed
"""

import re
import sys
import tomllib
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path

from packaging.requirements import Requirement

ROOT = Path(__file__).parents[2]
HEAD = """# What installs, security, contributing, changes
## Extras and their sizes
Made by `python -m docs.make.packages` from the installed packages (Linux, x86-64, Python 3.11). `pip install swath` brings
what the first row says; an extra, `pip install 'swath[NAME]'`, what its row adds to that. Sizes are on disk [MB].

| extra | packages | size | the larger ones |
|---|---|---|---|
"""
LICENCES = """
## Licences
swath itself is Apache-2.0. Licences as the packages state them.

| package | version | licence | with |
|---|---|---|---|
"""
INCLUDED = "".join(
    f"\n```{{include}} ../../{name}.md\n:heading-offset: 1\n```\n"
    for name in ("SECURITY", "CONTRIBUTING", "CHANGELOG")
)
SHORT = {  # what some packages say in their own words
    "BSD License": "BSD", "MIT License": "MIT", "Apache Software License": "Apache-2.0", "BSD 3-Clause": "BSD-3-Clause",
    "Apache License 2.0": "Apache-2.0", "Apache License, Version 2.0": "Apache-2.0", "MIT license": "MIT",
    "Python Software Foundation License": "PSF-2.0", "BSD": "BSD-3-Clause",
    "GNU Lesser General Public License v3 (LGPLv3)": "LGPL-3.0", "Mozilla Public License 2.0 (MPL 2.0)": "MPL-2.0",
}  # fmt: skip
STATED = {
    "fmpy": "BSD-2-Clause",
    "ros-fastrtps": "Apache-2.0",
    "ros-fastcdr": "Apache-2.0",
}  # in their repositories


def key(name: str) -> str:
    """A package's name as indexes compare it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def closure(requirements: list[str], found: dict[str, Distribution]) -> dict[str, Distribution]:
    """Everything that some requirements bring, by name."""
    todo = [Requirement(text) for text in requirements]
    while todo:
        wanted = todo.pop()
        extras = wanted.extras or {""}
        if wanted.marker and not any(wanted.marker.evaluate({"extra": extra}) for extra in extras):
            continue
        name = key(wanted.name)
        if name in found and not wanted.extras:
            continue
        try:
            found[name] = distribution(wanted.name)
        except PackageNotFoundError:
            sys.exit(f"{wanted.name} is not installed")
        for text in found[name].requires or []:
            child = Requirement(text)
            if child.marker is None or any(child.marker.evaluate({"extra": extra}) for extra in extras):
                child.marker = None
                todo.append(child)
    return found


def size_mb(package: Distribution) -> float:
    """What a package takes on disk, without compiled Python."""
    files = [Path(str(package.locate_file(f))) for f in package.files or [] if f.suffix != ".pyc"]
    return sum(path.stat().st_size for path in files if path.is_file()) / 1e6


def licence(package: Distribution) -> str:
    """As it states it: an expression, a classifier, or the first line of its text."""
    about = package.metadata
    if stated := STATED.get(key(str(about["Name"]))):
        return stated
    if str(about["Name"]).startswith("ros-jazzy-"):
        return "that of the package it names"
    if text := about.get("License-Expression"):
        return str(text)
    classes = [c.rpartition(" :: ")[2] for c in about.get_all("Classifier") or [] if c.startswith("License")]
    if not classes and not about.get("License"):
        described = next((f for f in package.files or [] if f.name == "package.xml"), None)  # of ROS 2
        if described is not None and (path := Path(str(package.locate_file(described)))).is_file():
            classes = re.findall(r"<license[^>]*>([^<]+)</license>", path.read_text(encoding="utf-8"))
    lines = [line for line in str(about.get("License") or "").strip().splitlines() if line]
    said = [c for c in classes if c != "OSI Approved"] or lines[:1]
    return ", ".join(SHORT.get(text, text) for text in said) or "see the package"


def page() -> str:
    """The whole page."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    core = closure(project["dependencies"], {})
    sets = {"": core}
    for extra, requirements in project["optional-dependencies"].items():
        if extra != "dev":
            every = closure(requirements, dict(core))
            sets[extra] = {name: package for name, package in every.items() if name not in core}
    text = HEAD
    for extra, packages in sets.items():
        sizes = sorted(((size_mb(p), name) for name, p in packages.items()), reverse=True)
        large = ", ".join(f"{name} {size:.0f}" for size, name in sizes[:3] if size >= 1)
        total = sum(size for size, _ in sizes)
        text += f"| {f'`{extra}`' if extra else 'none'} | {len(sizes)} | {total:.0f} | {large} |\n"
    text += LICENCES
    every = {name: package for packages in sets.values() for name, package in packages.items()}
    for name in sorted(n for n in every if not n.startswith("ros-")):
        users = ["`swath`"] if name in core else [f"`{e}`" for e, own in sets.items() if e and name in own]
        text += f"| {name} | {every[name].version} | {licence(every[name])} | {', '.join(users)} |\n"
    ros: dict[str, list[str]] = {}
    for name in sorted(n for n in every if n.startswith("ros-")):
        ros.setdefault(licence(every[name]), []).append(name)
    for said, names in sorted(ros.items()):
        text += f"| {', '.join(names)} | | {said} | `ros2` |\n"
    return text + INCLUDED


if __name__ == "__main__":
    out = Path(sys.argv[1]) if sys.argv[1:] else ROOT / "docs" / "reference" / "packages.md"
    out.write_text(page(), encoding="utf-8")
