"""Spread tables on disk: `<name>.npz` with the numbers, `<name>.yaml` with source, range and fit quality."""

import os
from collections.abc import Mapping
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from swath.core.errors import InputError
from swath.core.files.whole_file import new_file, write_whole
from swath.core.units import DEG
from swath.documents.packed import read_arrays, readable
from swath.documents.yaml_document import dump, read_document
from swath.rays.spread import SideSpread, Spread, SpreadTable

GRID = ("density", "height", "depression", "spot", "quantile", "ground_share", "ground_lift")
ARRAYS = ("silhouette", "view", "aside")
NUMBERS = ("fine", "aside_step", "cosine")
SIDE = ("height", "spot", "factor", "median")
SIDE_PREFIX = "side_"
STUBBLE = "stubble_"  # before the names of its grid's arrays


def table_names() -> list[str]:
    """Names of the bundled tables."""
    return sorted(p.stem for p in _folder().glob("*.npz"))


def load_table(name: str, base: Path | None = None) -> SpreadTable:
    """A bundled table by name, or the user's own npz (relative to `base`). InputError names what is wrong."""
    if name.endswith(".npz"):
        path = Path(name) if Path(name).is_absolute() else (base or Path.cwd()) / name
    else:
        path = _folder() / f"{name}.npz"
    if not os.path.isfile(path):
        have = ", ".join(table_names()) or "none"
        expected = f"expected a .npz file or one of {have}; `swath calibrate lidar` makes one"
        raise InputError("table", name, expected)
    files = [file.stat() for file in (path, path.with_suffix(".yaml")) if os.path.isfile(file)]
    return _load(path, *((file.st_mtime_ns, file.st_size) for file in files))


@lru_cache(maxsize=16)
def _load(path: Path, *_: tuple[int, int]) -> SpreadTable:
    """The table of a file; by time and size of it and of what is said about it."""
    return _made(read_arrays(path, "table", "a spread table"), path)


def _made(arrays: Mapping[str, Any], path: Path) -> SpreadTable:
    if "silhouette" in arrays and "side_factor" not in arrays:
        expected = "expected one that knows the sides of a crop: `swath calibrate lidar` makes the table anew"
        raise InputError("table", str(path), expected)
    with readable("table", "a spread table", path):
        values: dict[str, Any] = {k: np.asarray(arrays[k], dtype=np.float64) for k in ARRAYS}
        values |= {"standing": _grid(arrays, ""), "stubble": _grid(arrays, STUBBLE)}
        values |= {k: float(arrays[k]) for k in NUMBERS}
        side = {k: np.asarray(arrays[SIDE_PREFIX + k], dtype=np.float64) for k in SIDE}
        values["side"] = SideSpread(**side)
        values["correlation"] = float(arrays["correlation"][0]), float(arrays["correlation"][1])
        return SpreadTable(**values, about=_about(path))


def save_table(table: SpreadTable, path: Path) -> list[Path]:
    """Write `path` (.npz) and its YAML. The same table gives the same bytes."""
    arrays = {k: np.asarray(getattr(table, k), dtype=np.float32) for k in ARRAYS}
    arrays |= _grid_arrays(table.standing, "") | _grid_arrays(table.stubble, STUBBLE)
    arrays |= {SIDE_PREFIX + k: np.asarray(getattr(table.side, k), dtype=np.float32) for k in SIDE}
    extra = {k: np.float64(getattr(table, k)) for k in NUMBERS}
    everything: dict[str, Any] = {**arrays, **extra, "correlation": np.array(table.correlation)}
    with new_file(path) as file:  # numpy gives every member the same time stamp
        np.savez_compressed(file, **everything)
    about = {
        **table.about,
        "range": valid_range(table.standing),
        "stubble_range": valid_range(table.stubble),
    }
    sheet = path.with_suffix(".yaml")
    write_whole(sheet, dump(about))
    return [path, sheet]


def valid_range(grid: Spread) -> dict[str, list[float]]:
    """First and last node of each axis in the units of files."""
    units = {"density_per_m2": 1.0, "height_m": 1.0, "depression_deg": DEG, "spot_mm": 1e-3}
    return {
        key: [round(float(axis[0] / unit), 3), round(float(axis[-1] / unit), 3)]
        for (key, unit), axis in zip(units.items(), grid.axes, strict=True)
    }


def _grid(data: Mapping[str, Any], prefix: str) -> Spread:
    arrays = {k: np.asarray(data[prefix + k], dtype=np.float64) for k in GRID}
    return Spread(**arrays, is_stubble=prefix == STUBBLE)


def _grid_arrays(grid: Spread, prefix: str) -> dict[str, Any]:
    """Quantiles in half precision: to 0.3 mm of a crop of 1 m."""
    kinds = {k: np.float16 if k == "quantile" else np.float32 for k in GRID}
    return {prefix + k: np.asarray(getattr(grid, k), dtype=kind) for k, kind in kinds.items()}


def _about(path: Path) -> dict[str, object]:
    sheet = path.with_suffix(".yaml")
    if not os.path.isfile(sheet):
        return {}
    about = read_document(sheet).data
    if not isinstance(about, dict):
        raise InputError("table", str(sheet), "expected a mapping of keys", file=sheet)
    return about


def _folder() -> Path:
    return Path(str(files("swath.data") / "lidar_tables"))
