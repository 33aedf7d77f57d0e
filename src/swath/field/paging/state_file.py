"""What was cut and laid on a field as a file, for a run that begins where another ended.

A .npz: per changed page its index, cut codes and straw; grain on the ground by squares; and what the field
is, so that the state of another one is refused.
"""

import io
import json
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError, some_of
from swath.core.files.whole_file import write_whole
from swath.documents.packed import read_arrays, readable
from swath.field.memory_layout import PAGE_CUT_CELLS, PAGE_NODES

FORMAT = "swath field state 1"
KEY = "field.state_file"
CODES_BYTES, STRAW_BYTES = PAGE_CUT_CELLS**2, 8 * PAGE_NODES**2
NOTHING, PACKED = -1, -2  # in the place of a code of a whole page
RATIO = 2000  # codes of cut cells are runs of one value
NAMED = 3  # differing keys that are reported


def write_state(path: Path, state: Mapping[str, Any], about: Mapping[str, Any]) -> None:
    """Write what `Field.save` gave. about: what the field is: dotted key -> plain value."""
    codes, straw = state["codes"], state["straw"]
    whole = [NOTHING if c is None else PACKED if isinstance(c, bytes) else int(c) for c in codes]
    grain: Mapping[tuple[int, int], float] = state["grain"]["mass"]
    file = io.BytesIO()
    pages: dict[str, Any] = {f"codes_{i}": _bytes(c) for i, c in enumerate(codes) if isinstance(c, bytes)}
    if (ruts := state.get("ruts")) is not None:
        pages |= {"rut_nodes": ruts["nodes"], "rut_depth": ruts["depth"]}
    pages |= {f"straw_{i}": _bytes(s) for i, s in enumerate(straw) if s is not None}
    np.savez(
        file,
        about=_bytes(json.dumps({"format": FORMAT, "field": dict(about)}).encode()),
        keys=np.asarray(state["keys"], dtype=np.int64).reshape(-1, 2),
        whole=np.array(whole, dtype=np.int64),
        has_straw=np.array([s is not None for s in straw], dtype=bool),
        grain_square=np.array(list(grain), dtype=np.int64).reshape(-1, 2),
        grain_kg=np.array(list(grain.values()), dtype=np.float64),
        **pages,
    )
    write_whole(path, file.getvalue())


def read_state(path: Path, about: Mapping[str, Any]) -> dict[str, Any]:
    """The state for `Field.start_from`. InputError for a file that is none, and for that of another field."""
    what = "a field state, written by swath run --save-field"
    arrays = read_arrays(path, KEY, what, RATIO)
    with readable(KEY, what, path):
        header = json.loads(arrays["about"].tobytes())
        if header["format"] != FORMAT:
            raise ValueError(f"its format is {header['format']!r}, not {FORMAT!r}")
        _check_same(path, header["field"], about)
        keys, whole, has_straw = (arrays[name] for name in ("keys", "whole", "has_straw"))
        if keys.shape != (len(whole), 2) or has_straw.shape != whole.shape:
            raise ValueError("its pages do not fit together")
        grain = zip(arrays["grain_square"].tolist(), arrays["grain_kg"].tolist(), strict=True)
        ruts: dict[str, Any] = {}
        if "rut_nodes" in arrays:
            ruts["ruts"] = {"nodes": arrays["rut_nodes"], "depth": arrays["rut_depth"]}
        return {
            **ruts,
            "keys": keys.astype(np.int64),
            "codes": [_codes(int(code), arrays, i) for i, code in enumerate(whole)],
            "straw": [
                inflatable(arrays[f"straw_{i}"].astype(np.uint8).tobytes(), STRAW_BYTES) if has else None
                for i, has in enumerate(has_straw.tolist())
            ],
            "grain": {"mass": {(int(x), int(y)): float(mass) for (x, y), mass in grain}},
        }


def _codes(code: int, arrays: Mapping[str, NDArray[Any]], i: int) -> int | bytes | None:
    if code == PACKED:
        return inflatable(arrays[f"codes_{i}"].astype(np.uint8).tobytes(), CODES_BYTES)
    if not NOTHING <= code <= 255:
        raise ValueError(f"{code} is no cut code")
    return None if code == NOTHING else code


def inflatable(data: bytes, size: int) -> bytes:
    """Deflated bytes that become exactly `size` bytes. ValueError or zlib.error where not."""
    stream = zlib.decompressobj()
    if len(stream.decompress(data, size + 1)) != size or not stream.eof:  # its check sum is right, too
        raise ValueError("a page is cut off, damaged or of another size")
    return data


def _check_same(path: Path, theirs: Mapping[str, Any], ours: Mapping[str, Any]) -> None:
    keys = [k for k in dict.fromkeys((*ours, *theirs)) if ours.get(k) != theirs.get(k)]
    if keys:
        differing = [f"{k} {_said(theirs, k)}, here {_said(ours, k)}" for k in keys]
        raise InputError(
            KEY, str(path), f"expected the state of this field, it has {some_of(differing, NAMED, '; ')}"
        )


def _said(values: Mapping[str, Any], key: str) -> str:
    return str(values[key])[:40] if key in values else "none"


def _bytes(data: Sequence[int] | bytes) -> NDArray[np.uint8]:
    return np.frombuffer(bytes(data), np.uint8)
