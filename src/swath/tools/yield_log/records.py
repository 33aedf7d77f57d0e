"""The records of a yield monitor, made from the tracks of a run."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.core.foreign_code import code_unread
from swath.field.crop_sheet import load_crop
from swath.field.projection import Origin, origin_at
from swath.field_io.folder import read_origin
from swath.machine.machine_sheet import load_machine
from swath.record.tracks import read_tracks
from swath.runtime.field_setup import stated_origin
from swath.scenario.scenario import Scenario, load_scenario

Array = NDArray[np.float64]
NOWHERE = (52.0, 9.0)  # lat, lon [deg] of a field that lies nowhere on Earth
IDLE = 0.01  # kg/s below which nothing is cut


@dataclass(frozen=True)
class Records:
    """One entry per record, shape (n,). time [s] from the start; lat, lon [deg], height [m]; speed [m/s];
    distance: since the record before [m]; flow: grain at the sensor [kg/s]; working: header in the crop.
    width: of the header [m]; moisture: share of the wet mass; crop: data sheet; name: of the run.
    """

    time: Array
    lat: Array
    lon: Array
    height: Array
    speed: Array
    distance: Array
    flow: Array
    working: NDArray[np.bool_]
    width: float
    moisture: float
    crop: str
    machine: str
    name: str

    @property
    def grain_kg(self) -> float:
        """All that passed the sensor [kg]."""
        return float((self.flow * np.diff(self.time, prepend=0.0)).sum())


def place(text: str | None) -> tuple[float, float]:
    """Latitude and longitude [deg] of `52,9`. Raises InputError."""
    if text is None:
        return NOWHERE
    try:
        lat, lon = (float(part) for part in text.split(","))
    except ValueError:
        raise InputError("--origin", text, "expected LAT,LON in degrees, like 52,9") from None
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
    if not 0.05 <= interval <= 60.0:
        raise InputError("--interval-s", interval, "expected 0.05 to 60")
    if not 0.0 <= delay <= 60.0:
        raise InputError("--sensor-delay-s", delay, "expected 0 to 60")
    if not (run / "tracks.parquet").is_file():
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
        raise InputError("run", str(run), f"expected a run of at least {interval:g} s")
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
    """That of the field, else the place given."""
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
