"""Measurements of machinery makers, weather and clouds of points, for the fuzz."""

import struct
from collections.abc import Callable, Iterator
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np

from tests.fuzz.kind import Kind

DBC = """VERSION ""
NS_ :
BS_:
BU_: ECU OTHER
BO_ 256 Pos: 8 ECU
 SG_ Latitude : 0|32@1- (1e-07,0) [-90|90] "deg" OTHER
 SG_ Longitude : 32|32@1- (1e-07,0) [-180|180] "deg" OTHER

BO_ 257 Drive: 8 ECU
 SG_ Speed : 0|16@1+ (0.01,0) [0|655] "km/h" OTHER
 SG_ HeaderWidth : 16|16@1+ (0.001,0) [0|65] "m" OTHER
 SG_ Page M : 32|8@1+ (1,0) [0|3] "" OTHER
 SG_ Load m0 : 40|8@1+ (0.5,0) [0|125] "%" OTHER
 SG_ Drum m1 : 40|16@1+ (0.125,0) [0|8000] "1/min" OTHER

BO_ 258 Grain: 8 ECU
 SG_ GrainFlow : 0|16@1+ (0.001,0) [0|65] "kg/s" OTHER
 SG_ Moisture : 16|16@1+ (0.01,0) [0|100] "%" OTHER
 SG_ Unloading : 32|2@1+ (1,0) [0|3] "" OTHER

BO_ 2566848574 Engine: 8 ECU
 SG_ EngineSpeed : 24|16@1+ (0.125,0) [0|8031] "1/min" OTHER

CM_ SG_ 258 GrainFlow "of the clean grain elevator";
BA_DEF_ BO_ "Cycle" INT 0 10000;
BA_DEF_ "Bus" STRING;
BA_DEF_DEF_ "Cycle" 100;
BA_DEF_DEF_ "Bus" "CAN";
BA_ "Cycle" BO_ 258 1000;
VAL_ 258 Unloading 0 "off" 1 "on" 3 "not available" ;
SIG_GROUP_ 258 Yield 1 : GrainFlow Moisture;
"""
ROWS = 60


def _numbers(rows: int = ROWS) -> dict[str, tuple[Any, str]]:
    """Name -> (values, unit) of a straight drive, one row a second."""
    t, one = np.arange(rows), np.ones(rows)
    return {
        "Latitude": (52.1 + 1.8e-5 * t, "deg"),
        "Longitude": (10.2 * one, "deg"),
        "Speed": (7.2 * one, "km/h"),
        "HeaderWidth": (9.0 * one, "m"),
        "GrainFlow": (9.0 + 0.1 * (t % 7), "kg/s"),
        "Moisture": (14.0 * one, "%"),
    }


def frames(rows: int = ROWS) -> Iterator[tuple[float, int, bytes]]:
    """(time [s], identifier, data) of the same drive, and a message of several frames."""
    for k, lat, flow in zip(
        range(rows), *(_numbers(rows)[n][0] for n in ("Latitude", "GrainFlow")), strict=True
    ):
        yield k, 256, struct.pack("<ii", round(lat * 1e7), round(10.2e7))
        yield k + 0.01, 257, struct.pack("<HHBHx", 720, 9000, k % 2, 160)
        yield k + 0.02, 258, struct.pack("<HHBxxx", round(flow * 1000), 1400, 1)
        yield k + 0.03, 0x18FF003E, bytes(8)
    for number, data in enumerate(
        (b"\x20\x0a\0\x02\xff\xee\xfe\0", b"\x01abcdefg", b"\x02hij\xff\xff\xff\xff")
    ):
        yield rows + 0.01 * number, (0x1CECFF3E, 0x1CEBFF3E)[number > 0], data


# ---- MF4: channels with conversions of every kind, frames


def write_mf4(path: Path, *groups: Any, version: str = "4.10", **how: Any) -> Path:
    """groups: of (name, values, unit, further arguments of asammdf.Signal), one row a second."""
    from asammdf import MDF, Signal

    with MDF(version=version) as mdf:
        for group in groups:
            mdf.append([Signal(np.asarray(v), np.arange(len(v), dtype=float), name=n, unit=u, **more)
                        for n, v, u, more in group], common_timebase=True)  # fmt: skip
        mdf.save(path, overwrite=True, **how)
    return path


def rows(**more: Any) -> list[tuple[str, Any, str, dict[str, Any]]]:
    """A group of `write_mf4`; more: further arguments of a channel, by its name."""
    return [(name, values, unit, more.get(name, {})) for name, (values, unit) in _numbers().items()]


