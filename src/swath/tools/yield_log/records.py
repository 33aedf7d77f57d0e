"""The records of a yield monitor, made from the tracks of a run.

They are written as CSV, or as task data of ISO 11783-10 with one time log.
"""

import os
import struct
import zlib
from dataclasses import dataclass
from datetime import datetime, timedelta
from decimal import Decimal
from pathlib import Path
from typing import NamedTuple

import numpy as np

from swath import __version__
from swath.core.errors import Extra, InputError, check_within
from swath.core.files import whole_file
from swath.core.files.output_folder import held
from swath.core.files.whole_file import write_whole
from swath.core.foreign_code import code_unread
from swath.core.number_text import num
from swath.core.typed_numbers import numbers_in
from swath.field.crop_sheet import load_crop
from swath.field.maps.projection import Origin, origin_at
from swath.field_io.folder import read_origin
from swath.machine.machine_sheet import load_machine
from swath.record.tracks import read_tracks
from swath.runtime.field_setup import stated_origin
from swath.scenario.scenario import Scenario, load_scenario
from swath.signals import F64, Mask

NOWHERE = (52.0, 9.0)  # lat, lon [deg] of a field that lies nowhere on Earth
IDLE = 0.01  # kg/s below which nothing is cut


@dataclass(frozen=True)
class Records:
    """One entry per record, shape (n,). time [s] from the start; lat, lon [deg], height [m]; speed [m/s].

    distance: since the record before [m]
    flow: grain at the sensor [kg/s]
    working: header in the crop.
    width: of the header [m]
    moisture: share of the wet mass
    crop: data sheet
    name: of the run.
    """

    time: F64
    lat: F64
    lon: F64
    height: F64
    speed: F64
    distance: F64
    flow: F64
    working: Mask
    width: float
    moisture: float
    crop: str
    machine: str
    name: str

    @property
    def grain_kg(self) -> float:
        """Grain that passed the sensor [kg]."""
        return float((self.flow * np.diff(self.time, prepend=0.0)).sum())


def place(text: str | None) -> tuple[float, float]:
    """Latitude and longitude [deg] of `52,9`. Raises InputError."""
    if text is None:
        return NOWHERE
    lat, lon = numbers_in("--origin", text, ("deg",) * 2, "LAT,LON in degrees, like 52,9")
    if not (abs(lat) <= 84.0 and abs(lon) <= 180.0):
        raise InputError("--origin", text, "expected a latitude of at most 84 and a longitude of at most 180")
    return lat, lon


def records_of(
    run: Path, *, machine: str | None = None, interval: float = 1.0, delay: float = 0.0,
    at: tuple[float, float] = NOWHERE,
) -> Records:  # fmt: skip
    """The log of one machine of a run folder.

    machine: default: the first with a tank; interval: of the records [s]; delay: of the sensor behind the
    inlet of the tank [s]; at: lat, lon [deg] of the origin where the field has none
    Raises InputError for a folder that is no run, or holds no such machine.
    """
    check_within("--interval-s", interval, 0.05, 60.0)
    check_within("--sensor-delay-s", delay, 0.0, 60.0)
    if not os.path.isfile(run / "tracks.parquet"):
        raise InputError(
            "run", str(run), "expected a run folder with tracks.parquet (run.record other than none)"
        )
    tracks = read_tracks(run / "tracks.parquet")
    with code_unread():
        scenario = load_scenario(run)
    harvesters = [name for name, m in scenario.machines.items() if m.has("process")]
    name = machine or next(iter(harvesters), "")
    if name not in harvesters or "tank_grain_kg" not in tracks:
        raise InputError(
            "machine", name, f"expected a harvester of the run: {', '.join(harvesters) or 'none'}"
        )
    own = tracks["machine"] == name
    columns = {k: np.asarray(v[own], dtype=float) for k, v in tracks.items() if k != "machine"}
    t = columns["t_s"]
    at_record = np.arange(interval, t[-1] + 1e-9, interval) if len(t) else t
    if not len(at_record):
        raise InputError("run", str(run), f"expected a run of at least {num(interval)} s")
    tank = np.nan_to_num(columns["tank_grain_kg"])
    arrived = np.concatenate([[0.0], np.cumsum(np.maximum(np.diff(tank), 0.0))])  # unloading takes it away
    passed = np.interp(np.concatenate([[0.0], at_record]) - delay, t, arrived, left=0.0)
    flow = np.diff(passed) / interval
    x, y, z, speed = (np.interp(at_record, t, columns[k]) for k in ("x_m", "y_m", "z_m", "speed_m_s"))
    cut = np.interp(
        at_record, t, np.nan_to_num(columns.get("grain_flow_kg_s", np.diff(arrived, prepend=0.0)))
    )
    origin = _origin(scenario, at)
    lon, lat = origin.to_lon_lat(np.column_stack([x, y])).T
    section = scenario.machines[name]
    sheet = load_machine(section.sheet.as_posix(), header_width_m=section.common.header_width_m)
    crop = _crop(scenario)
    return Records(
        at_record, lat, lon, z + origin.height, np.abs(speed), np.abs(speed) * interval, flow, cut > IDLE,
        sheet.header_width, load_crop(crop).yields.grain_moisture, crop, name, scenario.name,
    )  # fmt: skip


