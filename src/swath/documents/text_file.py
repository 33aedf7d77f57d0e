"""Text files of a user's, read within bounds: a file without end, or of one line without end, is refused."""

from collections.abc import Iterator
from io import TextIOWrapper
from pathlib import Path

from swath.core.errors import InputError
from swath.core.files.read_file import open_to_read
from swath.documents.packed import MIB

MAX_BYTES = 64 * MIB
LONGEST_LINE = 1 << 16  # characters; tables of this project have hundreds


def read_bytes(path: Path, key: str, what: str, most: int = MAX_BYTES) -> bytes:
    """All of a file. Raises as `open_to_read`."""
    with open_to_read(path, key, what, most) as file:
        return file.read(most)


def read_text(path: Path, key: str, what: str, most: int = MAX_BYTES) -> str:
    """The text of a file in UTF-8, with or without its mark. Raises as `read_bytes`."""
    try:
        return read_bytes(path, key, what, most).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(key, None, f"expected {what} in UTF-8", file=path) from error


def text_lines(path: Path, key: str, what: str, most: int = 1 << 30) -> Iterator[str]:
    """The lines of a text in UTF-8, with their ends, one at a time. Raises as `read_bytes`."""
    left, line = most, 0
    try:
        with TextIOWrapper(open_to_read(path, key, what), "utf-8-sig", newline="") as file:
            while text := file.readline(LONGEST_LINE + 1):
                line, left = line + 1, left - len(text)
                if len(text) > LONGEST_LINE:
                    expected = f"expected {what} in lines of at most {LONGEST_LINE} characters"
                    raise InputError(key, None, expected, file=path, line=line)
                if left < 0:
                    raise InputError(key, None, f"expected {what} of at most {most} characters", file=path)
                yield text
    except UnicodeDecodeError as error:
        raise InputError(key, None, f"expected {what} in UTF-8", file=path) from error