STRAIGHT = {"a": 0.5, "b": 1.0}
FEW = {"lower_0": 0, "upper_0": 3, "lower_1": 4, "upper_1": 99}
CONVERSIONS: dict[str, dict[str, Any]] = {
    "plain": {},
    "linear": STRAIGHT,
    "rational": {"P1": 0.0, "P2": 2.0, "P3": 1.0, "P4": 0.5, "P5": 0.0, "P6": 1.0},
    "formula": {"formula": "X1*2+1"},
    "steps": {"raw_0": 0.0, "phys_0": 1.0, "raw_1": 9.0, "phys_1": 5.0, "interpolation": False},
    "lines": {"raw_0": 0.0, "phys_0": 1.0, "raw_1": 9.0, "phys_1": 5.0, "interpolation": True},
    "ranges": {**FEW, "phys_0": 1.0, "phys_1": 2.0, "default": 0.0},
    "words": {"val_0": 1, "text_0": "one", "val_1": 2, "text_1": "two", "default_addr": b"none"},
    "ranges of words": {**FEW, "text_0": "few", "text_1": "many", "default_addr": b"none"},
    "flags": {"mask_0": 1, "lower_0": 1, "upper_0": 1, "text_0": "wet", "mask_1": 2, "lower_1": 2,
              "upper_1": 2, "text_1": "full"},
    "nested": {"val_0": 1, "text_0": STRAIGHT, "val_1": 2, "text_1": "two", "default_addr": STRAIGHT},
    "nested ranges": {**FEW, "text_0": STRAIGHT, "default_addr": STRAIGHT,
                      "text_1": {**FEW, "text_0": STRAIGHT, "text_1": "many", "default_addr": STRAIGHT}},
}  # fmt: skip


def _channels(folder: Path) -> None:
    write_mf4(folder / "log.mf4", rows(), rows()[4:])


def _packed(folder: Path) -> None:
    write_mf4(folder / "log.mf4", rows(), compression=2)


def _older(folder: Path) -> None:
    write_mf4(folder / "log.mf4", rows(), version="3.30")


def _converted(folder: Path) -> None:
    made = [(name, np.arange(20), "", {"conversion": deepcopy(how)}) for name, how in CONVERSIONS.items()]
    write_mf4(folder / "log.mf4", made)


def _odd_channels(folder: Path) -> None:
    """Texts, arrays, structures, samples marked as wrong."""
    places = np.zeros(20, [("x", "<f4"), ("y", "<i2")])
    made = {
        "text": (np.array([b"on", b"off"] * 10), {"encoding": "utf-8"}),
        "many": (np.arange(60.0).reshape(20, 3), {}),
        "bytes": (np.arange(160, dtype=np.uint8).reshape(20, 8), {}),
        "place": (places, {}),
        "marked": (np.arange(20), {"invalidation_bits": np.arange(20) % 3 == 0}),
    }
    write_mf4(folder / "log.mf4", *([(name, values, "", more)] for name, (values, more) in made.items()))


def _framed(folder: Path) -> None:
    import can

    (folder / "log.dbc").write_text(DBC)
    with can.MF4Writer(folder / "log.mf4") as writer:
        for message in _messages():
            writer.on_message_received(message)


def _messages() -> Iterator[Any]:
    import can

    for t, identifier, data in frames():
        yield can.Message(
            1.7e9 + t, identifier, is_extended_id=identifier > 0x7FF, data=data, channel=1, is_rx=True
        )


def _logged(name: str, **options: Any) -> Callable[[Path], Any]:
    def make(folder: Path) -> None:
        import can

        (folder / "log.dbc").write_text(DBC)
        with can.Logger(folder / name, **options) as log:
            for message in _messages():
                log(message)

    return make


def read_channels(folder: Path) -> Any:
    """All channels of a log: in blocks, and one after the other."""
    from swath.field_io.logs.channels import open_channels

    log = next(p for p in sorted(folder.iterdir()) if p.name.startswith("log.") and p.suffix != ".dbc")
    found = open_channels(log)
    if found is None:
        return None
    for _ in found.blocks(found.units):
        pass
    return sum(1 for _ in found.samples(found.units)), found.notes


def _played(folder: Path) -> Any:
    """A slot that plays channels."""
    from swath.record.read.files import open_log

    log = open_log(next(folder.glob("log.*[!c]")))
    return log.begin(), log.end(), [1 for _ in log.messages(tuple(log.topics()))]


# ---- a run that plays a measurement, a weather file

SCENARIO = """format: swath scenario 2
name: mine
run: {distance_m: 0.5, record: none}
field: {origin: {latitude_deg: 52.1, longitude_deg: 10.2, height_m: 345}, terrain: {level: plane},
  stand: {level: uniform, crop: wheat}, edge: {shape: straight}WEATHER}
machines:
  combine: {machine: lexion-700-class, lidar: off, edge: truth, steer: previewMORE}
"""


def write_fixes(path: Path, **more: Any) -> Path:
    """Positions at 10 Hz; more: as of `rows`."""
    from asammdf import MDF, Signal

    t = np.arange(100) * 0.1
    values = {"Latitude": (52.1 + t * 1.8e-5, "deg"), "Longitude": (np.full(100, 10.2), "deg"),
              "Altitude": (np.full(100, 345.0), "m")}  # fmt: skip
    with MDF(version="4.10") as mdf:
        mdf.append([Signal(v, t, name=n, unit=u, **more.get(n, {})) for n, (v, u) in values.items()])
        mdf.save(path, overwrite=True)
    return path


