"""Import every module of the installed swath: none needs more than the oldest Python that is supported.

python .ci/every_module.py    exit code 1 where one fails for another reason than an extra that is absent
"""

import importlib
import pkgutil
import sys

import swath
from swath.core.errors import MissingExtra


def main() -> int:
    """Print what fails."""
    failed: list[str] = []
    absent: set[str] = set()
    count = 0
    for found in pkgutil.walk_packages(swath.__path__, "swath.", onerror=lambda name: None):
        if found.name.startswith(("swath.examples", "swath.docs")):
            continue
        count += 1
        try:
            importlib.import_module(found.name)
        except ImportError as error:
            package = (error.name or "").partition(".")[0]
            if package == "swath" or package in sys.stdlib_module_names:
                failed.append(f"{found.name}: {error}")
            absent.add(package or str(error)[:60])
        except MissingExtra as error:
            absent.add(str(error).rpartition(" ")[2])
        except Exception as error:
            failed.append(f"{found.name}: {type(error).__name__}: {error}")
    missing = ", ".join(sorted(absent)) or "nothing"
    print("\n".join(failed) or f"{count} modules; not installed: {missing}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
