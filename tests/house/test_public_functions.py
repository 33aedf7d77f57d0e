"""What `import swath` offers is on the page of the API, and says what each parameter is."""

import inspect
import re
from pathlib import Path

import pytest

import swath

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "api.md"
NAMES = sorted(swath._OFFERED)


@pytest.mark.parametrize("name", NAMES)
def test_every_public_name_is_on_the_page_with_its_parameters(name):
    assert f" swath.{name}\n" in PAGE.read_text(encoding="utf-8")
    if name in ("Env", "VectorEnv"):
        pytest.importorskip("gymnasium", reason="needs the extra `gym`")
    offered = getattr(swath, name)
    said = inspect.getdoc(offered).partition("Parameters\n----------\n")[2]
    heads = {
        key.strip(" *")
        for line in re.findall(r"(?m)^(\S.*)$", said)
        for key in line.partition(" : ")[0].split(",")
    }
    asked = [p for p in inspect.signature(offered).parameters if p not in ("self", "unknown")]
    assert asked
    assert not [key for key in asked if key not in heads]
    assert "Raises\n------\n" in said