PLAYS = ", gnss: {level: log, file: fixes.mf4, topics: {fix: position}, antenna_m: [0, 0, 3]}"


def _plays(folder: Path) -> None:
    write_fixes(folder / "fixes.mf4")
    (folder / "mine.yaml").write_text(SCENARIO.replace("WEATHER", "").replace("MORE", PLAYS))


WEATHER = ", weather: {time: '2026-07-25T13:00+02:00', file: weather.csv}"


def _weather(folder: Path) -> None:
    lines = ["hour,temperature_c,humidity_percent,cloud_percent,wind_m_s,rain_mm_h"]
    lines += [f"{h},{18 + h % 8},{40 + h},50,3.5,0" for h in range(25)]
    (folder / "weather.csv").write_text("\n".join(lines) + "\n")
    (folder / "mine.yaml").write_text(SCENARIO.replace("WEATHER", WEATHER).replace("MORE", ""))


SERVICES = {
    "epw": (
        "LOCATION,A,B,C,D,1,48.1,11.7,1.0,529\nDATA PERIODS,1,1,Data,Sunday,1/1,12/31",
        "1999,7,25,{h1},60,?9,{t},8.0,50,99000" + 10 * ",0" + ",270,4,5,5,20,777,9,9,10,0,0,88,0,0,1",
    ),
    "power": (
        "-BEGIN HEADER-\nT2M  MERRA-2 Temperature (C)\n-END HEADER-\nYEAR,MO,DY,HR,T2M",
        "2026,7,25,{h},{t}",
    ),
    "open-meteo": (
        "latitude,longitude,elevation,utc_offset_seconds\n48,11,500,7200\n\ntime,temperature_2m (°C)",
        "2026-07-25T{h:02d}:00,{t}",
    ),
    "dwd": ("STATIONS_ID;MESS_DATUM;QN_9;TT_TU;RF_TU;eor", "44;20260725{h:02d};3;{t};62;eor"),
}


def _weather_of(service: str) -> Callable[[Path], None]:
    def make(folder: Path) -> None:
        head, row = SERVICES[service]
        rows = [row.format(h=h, h1=h + 1, t=18 + h % 8) for h in range(24)]
        (folder / "weather.csv").write_text("\n".join([head, *rows]) + "\n")
        (folder / "mine.yaml").write_text(SCENARIO.replace("WEATHER", WEATHER).replace("MORE", ""))

    return make


def _built(folder: Path) -> Any:
    """What a scenario with files builds of them, without a step."""
    from swath.runtime.assembly import assemble
    from swath.scenario.scenario import load_scenario

    return assemble(load_scenario(folder / "mine.yaml"))


# ---- clouds of points


def _cloud(name: str) -> Callable[[Path], Any]:
    def make(folder: Path) -> None:
        import laspy

        header = laspy.LasHeader(point_format=6, version="1.4")
        header.scales, header.offsets = np.full(3, 1e-3), np.array([5e5, 5e6, 100.0])
        wkt = 'PROJCS["a",GEOGCS["b",UNIT["degree",0.0174532925199433]],UNIT["metre",1]]'
        header.vlrs.append(laspy.vlrs.known.WktCoordinateSystemVlr(wkt))
        header.global_encoding.wkt = True
        rng = np.random.default_rng(1)
        points = rng.uniform(0.0, 8.0, (3000, 3)) * (1.0, 1.0, 0.1)
        cloud = laspy.LasData(header)
        cloud.x, cloud.y, cloud.z = points.T + np.array([[500_000.0], [5_000_000.0], [100.0]])
        cloud.intensity = rng.integers(0, 60_000, 3000)
        cloud.write(folder / name)

    return make


def _read_cloud(folder: Path) -> Any:
    from swath.tools.compare_scans.clouds import Reading, read_cloud
    from swath.tools.height_map.source import Wanted

    return read_cloud(next(folder.glob("c.*")), Reading(Wanted()))


MEASURED: dict[str, Kind] = {
    "mf4-channels": Kind(_channels, read_channels),
    "mf4-packed": Kind(_packed, read_channels),
    "mf4-older": Kind(_older, read_channels),
    "mf4-conversions": Kind(_converted, read_channels),
    "mf4-odd": Kind(_odd_channels, read_channels),
    "mf4-frames": Kind(_framed, read_channels),
    "mf4-played": Kind(_plays, _built),
    "frames-blf": Kind(_logged("log.blf"), read_channels),
    "frames-blf-plain": Kind(_logged("log.blf", compression_level=0), read_channels),
    "frames-asc": Kind(_logged("log.asc"), read_channels),
    "frames-topics": Kind(_logged("log.blf"), _played),
    "weather": Kind(_weather, _built),
    **{f"weather-{name}": Kind(_weather_of(name), _built) for name in SERVICES},
    "cloud-las": Kind(_cloud("c.las"), _read_cloud),
    "cloud-laz": Kind(_cloud("c.laz"), _read_cloud),
}
