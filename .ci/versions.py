"""One version everywhere: pyproject.toml, swath.__version__, CITATION.cff, CHANGELOG.md and, where given,
the tag.

python .ci/versions.py [v0.3.0]    exit code 1 where they differ, or where the tag's changes are unreleased

What is not released calls itself so: `## 0.3.0 (unreleased)` in the changelog is 0.3.0.dev0 elsewhere.
"""

import re
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]


def versions(root: Path = ROOT) -> dict[str, str]:
    """File -> the version it says; of the changelog the newest that has one."""
    texts = {name: (root / name).read_text(encoding="utf-8") for name in ("CITATION.cff", "CHANGELOG.md")}
    module = (root / "src" / "swath" / "__init__.py").read_text(encoding="utf-8")
    found = {
        "src/swath/__init__.py": re.search(r'^__version__ = "(.+)"$', module, re.MULTILINE),
        "CITATION.cff": re.search(r"^version: (.+)$", texts["CITATION.cff"], re.MULTILINE),
        "CHANGELOG.md": re.search(r"^## (\d\S*)", texts["CHANGELOG.md"], re.MULTILINE),
    }
    is_unreleased = re.search(r"^## \S+ \(unreleased\)$", texts["CHANGELOG.md"], re.MULTILINE) is not None
    project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    said = {k: m[1] if m else "none" for k, m in found.items()}
    said["CHANGELOG.md"] += ".dev0" if is_unreleased else ""
    return {"pyproject.toml": project["version"], **said}


def wrong(tag: str, root: Path = ROOT) -> list[str]:
    """What is wrong, empty where nothing is."""
    said = versions(root)
    own = said["pyproject.toml"]
    differ = [
        f"{file} says {version}, pyproject.toml {own}" for file, version in said.items() if version != own
    ]
    if tag and tag != f"v{own}":
        differ.append(f"the tag is {tag}, expected v{own}")
    if tag and own.endswith(".dev0"):
        differ.append(f"{own} is not released: a date in place of (unreleased), the version without .dev0")
    return differ


def main(tag: str = "") -> int:
    """Print what is wrong, else the version."""
    found = wrong(tag)
    print("\n".join(found) or versions()["pyproject.toml"])
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:2]))
