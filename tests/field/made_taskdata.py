"""A writer of ISO 11783-10 task data, after the standard, independent of the reader."""

import struct
from pathlib import Path

TASKDATA = """<?xml version="1.0" encoding="UTF-8"?>
<ISO11783_TaskData VersionMajor="4" VersionMinor="1" DataTransferOrigin="2">
  <DVC A="DVC-1" B="Harvester">
    <DET A="DET-1" B="1" C="1" D="whole" E="0" F="0"/>
    <DET A="DET-2" B="2" C="2" D="header" E="1" F="1"/>
    <DVP A="3" B="0" C="0.5" D="0" E="UPM"/>
    <DPD A="4" B="EA60" C="1" D="1" E="Motordrehzahl" F="3"/>
  </DVC>
  <TSK A="TSK1" G="4">
    {logs}
  </TSK>
</ISO11783_TaskData>
"""
HEADER = """<?xml version="1.0" encoding="UTF-8"?>
<TIM A="" D="4"><PTN A="" B="" C="" D="" E="" G=""/>
<DLV A="0043" B="" C="DET-2"/><DLV A="0057" B="" C="DET-1"/><DLV A="0063" B="" C="DET-1"/>
<DLV A="018D" B="" C="DET-1"/><DLV A="EA60" B="" C="DET-1"/></TIM>
"""
POSITION = "<IHiiiBHB"


def record(ms, days, lat, lon, up, values):
    """One record; values: pairs of index and integer."""
    head = struct.pack(POSITION, ms, days, round(lat * 1e7), round(lon * 1e7), round(up * 1e3), 4, 12, 9)
    return head + struct.pack("<B", len(values)) + b"".join(struct.pack("<Bi", i, v) for i, v in values)


def simple_records(count, *, start_ms=36_000_000, days=14_000):
    """Drives north at 2 m/s; engine speed 1000 + k at every record, the width only at the first."""
    made = []
    for k in range(count):
        values = [(1, 9_000_000 + 1000 * k), (2, 140_000), (3, 2000), (4, 2000 + 2 * k)]
        values = [(0, 6000), *values] if k == 0 else values
        made.append(record(start_ms + 1000 * k, days, 52.0 + 1.8e-5 * k, 9.0, 80.0, values))
    return made


def write(folder: Path, logs: dict[str, bytes], *, header=HEADER, taskdata=TASKDATA):
    """Write a task data folder; logs: name -> content of its bin."""
    folder.mkdir(parents=True, exist_ok=True)
    listed = "".join(f'<TLG A="{name}" C="1"/>' for name in logs)
    (folder / "TASKDATA.XML").write_text(taskdata.replace("{logs}", listed))
    for name, data in logs.items():
        (folder / f"{name}.xml").write_text(header)
        (folder / f"{name}.bin").write_bytes(data)
    return folder


EAST_M, NORTH_M = 74_634.0, 111_200.0  # of a degree at 48 deg N, WGS 84
LAT, LON = 48.0, 11.0
PASSES, LONG, WIDE, YIELD = 6, 120, 9.0, 5.4  # count, m, m, t/ha: the field of `harvest`


def place(east, north):
    """Longitude and latitude [deg] of a place of the field [m]."""
    return LON + east / EAST_M, LAT + north / NORTH_M


def points(places, kinds="2"):
    """PNT of places [m]; kinds: one type for all, or one each."""
    kinds = kinds if isinstance(kinds, list) else [kinds] * len(places)
    at = (place(*p) for p in places)
    return "".join(
        f'<PNT A="{k}" C="{lat:.9f}" D="{lon:.9f}"/>' for k, (lon, lat) in zip(kinds, at, strict=True)
    )


def polygon(kind, west, south, east, north, *, inner=None):
    """PLN of a rectangle [m], with a hole in it."""
    ring = points([(west, south), (east, south), (east, north), (west, north)])
    hole = ""
    if inner:
        a, b, c, d = inner
        hole = f'<LSG A="2">{points([(a, b), (c, b), (c, d), (a, d)])}</LSG>'
    return f'<PLN A="{kind}"><LSG A="1">{ring}</LSG>{hole}</PLN>'


def section(number, parent=2, refers=""):
    """DET of a section."""
    return f'<DET A="DET-{number}" B="{number}" C="4" E="{number}" F="{parent}">{refers}</DET>'


COMBINE = '<DET A="DET-1" B="1" C="1" E="0" F="0"/><DET A="DET-2" B="2" C="2" E="1" F="1"/>'


def task_data(folder: Path, *, fields="", crops="", device=COMBINE, more="", tasks=None):
    """TASKDATA.XML of its parts; tasks: (field, logs) each, default one of PFD1 with TLG00001."""
    folder.mkdir(parents=True, exist_ok=True)
    made = "".join(
        f'<TSK A="TSK{i + 1}" E="{of}" G="4">{"".join(f"""<TLG A="{name}" C="1"/>""" for name in logs)}</TSK>'
        for i, (of, logs) in enumerate(tasks or [("PFD1", ["TLG00001"])])
    )
    (folder / "TASKDATA.XML").write_text(
        '<?xml version="1.0"?><ISO11783_TaskData VersionMajor="4" VersionMinor="2" DataTransferOrigin="2">'
        f'{crops}{fields}<DVC A="DVC-1" B="Combine">{device}</DVC>{more}{made}</ISO11783_TaskData>'
    )
    return folder


GRAIN = [(84, "DET-2", YIELD * 1e5), (99, "DET-2", 140_000), (397, "DET-1", 2000)]


def harvest(
    folder: Path, channels, *, name="TLG00001", on_change=False, undated=0, head=(0, 0), shift=0.0, day=16_000
):
    """A log of PASSES passes, north and back, WIDE apart, at 2 m/s.

    channels: (DDI, element, integer or function of the record's number); on_change: values are written when
    they change; undated: first records, with the day and position (raw) of head; shift [m] to the east
    """
    folder.mkdir(parents=True, exist_ok=True)
    listed = "".join(f'<DLV A="{ddi:04X}" B="" C="{element}"/>' for ddi, element, _ in channels)
    (folder / f"{name}.xml").write_text(f'<TIM A="" D="4"><PTN A="" B="" C="" D=""/>{listed}</TIM>')
    made, last, k = [], {}, 0
    for p in range(PASSES):
        for j in range(LONG // 2 + 1):
            north = 2.0 * (j if p % 2 == 0 else LONG // 2 - j)
            values = {i: int(v(k) if callable(v) else v) for i, (*_, v) in enumerate(channels)}
            new = {i: v for i, v in values.items() if not on_change or last.get(i) != v}
            last = values
            lon, lat = place(shift + WIDE * p, north)
            raw = (round(lat * 1e7), round(lon * 1e7)) if k >= undated or head[1] == 0 else (head[1],) * 2
            days = head[0] if k < undated else day
            fixed = struct.pack("<IHiiiB", 36_000_000 + 1000 * (k + 20 * p), days, *raw, 300_000, 4)
            made.append(
                fixed + bytes([len(new)]) + b"".join(struct.pack("<Bi", i, v) for i, v in new.items())
            )
            k += 1
    (folder / f"{name}.bin").write_bytes(b"".join(made))
    return folder
