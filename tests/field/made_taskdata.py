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
