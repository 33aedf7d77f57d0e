"""What a run did to pages that are out of memory, in a file without a name. Memory stays with the way."""

from collections.abc import Iterator, Mapping, MutableMapping
from dataclasses import dataclass

from swath.core.files.unnamed_file import UnnamedFile

Key = tuple[int, int]
UNCHANGED, IN_FILE = -2, -1  # in place of a page's one code


@dataclass(frozen=True)
class Change:
    """What a run did to a page. codes: None = nothing, a whole page's code, or deflated (512, 512) codes.

    straw: None or deflated (64, 64) float64 masses [kg] on the nodes that the page owns.
    """

    codes: int | bytes | None
    straw: bytes | None


class StoredChanges(MutableMapping[Key, Change]):
    """Changes by page, in the order they came; what is deflated lies in a file."""

    def __init__(self, changes: Mapping[Key, Change] | None = None) -> None:
        self._places: dict[Key, tuple[int, int, int, int]] = {}  # code, place, bytes of codes and of straw
        self._file = UnnamedFile()
        self.update(changes or {})

    def __setitem__(self, key: Key, change: Change) -> None:
        codes, straw = change.codes, change.straw or b""
        in_file = (codes if isinstance(codes, bytes) else b"") + straw
        code = codes if isinstance(codes, int) else UNCHANGED if codes is None else IN_FILE
        self._places.pop(key, None)
        at, size = self._file.append(in_file), len(in_file) - len(straw)
        self._places[key] = code, at, size, len(straw)

    def __getitem__(self, key: Key) -> Change:
        code, at, codes, straw = self._places[key]
        data = b""
        if codes + straw:
            data = self._file.read(at, codes + straw)
        whole = None if code == UNCHANGED else data[:codes] if code == IN_FILE else code
        return Change(whole, data[codes:] if straw else None)

    def __delitem__(self, key: Key) -> None:
        del self._places[key]

    def __iter__(self) -> Iterator[Key]:
        return iter(self._places)

    def __len__(self) -> int:
        return len(self._places)

    def has_codes(self, key: Key) -> bool:
        """Whether the codes of a page are not those of the start."""
        return key in self._places and self._places[key][0] != UNCHANGED

    def has_straw(self, key: Key) -> bool:
        """Whether there is straw on a page."""
        return key in self._places and self._places[key][3] > 0
