"""FMUs and System Structure Packages are zip archives: unpacked here, or refused in one line."""

import shutil
import struct
import tempfile
import zipfile
import zlib
from pathlib import Path
from xml.etree import ElementTree

from swath.core.errors import InputError
from swath.documents.packed import open_archive

# What an archive or a description that is broken, encrypted or packed in an unknown way may raise.
BROKEN = (
    ArithmeticError,
    AttributeError,
    EOFError,
    LookupError,
    OSError,
    RuntimeError,  # encrypted; NotImplementedError: an unknown way of packing
    TypeError,
    ValueError,
    ElementTree.ParseError,
    struct.error,
    zipfile.BadZipFile,
    zlib.error,
)


def unpack_archive(file: Path, prefix: str) -> Path:
    """The archive in a new temporary folder, which the caller removes. ValueError with the reason."""
    folder = Path(tempfile.mkdtemp(prefix=prefix))
    try:
        with open_archive(file, "file") as archive:
            size, room = sum(i.file_size for i in archive.infolist()), shutil.disk_usage(folder).free
            if size > room:
                raise ValueError(f"it would take {size / 1e6:.0f} MB, there is room for {room / 1e6:.0f}")
            archive.extractall(folder)
    except InputError as error:
        shutil.rmtree(folder, ignore_errors=True)
        raise ValueError(error.expected) from error
    except BROKEN as error:
        shutil.rmtree(folder, ignore_errors=True)
        raise ValueError(reason(error)) from error
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    return folder


def reason(error: BaseException) -> str:
    """The text of an error in one line; its kind, where it has none."""
    text = " ".join(str(error).split()) or type(error).__name__
    return text if len(text) <= 200 else text[:197] + "..."
