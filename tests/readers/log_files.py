"""Writers of drawn logs: the same columns as CSV, shapefile, GeoJSON, task data, MF4, ASC and BLF."""

import gzip
import json
import struct
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from tests.field.made_exports import write as write_text
from tests.field.made_taskdata import COMBINE, task_data
from tests.field.unit_logs import shapes

DATE = "Mon Jul 15 10:00:00.000 am 2024"
BEGUN = datetime(2024, 7, 15, 10)
DDI = {"width": (67, 1e3), "flow": (87, 1e6), "yield": (84, 1e5), "dry_yield": (181, 1e5),
       "moisture": (99, 1e4), "speed": (397, 1e3), "work": (141, 1.0)}  # fmt: skip
"""Key -> identifier of ISO 11783-11, counts per unit of CHANNEL_UNITS."""
CHANNELS = {"lat": "Latitude", "lon": "Longitude", "speed": "Speed", "distance": "Distance",
            "width": "HeaderWidth", "moisture": "Moisture", "elevation": "Elevation", "flow": "GrainFlow",
            "yield": "Yield", "dry_yield": "DryYield", "work": "WorkState"}  # fmt: skip


@dataclass
class Column:
    """A column: its name in a table, the unit that a measurement states beside it ('' = none), its cells."""

    key: str
    name: str
    unit: str
    values: Any

    @property
    def is_number(self) -> bool:
        return not isinstance(self.values, list)


@dataclass
class Sheet:
    """A log before it is written. time [s] and lon, lat of each row; how: what its format does with it."""

    columns: list[Column]
    time: np.ndarray
    lon: np.ndarray
    lat: np.ndarray
    how: dict[str, Any] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.time)

    def of(self, key: str) -> Column | None:
        """The first column of a quantity."""
        return next((c for c in self.columns if c.key == key), None)

    def rows(self, index: np.ndarray) -> None:
        """Take these rows, in this order."""
        self.time, self.lon, self.lat = self.time[index], self.lon[index], self.lat[index]
        for column in self.columns:
            column.values = column.values[index] if column.is_number else [column.values[i] for i in index]


def cells(column: Column, comma: bool = False) -> list[str]:
    """The cells of a column as text; no number is an empty cell."""
    if not column.is_number:
        return list(column.values)
    digits = 8 if column.key in ("lat", "lon") else 4
    texts = ["" if np.isnan(v) else f"{v:.{digits}f}".rstrip("0").rstrip(".") for v in column.values]
    return [text.replace(".", ",") for text in texts] if comma else texts


def csv(folder: Path, sheet: Sheet, name: str) -> Path:
    """how: separator, comma (decimal), encoding, packed, again (row of a second header), total (last row)."""
    how = sheet.how
    header = [c.name for c in sheet.columns]
    lines = [
        list(row) for row in zip(*(cells(c, how.get("comma", False)) for c in sheet.columns), strict=True)
    ]
    if "again" in how:
        lines.insert(how["again"], header)
    if how.get("total"):
        lines.append(["Total", *[""] * (len(header) - 2), "1"])
    path = folder / f"{name}.csv"
    write_text(
        path, header, lines, encoding=how.get("encoding", "utf-8"), separator=how.get("separator", ",")
    )
    if "torn" in how:
        cut(path, how["torn"])
    if not how.get("packed"):
        return path
    packed = folder / f"{name}.csv.gz"
    packed.write_bytes(gzip.compress(path.read_bytes(), mtime=0))
    path.unlink()
    return packed


def cut(path: Path, share: float) -> None:
    """Leave the first part of a file, which ends within a record."""
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * share)].rstrip(b"\r\n")[:-3])


def shapefile(folder: Path, sheet: Sheet, name: str) -> Path:
    """A folder of that name. how: torn (share that is left), torn_part (ending of the file that is cut)."""
    columns = {c.name: [float(v) for v in c.values] if c.is_number else c.values for c in sheet.columns}
    path = shapes(folder / name, sheet, columns)
    if "torn" in sheet.how:
        cut(path.with_suffix(sheet.how["torn_part"]), sheet.how["torn"])
    return folder / name


def geojson(folder: Path, sheet: Sheet, name: str) -> Path:
    """Points with the columns as properties."""
    made = [
        {"type": "Feature", "geometry": {"type": "Point", "coordinates": [round(x, 8), round(y, 8)]},
         "properties": {c.name: _plain(c.values[i]) for c in sheet.columns}}
        for i, (x, y) in enumerate(zip(sheet.lon, sheet.lat, strict=True))
    ]  # fmt: skip
    path = folder / f"{name}.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": made}))
    if "torn" in sheet.how:
        cut(path, sheet.how["torn"])
    return path