def _origin(scenario: Scenario, at: tuple[float, float]) -> Origin:
    """Origin of the field, else the place given."""
    if scenario.field.folder is not None:
        return read_origin(scenario.field.folder)
    return stated_origin(scenario.field) or origin_at(*at)


def _crop(scenario: Scenario) -> str:
    """Data sheet of the crop of the stand, or of the field folder."""
    from swath.field_io.folder import read

    stand = scenario.field.stand
    if stand is not None:
        crop = getattr(stand.params, "crop", None)
        if crop is None:
            expected = "expected a stand that names its `crop`; one of your own is read with --allow-code"
            raise InputError("field.stand.level", stand.level, expected)
        return str(crop)
    assert scenario.field.folder is not None
    folder = read(scenario.field.folder)
    return str(folder.path / folder.crop) if folder.crop.endswith(".yaml") else folder.crop


BEGUN = datetime(
    2024, 7, 15, 10, 0, 0
)  # a run has no date: this one, so that the same run gives the same bytes
EPOCH = datetime(1980, 1, 1)
COLUMNS = (
    "timestamp", "latitude", "longitude", "elevation_m", "speed_kmh", "distance_m", "swath_m",
    "grain_flow_kg_s", "moisture_pct", "work_state", "machine", "crop",
)  # fmt: skip


class Channel(NamedTuple):
    """A quantity of the time log. ddi: of ISO 11783-11; scale: unit per count; decimals: that are shown."""

    ddi: int
    scale: str
    decimals: int
    unit: str
    name: str


CHANNELS = (
    Channel(67, "0.001", 2, "m", "Working width"),
    Channel(87, "0.000001", 2, "kg/s", "Crop flow"),
    Channel(99, "0.0001", 1, "%", "Moisture"),
    Channel(141, "1", 0, "", "Work state"),
    Channel(397, "0.001", 2, "m/s", "Speed"),
)
HARVESTER = 0xA00E_8000_FFE0_0000
"""NAME of ISO 11783-5: sets its own address, agriculture, harvester, its first function, maker not known; the
last 21 bits distinguish machines."""
STRUCTURE = b"SWATH01".hex().upper()
LOCALIZATION = "FF000000406E65"  # English, decimal points, 24 h, metric (ISO 11783-7, language command)
LONGEST_NAME = 32  # characters of a designator
TIME_LOG = """<?xml version="1.0" encoding="UTF-8"?>
<TIM A="" D="4"><PTN A="" B="" C="" D=""/>
{listed}
</TIM>
"""


def write_csv(log: Records, path: Path) -> Path:
    """Write CSV; names with units, as `swath field import` and farm software read them."""
    rows = []
    for i, t in enumerate(log.time):
        cells = (
            (BEGUN + timedelta(seconds=float(t))).isoformat(timespec="milliseconds"), f"{log.lat[i]:.8f}",
            f"{log.lon[i]:.8f}", f"{log.height[i]:.3f}", f"{3.6 * log.speed[i]:.3f}",
            f"{log.distance[i]:.3f}", f"{log.width:.3f}", f"{log.flow[i]:.4f}", f"{100 * log.moisture:.2f}",
            "on" if log.working[i] else "off", log.machine, Path(log.crop).stem,
        )  # fmt: skip
        rows.append(dict(zip(COLUMNS, cells, strict=True)))
    return whole_file.write_csv(path, rows, COLUMNS)


