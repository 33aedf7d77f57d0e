"""The numbers of a run as a measurement that tools of machinery makers open.

MF4 (ASAM MDF 4.1): a group of channels for each output, with their units. BLF, ASC: each number is a frame of
29 bits with one signal, a double, described by the DBC file written beside. Scans and images are left out.
"""

import os
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from io import TextIOWrapper
from pathlib import Path
from typing import Any

import numpy as np

from swath.core.errors import Extra, InputError
from swath.core.files.whole_file import new_file, write_whole
from swath.core.schedule import NS
from swath.record.read.feed import exact_outputs, exact_samples
from swath.record.read.files import RUN, open_log
from swath.signals import F64
from swath.signals.flat import flat_fields, read

BEGIN = datetime(2000, 1, 1, tzinfo=UTC)  # of every run, so that MF4 and BLF of a run are always the same
FIRST = 0x100  # identifier of the first number


@dataclass(frozen=True)
class Recorded:
    """An output of a run. t [s], shape (n,); channels: name -> (unit, values, shape (n,))."""

    name: str
    t: F64
    channels: dict[str, tuple[str, F64]]


def recorded(folder: Path) -> Iterator[Recorded]:
    """The plain numbers of every output that was recorded sample by sample, one output after the other."""
    log = open_log(folder / RUN)
    for topic, name in exact_outputs(log).items():
        samples = list(exact_samples(log.messages((topic,))))
        if not samples:
            continue
        fields = [f for f in flat_fields(type(samples[0][1])).values() if f.kind != "array"]
        values = {
            f"{name}.{f.name}": (f.unit, np.array([float(read(s, f.name)) for _, s in samples]))
            for f in fields
        }
        if values:
            yield Recorded(name, np.array([t for t, _ in samples]) / NS, values)


def write_run_log(folder: Path, out: Path) -> int:
    """Write the numbers of a run; the number of channels.

    Raises InputError for a folder that is no run, or an ending that is none of mf4, blf and asc.
    """
    if not os.path.isfile(folder / RUN):
        raise InputError("run", str(folder), f"expected a run folder with {RUN}")
    write = {".mf4": _write_mf4, ".blf": _write_frames, ".asc": _write_frames}.get(out.suffix.lower())
    if write is None:
        raise InputError("--out", out.name, "expected a name that ends with .mf4, .blf or .asc")
    return write(recorded(folder), out)


def _write_mf4(outputs: Iterator[Recorded], out: Path) -> int:
    with Extra("mf4", "writing MF4"):
        from asammdf import MDF, Signal
    count = 0
    with MDF(version="4.10") as mdf:
        mdf.header.start_time = BEGIN
        for output in outputs:
            made = [
                Signal(values, output.t, unit=unit, name=name)
                for name, (unit, values) in output.channels.items()
            ]
            mdf.append(made, acq_name=output.name)
            count += len(made)
        with new_file(out) as file:
            mdf.save(file, overwrite=True, compression=2)
    return count


def _write_frames(outputs: Iterator[Recorded], out: Path) -> int:
    with Extra("can", "writing frames"):
        import can
        from cantools.database import Database, Message
        from cantools.database import Signal as Described
        from cantools.database.conversion import LinearConversion
    described: list[Any] = []
    times, frames = [], []
    for output in outputs:
        for name, (unit, values) in output.channels.items():
            identifier, bare = FIRST + len(described), name.replace(".", "_")
            number = Described(
                bare, 0, 64, unit=unit or None, conversion=LinearConversion(1.0, 0.0, is_float=True)
            )
            described.append(Message(identifier, bare, 8, [number], is_extended_frame=True, strict=False))
            times.append(output.t)
            frames.append(values)
    database = Database(described)
    write_whole(out.with_suffix(".dbc"), database.as_dbc_string())
    source = np.repeat(np.arange(len(frames)), [len(t) for t in times])
    at, data = np.concatenate(times or [np.zeros(0)]), np.concatenate(frames or [np.zeros(0)])
    is_text = out.suffix.lower() == ".asc"
    with new_file(out) as file:
        writer: Any = can.ASCWriter(TextIOWrapper(file)) if is_text else can.BLFWriter(file)
        for i in np.argsort(at, kind="stable"):
            bits = data[i].astype("<f8").tobytes()
            identifier = FIRST + int(source[i])
            stamp = BEGIN.timestamp() + float(at[i])
            writer(can.Message(stamp, identifier, is_extended_id=True, data=bits, is_rx=True))
        writer.stop()
    return len(described)