def _plain(value: Any) -> Any:
    return value if isinstance(value, str) else None if np.isnan(value) else round(float(value), 6)


def isoxml(folder: Path, sheet: Sheet, name: str) -> Path:
    """One task. how: logs (number of time logs, one after the other), twice (each is there twice)."""
    how, kinds = sheet.how, [(c, *DDI[c.key]) for c in sheet.columns if c.key in DDI]
    crops, grows = (f'<CTP A="CTP1" B="{how["crop"]}"/>', ' G="CTP1"') if how.get("crop") else ("", "")
    listed = "".join(
        f'<DLV A="{ddi:04X}" B="" C="{"DET-1" if c.key == "speed" else "DET-2"}"/>' for c, ddi, _ in kinds
    )
    heights = sheet.of("elevation")
    made = []
    for i, t in enumerate(sheet.time):
        when = BEGUN + timedelta(seconds=float(t))
        ms = round((when - datetime(when.year, when.month, when.day)).total_seconds() * 1000)
        up = 0.0 if heights is None else float(heights.values[i])
        days, place = (when - datetime(1980, 1, 1)).days, (sheet.lat[i] * 1e7, sheet.lon[i] * 1e7, up * 1e3)
        values = [(k, c.values[i] * scale) for k, (c, _, scale) in enumerate(kinds)]
        values = [(k, round(float(v))) for k, v in values if np.isfinite(v)]
        made.append(struct.pack("<IHiiiB", ms, days, *map(round, map(float, place)), 4) + bytes([len(values)])
                    + b"".join(struct.pack("<Bi", k, v) for k, v in values))  # fmt: skip
    parts = [
        made[part[0] : part[-1] + 1] for part in np.array_split(np.arange(len(made)), how.get("logs", 1))
    ]
    parts *= 2 if how.get("twice") else 1
    names = [f"TLG{k + 1:05d}" for k in range(len(parts))]
    task_data(folder / name, crops=crops, fields=f'<PFD A="PFD1" C="North" D="10000"{grows}/>',
              device=COMBINE, tasks=[("PFD1", names)])  # fmt: skip
    head = f'<TIM A="" D="4"><PTN A="" B="" C="" D=""/>{listed}</TIM>'
    for log, part in zip(names, parts, strict=True):
        (folder / name / f"{log}.xml").write_text(head)
        (folder / name / f"{log}.bin").write_bytes(b"".join(part))
    if "torn" in how:
        cut(folder / name / f"{names[-1]}.bin", how["torn"])
    return folder / name


def mf4(folder: Path, sheet: Sheet, name: str) -> Path:
    """how: rates (other than the positions'), slow (channels that are written seldom), words (one value of
    the grain is a word), invalid (channels that are invalid in part), second (a group more of some channels).
    """
    from asammdf import MDF, Signal

    how, t = sheet.how, sheet.time
    first, groups, slow = [], [], how.get("slow", {})
    for c in numeric(sheet):
        times, values, more = t, np.asarray(c.values, float), {}
        if c.key in slow:
            kept = _every(t, slow[c.key])
            times, values = t[kept], values[kept]
        elif how.get("rates") and c.key not in ("lat", "lon"):
            step = 0.45 * float(np.median(np.diff(t)))
            times, values = np.sort(np.r_[t, t + step]), np.repeat(values, 2)
        if c.key == how.get("words"):
            scale = 1e-4 * max(1.0, float(np.nanmax(values)))
            bad = np.random.default_rng(len(t)).random(len(values)) < 0.1
            values = np.where(bad, 65535, np.round(np.nan_to_num(values) / scale)).astype("u2")
            more = {"conversion": {"val_0": 65535, "text_0": "SNA", "default": {"a": scale, "b": 0.0}}}
        if c.key in how.get("invalid", ()):
            more = {"invalidation_bits": np.random.default_rng(len(t)).random(len(values)) < 0.2}
        signal = Signal(values, times, name=CHANNELS[c.key], unit=c.unit, **more)
        (first if len(times) == len(t) and not more.get("conversion") else groups).append(signal)
    path = folder / f"{name}.mf4"
    with MDF(version="4.10") as mdf:
        for group in [first, *([s] for s in groups)]:
            mdf.append(group, common_timebase=False)
        for c, values in how.get("second", ()):
            mdf.append([Signal(np.asarray(values, float), t + 0.01, name=CHANNELS[c.key], unit=c.unit)],
                       common_timebase=False, acq_name="other")  # fmt: skip
        mdf.save(path, overwrite=True)
    if "torn" in how:
        cut(path, how["torn"])
    return path


