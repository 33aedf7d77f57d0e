"""Puts the examples into the package; everything else is in pyproject.toml."""

import shutil
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py


class WithExamples(build_py):
    """`examples/` as `swath/examples`, for `swath new`."""

    def run(self) -> None:
        """Copy the packages, then the examples."""
        super().run()
        if not self.editable_mode:
            target = Path(self.build_lib) / "swath" / "examples"
            shutil.rmtree(target, ignore_errors=True)
            shutil.copytree("examples", target, ignore=shutil.ignore_patterns("__pycache__"))


setup(cmdclass={"build_py": WithExamples})
