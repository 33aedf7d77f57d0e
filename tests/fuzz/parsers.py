"""What parses files of others, refused in this process: readers have one of their own for it."""

import importlib
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any
from unittest.mock import patch

PARSERS = {
    "asammdf": ["MDF.__init__"],
    "can": ["BLFReader.__init__", "ASCReader.__init__"],
    "cantools.database": ["load_string", "load_file"],
    "rosbags.highlevel": ["AnyReader.__init__"],
    "rosbags.typesys.store": ["Typestore.deserialize_cdr", "Typestore.deserialize_ros1"],
    "mcap.stream_reader": ["StreamReader.__init__"],
    "mcap.reader": ["make_reader"],
    "rasterio": ["open"],
    "trimesh": ["load_scene", "load"],
    "laspy": ["open", "read"],
    "fmpy": ["read_model_description"],
}


@contextmanager
def refused() -> Iterator[list[str]]:
    """Inside the block, which parsers were asked in this process."""
    asked: list[str] = []

    def refuse(name: str, usual: Any) -> Any:
        def called(*args: Any, **kwargs: Any) -> Any:
            if name.endswith("__init__") and len(args) == 1:  # a new file, to be written
                return usual(*args, **kwargs)
            asked.append(name)
            raise AssertionError(f"{name} in the process of the command")

        return called

    with ExitStack() as held:
        for module, names in PARSERS.items():
            for name in names:
                holder: Any = importlib.import_module(module)
                *around, last = name.split(".")
                for part in around:
                    holder = getattr(holder, part)
                held.enter_context(
                    patch.object(holder, last, refuse(f"{module}.{name}", getattr(holder, last)))
                )
        yield asked
