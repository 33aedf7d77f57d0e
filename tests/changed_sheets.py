"""Data sheets with something changed, for tests of what is refused."""

from pathlib import Path

from swath.documents.data_sheets import find_sheet
from swath.documents.yaml_document import dump, read_document


def changed_sheet(folder: Path, kind: str, name: str, key: str, change) -> Path:
    """A copy of a bundled sheet in a folder. key: dotted; change: what updates the entry, another value for
    what is no mapping, or None, which takes it out.
    """
    data = read_document(find_sheet(kind, name)).data
    *above, last = key.split(".")
    node = data
    for part in above:
        node = node[part]
    if change is None:
        del node[last]
    elif isinstance(change, dict) and change:
        node[last].update(change)
    else:
        node[last] = change
    path = folder / "own.yaml"
    path.write_text(dump(data), encoding="utf-8")
    return path