def write_isoxml(log: Records, folder: Path) -> Path:
    """Write TASKDATA.XML and TLG00001 into a new or empty folder. Raises InputError for another one."""
    text = _task_data(log)
    listed = "\n".join(f'<DLV A="{c.ddi:04X}" B="" C="DET1"/>' for c in CHANNELS)
    with held(folder, ("TASKDATA.XML", "TLG00001.*"), "log; or a name that ends in .csv"):
        write_whole(folder / "TLG00001.xml", TIME_LOG.format(listed=listed))
        write_whole(folder / "TLG00001.bin", b"".join(_record(log, i) for i in range(len(log.time))))
        write_whole(folder / "TASKDATA.XML", text)
    return folder


def _task_data(log: Records) -> str:
    """TASKDATA.XML: one machine, one field of the size of the ground that was cut, its crop and one task."""
    with Extra("geo", "ISOXML task data"):
        from isoxml.models.base import v4 as iso
        from isoxml.util.isoxml_io import isoxml_to_text
    name, machine = log.name[:LONGEST_NAME], log.machine[:LONGEST_NAME]
    client = (HARVESTER | zlib.crc32(log.machine.encode()) & 0x1F_FFFF).to_bytes(8, "big")
    first = 2  # object ids: the element is 1, then channels, then their presentations
    presented = first + len(CHANNELS)
    device = iso.Device(
        id="DVC1", designator=machine, client_name=client, software_version=f"swath {__version__}",
        structure_label=STRUCTURE, localization_label=LOCALIZATION,
        elements=[
            iso.DeviceElement(
                id="DET1", object_id=1, type=iso.DeviceElementType.Device, designator=machine, number=0,
                parent_object_id=0,
                device_object_references=[iso.DeviceObjectReference(first + k) for k in range(len(CHANNELS))],
            )
        ],
        process_data=[
            iso.DeviceProcessData(
                object_id=first + k, ddi=c.ddi.to_bytes(2, "big"), property=1, trigger_methods=1,
                designator=c.name, device_value_presentation_object_id=presented + k,
            )
            for k, c in enumerate(CHANNELS)
        ],
        value_presentations=[
            iso.DeviceValuePresentation(presented + k, 0, Decimal(c.scale), c.decimals, c.unit or None)
            for k, c in enumerate(CHANNELS)
        ],
    )  # fmt: skip
    cut = float((log.distance * log.width)[log.working].sum())
    task = iso.Task(
        id="TSK1", designator=name, partfield_id_ref="PFD1", status=iso.TaskStatus.Completed,
        device_allocations=[iso.DeviceAllocation(client_name_value=client, device_id_ref="DVC1")],
        time_logs=[iso.TimeLog(filename="TLG00001", type=iso.TimeLogType.BinaryTimelogFileType1)],
    )  # fmt: skip
    data = iso.Iso11783TaskData(
        management_software_manufacturer="swath", management_software_version=__version__,
        data_transfer_origin=iso.Iso11783TaskDataDataTransferOrigin.MICS,
        task_controller_manufacturer="swath", task_controller_version=__version__,
        crop_types=[iso.CropType(id="CTP1", designator=Path(log.crop).stem[:LONGEST_NAME])],
        devices=[device], tasks=[task],
        partfields=[iso.Partfield(id="PFD1", designator=name, area=round(cut), crop_type_id_ref="CTP1")],
    )  # fmt: skip
    return str(isoxml_to_text(data))


def _record(log: Records, i: int) -> bytes:
    """Time, place and all channels of a record (ISO 11783-10, annex D)."""
    when = BEGUN + timedelta(seconds=float(log.time[i])) - EPOCH
    values = (log.width, log.flow[i], 100.0 * log.moisture, float(log.working[i]), log.speed[i])
    head = struct.pack(
        "<IHiiiB", when.seconds * 1000 + when.microseconds // 1000, when.days, round(log.lat[i] * 1e7),
        round(log.lon[i] * 1e7), round(log.height[i] * 1e3), 4,
    )  # fmt: skip
    counts = np.rint([v / float(c.scale) for v, c in zip(values, CHANNELS, strict=True)]).astype(int)
    pairs = b"".join(struct.pack("<Bi", k, int(count)) for k, count in enumerate(counts))
    return head + struct.pack("<B", len(counts)) + pairs
