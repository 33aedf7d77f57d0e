"""Where a run is written: never over something that is not an earlier run of the same scenario."""

from pathlib import Path

from swath.core.errors import InputError

RUN_FILES = ("summary.json", "tracks.parquet", "run.mcap", "report.html", "replay.html", "scenario.yaml")


def choose_run_folder(name: str, seed: int, out: Path | None = None, *, what: str = "") -> Path:
    """The folder for a run; it is not made here.

    Without `out` a fresh one, `runs/<name>-<seed>[-<what>]`, with -2, -3 ... when that exists. A given
    `out` must be new, empty, or an earlier run of the scenario `name`; InputError otherwise.
    """
    if out is None:
        return _fresh(f"{name}-{seed}-{what}" if what else f"{name}-{seed}")
    if not _is_free(out) and run_name(out) != name:
        expected = f"expected a new or empty folder, or an earlier run of {name}"
        raise InputError("--out", str(out), expected)
    return out


def choose_scan_folder(name: str, seed: int, out: Path | None = None) -> Path:
    """The folder for a scan: as for a run, a given `out` may hold an earlier scan (files `scan.*`)."""
    if out is None:
        return _fresh(f"{name}-{seed}-scan")
    if not _is_free(out) and not (out.is_dir() and all(f.name.startswith("scan.") for f in out.iterdir())):
        raise InputError("--out", str(out), "expected a new or empty folder, or an earlier scan")
    return out


def run_name(folder: Path) -> str | None:
    """Name of the scenario that was run into a folder, None when it is no run folder."""
    from swath.documents.yaml_document import read_document

    file = folder / "scenario.yaml"
    if not file.is_file() or not any((folder / f).is_file() for f in ("summary.json", "run.mcap")):
        return None
    try:
        data = read_document(file).data
    except InputError:
        return None
    name = data.get("name") if isinstance(data, dict) else None
    return name if isinstance(name, str) else None


def clear_run_folder(folder: Path) -> None:
    """Remove the files of an earlier run, and only those."""
    for name in RUN_FILES:
        (folder / name).unlink(missing_ok=True)


def _fresh(name: str) -> Path:
    first = Path("runs") / name
    path, count = first, 1
    while path.exists():
        count += 1
        path = first.with_name(f"{first.name}-{count}")
    return path


def _is_free(path: Path) -> bool:
    return not path.exists() or (path.is_dir() and not any(path.iterdir()))