def _every(t: np.ndarray, seconds: float) -> np.ndarray:
    """The first row of each so many seconds; only the first of all where that is no number."""
    return np.array([0]) if seconds == np.inf else np.unique((t - t[0]) // seconds, return_index=True)[1]


def numeric(sheet: Sheet) -> list[Column]:
    """What a measurement holds."""
    return [c for c in sheet.columns if c.is_number and c.key in CHANNELS]


def frames(sheet: Sheet) -> tuple[str, list[tuple[float, int, bytes, int]]]:
    """(DBC, frames of (time [s], identifier, data, bus)), two signals of 32 bits in each.

    how: second: columns with other values, on another bus
    """
    columns = sorted(numeric(sheet), key=lambda c: c.key not in ("lat", "lon"))  # a position is one message
    text, made = 'VERSION ""\nNS_ :\nBS_:\nBU_: ECU\n', []
    for k in range(0, len(columns), 2):
        pair = columns[k : k + 2]
        text += f"BO_ {256 + k} Message{k}: 8 ECU\n"
        for place, c in enumerate(pair):
            text += f' SG_ {CHANNELS[c.key]} : {32 * place}|32@1- ({_scale(c):g},0) [0|0] "{c.unit}" ECU\n'
        text += "\n"
        made += _sent(sheet.time + 0.002 * k, 256 + k, pair, [c.values for c in pair], 1)
        other = {c.key: values for c, values in sheet.how.get("second", ())}
        if any(c.key in other for c in pair):
            made += _sent(sheet.time + 0.002 * k + 0.03, 256 + k, pair,
                          [other.get(c.key, c.values) for c in pair], 2)  # fmt: skip
    return text, sorted(made, key=lambda frame: frame[0])


def _scale(c: Column) -> float:
    return 1e-7 if c.key in ("lat", "lon") else 1e-4


def _sent(
    t: np.ndarray, identifier: int, pair: list[Column], values: list[Any], bus: int
) -> list[tuple[float, int, bytes, int]]:
    whole = [np.round(np.nan_to_num(v) / _scale(c)).astype("<i4") for c, v in zip(pair, values, strict=True)]
    whole += [np.zeros(len(t), "<i4")] * (2 - len(whole))
    return [(float(at), identifier, struct.pack("<ii", *of), bus) for at, *of in zip(t, *whole, strict=True)]


def _dbc(folder: Path, sheet: Sheet, name: str, text: str) -> None:
    (folder / f"{name}.dbc").write_text(text, encoding=sheet.how.get("encoding", "ascii"))


def asc(folder: Path, sheet: Sheet, name: str) -> Path:
    """how: relative (stamps since the line before), blocks (index of a row with which a second block begins,
    whose stamps count from 0).
    """
    text, made = frames(sheet)
    _dbc(folder, sheet, name, text)
    is_relative = bool(sheet.how.get("relative"))
    split = sheet.time[sheet.how["blocks"]] - 0.001 if "blocks" in sheet.how else np.inf
    parts = [[f for f in made if f[0] < split], [f for f in made if f[0] >= split]]
    path = folder / f"{name}.asc"
    with path.open("w") as file:
        file.write(f"date {DATE}\nbase hex  timestamps {'relative' if is_relative else 'absolute'}\n")
        file.write("internal events logged\n")
        for part in filter(None, parts):
            begun = 0.0 if part is parts[0] else part[0][0]
            when = BEGUN + timedelta(seconds=begun)
            head = when.strftime("%a %b %d %I:%M:%S.") + f"{when.microsecond // 1000:03d} am {when.year}"
            file.write(f"Begin Triggerblock {head}\n")
            before = begun
            for t, identifier, data, bus in part:
                file.write(f"{t - before:11.6f} {bus}  {identifier:<15X} Rx   d {len(data)} "
                           + " ".join(f"{b:02X}" for b in data) + "\n")  # fmt: skip
                before = t if is_relative else begun
            file.write("End TriggerBlock\n")
    if "torn" in sheet.how:
        cut(path, sheet.how["torn"])
    return path


def blf(folder: Path, sheet: Sheet, name: str) -> Path:
    """Frames as python-can writes them."""
    import can

    text, made = frames(sheet)
    _dbc(folder, sheet, name, text)
    path = folder / f"{name}.blf"
    with can.BLFWriter(path) as writer:
        for t, identifier, data, bus in made:
            writer.on_message_received(
                can.Message(timestamp=1721037600.0 + t, arbitration_id=identifier, data=data,
                            is_extended_id=False, channel=bus)
            )  # fmt: skip
    if "torn" in sheet.how:
        cut(path, sheet.how["torn"])
    return path


WRITERS = {"csv": csv, "shapefile": shapefile, "geojson": geojson, "isoxml": isoxml, "mf4": mf4, "asc": asc,
           "blf": blf}  # fmt: skip
