"""Puts examples and pages into the package, README and links into its metadata; else see pyproject.toml."""

import os
import re
import shutil
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py


class WithExamples(build_py):
    """`examples/` as `swath/examples`, for `swath new`; the pages of `docs/` for `swath docs`."""

    def run(self) -> None:
        """Copy the packages, then the examples and the pages."""
        super().run()
        if not self.editable_mode:
            target = Path(self.build_lib) / "swath" / "examples"
            shutil.rmtree(target, ignore_errors=True)
            shutil.copytree("examples", target, ignore=shutil.ignore_patterns("__pycache__"))
            pages = Path(self.build_lib) / "swath" / "docs"
            shutil.rmtree(pages, ignore_errors=True)
            for page in Path("docs").rglob("*.md"):
                to = pages / page.relative_to("docs")
                to.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(page, to)


def without_relative_links(text: str) -> str:
    """The README as it is read beside no other file: pictures go, links into the repository become text."""
    text = re.sub(r"!\[[^]]*\]\((?!https?:)[^)]*\)\n*", "", text)
    return re.sub(r"\[([^]]*)\]\((?!https?:|#)([^)]*)\)", _named, text)


def _named(link: re.Match[str]) -> str:
    words, path = link.groups()
    return words if words.strip("`") == path else f"{words} ({path})"


def project_links() -> dict[str, str]:
    """Links by their label, to where PROJECT_URL says that the project is at home; those of an sdist are its
    own.

    None without either.
    """
    about = Path("PKG-INFO")
    if home := os.environ.get("PROJECT_URL", "").rstrip("/"):
        at = {
            "Source": "",
            "Documentation": "/tree/main/docs",
            "Changelog": "/blob/main/CHANGELOG.md",
            "Issues": "/issues",
        }
        return {label: home + path for label, path in at.items()}
    text = about.read_text(encoding="utf-8") if about.is_file() else ""
    return dict(re.findall(r"^Project-URL: (.+?), (.+)$", text, re.MULTILINE))


setup(
    cmdclass={"build_py": WithExamples},
    long_description=without_relative_links(Path("README.md").read_text(encoding="utf-8"))
    + "\n\n`swath docs` lists the pages named `docs/...` and prints them.\n",
    long_description_content_type="text/markdown",
    project_urls=project_links(),
)
