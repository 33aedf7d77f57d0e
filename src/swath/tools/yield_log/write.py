"""A yield log as CSV, or as task data of ISO 11783-10 with one time log."""

import struct
from datetime import datetime, timedelta
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from swath.core.errors import InputError
from swath.core.whole_file import write_whole
from swath.tools.yield_log.records import Records

BEGUN = datetime(
    2024, 7, 15, 10, 0, 0
)  # a run has no date: this one, so that the same run gives the same bytes
EPOCH = datetime(1980, 1, 1)
COLUMNS = (
    "timestamp", "latitude", "longitude", "elevation_m", "speed_kmh", "distance_m", "swath_m",
    "grain_flow_kg_s", "moisture_pct", "work_state", "machine", "crop",
)  # fmt: skip
CHANNELS = ((67, 1e-3), (87, 1e-6), (99, 1e-4), (141, 1.0), (397, 1e-3))
"""DDI and unit per count: working width [m], crop flow [kg/s], moisture [%], work state, speed [m/s]."""
HEADER = """<?xml version="1.0" encoding="UTF-8"?>
<TIM A="" D="4"><PTN A="" B="" C="" D=""/>
{listed}
</TIM>
"""
TASKDATA = """<?xml version="1.0" encoding="UTF-8"?>
<ISO11783_TaskData VersionMajor="4" VersionMinor="2" DataTransferOrigin="2">
  <CTP A="CTP1" B={crop}/>
  <DVC A="DVC1" B={machine}>
    <DET A="DET1" B="1" C="1" D={machine} E="0" F="0"/>
  </DVC>
  <TSK A="TSK1" B={name} G="4">
    <TLG A="TLG00001" C="1"/>
  </TSK>
</ISO11783_TaskData>
"""


def write_csv(log: Records, path: Path) -> Path:
    """Write CSV; names with units, as `swath field import` and farm software read them."""
    lines = [",".join(COLUMNS)]
    for i, t in enumerate(log.time):
        cells = (
            (BEGUN + timedelta(seconds=float(t))).isoformat(timespec="milliseconds"), f"{log.lat[i]:.8f}",
            f"{log.lon[i]:.8f}", f"{log.height[i]:.3f}", f"{3.6 * log.speed[i]:.3f}",
            f"{log.distance[i]:.3f}", f"{log.width:.3f}", f"{log.flow[i]:.4f}", f"{100 * log.moisture:.2f}",
            "on" if log.working[i] else "off", log.machine, Path(log.crop).stem,
        )  # fmt: skip
        lines.append(",".join(cells))
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, ("\n".join(lines) + "\n").encode())
    return path


def write_isoxml(log: Records, folder: Path) -> Path:
    """Write TASKDATA.XML and TLG00001 into a new or empty folder. Raises InputError for another one."""
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError("--out", str(folder), "expected a new or empty folder, or a name that ends in .csv")
    folder.mkdir(parents=True, exist_ok=True)
    listed = "\n".join(f'<DLV A="{ddi:04X}" B="" C="DET1"/>' for ddi, _ in CHANNELS)
    write_whole(folder / "TLG00001.xml", HEADER.format(listed=listed))
    write_whole(folder / "TLG00001.bin", b"".join(_record(log, i) for i in range(len(log.time))))
    names = {"crop": Path(log.crop).stem, "machine": log.machine, "name": log.name}
    text = TASKDATA.format(**{key: quoteattr(value) for key, value in names.items()})
    write_whole(folder / "TASKDATA.XML", text)
    return folder


def _record(log: Records, i: int) -> bytes:
    """Time, place and all channels of a record (ISO 11783-10, annex D)."""
    when = BEGUN + timedelta(seconds=float(log.time[i])) - EPOCH
    values = (log.width, log.flow[i], 100.0 * log.moisture, float(log.working[i]), log.speed[i])
    head = struct.pack(
        "<IHiiiB", when.seconds * 1000 + when.microseconds // 1000, when.days, round(log.lat[i] * 1e7),
        round(log.lon[i] * 1e7), round(log.height[i] * 1e3), 4,
    )  # fmt: skip
    counts = np.rint([v / unit for v, (_, unit) in zip(values, CHANNELS, strict=True)]).astype(int)
    pairs = b"".join(struct.pack("<Bi", k, int(count)) for k, count in enumerate(counts))
    return head + struct.pack("<B", len(counts)) + pairs
