"""A drive as ASC, BLF and MF4: 300 records, one a second, a pause of 60 s behind the 150th."""

import struct
from dataclasses import dataclass, field

import numpy as np

from swath.core.apart.call import written_here
from swath.documents.reasons import doubts
from swath.field_io.logs.channels import open_channels
from swath.field_io.logs.table import read_table

COUNT, HALF, PAUSE = 300, 150, 60.0
T = np.arange(COUNT) + np.where(np.arange(COUNT) >= HALF, PAUSE, 0.0)
FLOW = np.round(5.0 + np.sin(np.arange(COUNT) / 9.0), 3)
DBC = """VERSION ""
BU_: ECU
BO_ 256 Pos: 8 ECU
 SG_ Latitude : 0|32@1- (1e-07,0) [-90|90] "deg" ECU
 SG_ Longitude : 32|32@1- (1e-07,0) [-180|180] "deg" ECU
BO_ 257 Drive: 8 ECU
 SG_ Speed : 0|16@1+ (0.01,0) [0|655] "km/h" ECU
 SG_ HeaderWidth : 16|16@1+ (0.001,0) [0|65] "m" ECU
BO_ 258 Grain: 8 ECU
 SG_ GrainFlow : 0|16@1+ (0.001,0) [0|65] "kg/s" ECU
"""
CHANNELS = {
    "Latitude": (48.0 + 2e-5 * np.arange(COUNT), "deg"),
    "Longitude": (np.full(COUNT, 11.0), "deg"),
    "Speed": (np.full(COUNT, 7.2), "km/h"),
    "HeaderWidth": (np.full(COUNT, 9.0), "m"),
    "GrainFlow": (FLOW, "kg/s"),
}


def frames(flow=FLOW, t=T, bus=1, north=0.0):
    """(time [s], identifier, data, bus)"""
    made = []
    for k, at in enumerate(t):
        lat = round((48.0 + 2e-5 * k + north) * 1e7)
        made.append((at, 256, struct.pack("<ii", lat, round(11.0 * 1e7)), bus))
        made.append((at + 0.01, 257, struct.pack("<HHI", 720, 9000, 0), bus))
        made.append((at + 0.02, 258, struct.pack("<HHI", round(flow[k] * 1000), 0, 0), bus))
    return made


def date(second):
    return f"Mon Jul 15 10:{second // 60:02d}:{second % 60:02d}.000 am 2024"


def head(second=0, stamps="absolute", base="hex"):
    return f"date {date(second)}\nbase {base}  timestamps {stamps}\ninternal events logged\n"


def block(second=0):
    return f"Begin Triggerblock {date(second)}\n"


def lines(made, *, zero=0.0, relative=False, base="X"):
    text, before = "", zero
    for t, identifier, data, bus in made:
        form = "02X" if base == "X" else "d"
        cells = " ".join(format(b, form) for b in data)
        text += f"{t - before:11.6f} {bus}  {identifier:<15{base}} Rx   d {len(data)} {cells}\n"
        before = t if relative else zero
    return text + "End TriggerBlock\n"


def asc(path, made, dbc=DBC):
    """made: frames, or the text of all"""
    path.with_suffix(".dbc").write_text(dbc, encoding="utf-8")
    text = made if isinstance(made, str) else head() + block() + lines(made)
    path.write_text(text, encoding="utf-8")
    return path


def blf(path, made):
    import can

    path.with_suffix(".dbc").write_text(DBC, encoding="utf-8")
    with can.BLFWriter(path) as writer:
        for t, identifier, data, bus in made:
            message = can.Message(timestamp=1.7e9 + t, arbitration_id=identifier, data=data,
                                  is_extended_id=False, channel=bus - 1)  # fmt: skip
            writer.on_message_received(message)
    return path


def group(names=tuple(CHANNELS), rows=slice(None), t=T, **changed):
    """Signals of a group of MF4; changed: name -> (values, unit, times, further arguments)"""
    from asammdf import Signal

    made = {n: (CHANNELS[n][0][rows], CHANNELS[n][1], t[rows], {}) for n in names} | changed
    return [Signal(np.asarray(v), np.asarray(at, float), name=n, unit=u, **more)
            for n, (v, u, at, more) in made.items()]  # fmt: skip


def mf4(path, *groups):
    from asammdf import MDF

    with MDF(version="4.10") as mdf:
        for signals in groups:
            mdf.append(signals, common_timebase=False)
        mdf.save(path, overwrite=True)
    return path


@dataclass
class Read:
    """What of a measurement comes into a table. notes: without the usual ones."""

    rows: int
    span: float
    flow: np.ndarray
    notes: list = field(default_factory=list)
    doubts: list = field(default_factory=list)
    stated: int | None = None


def read(path):
    """As a table, here; what is a stranger's is read in a process of its own."""
    written_here(path)
    table = read_table(path)
    time = table.numbers("time [s]")
    notes = [note for note in table.notes if not note.startswith("form: ")]
    flow = table.numbers("GrainFlow [kg/s]")
    return Read(len(time), float(np.ptp(time)), flow, notes, doubts(notes), table.stated)


def opened(path):
    """Its channels."""
    written_here(path)
    return open_channels(path)
