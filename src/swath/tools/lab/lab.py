"""The lab: a scanner on a carriage over a stand of known density, at every level of the LiDAR.

A case is a stem density, a scanner and a depression of its middle beam. The carriage stops every half metre
on a few passes at random places and headings; at each stop the scanner makes one sweep. It stands so high
that the middle beam is `distance_m` long at the height of the crop: spots are equally large at all angles.
What is compared is the height above the ground of every reported echo, as the scanner itself would place it,
noise and bias included. Each seed is another stand of the same kind under another scanner of the same make;
all levels see the same stands from the same stops.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from swath.core.errors import InputError, check_once, check_within, near_miss
from swath.core.files.temporary import TemporaryFolder
from swath.core.frames import Pose
from swath.core.random import Stream
from swath.core.schedule import NS
from swath.core.units import DEG
from swath.documents.validation import checked, known_keys, unknown_key
from swath.documents.yaml_document import Document
from swath.field.crop_sheet import load_crop
from swath.field.field import Field
from swath.field.site_setup import SiteSetup
from swath.scenario.slots import CATALOGUE
from swath.sensing.lidar_sheet import load_lidar
from swath.sensing.mount import Mount
from swath.signals import F64, MachineState, Scan
from swath.signals.setup import MachineGeometry
from swath.tools.level_stand import level_stand

SUB_RAYS = 37  # of a beam, for levels that have them: as in the tables of `empirical`
REFERENCE = "plants"  # the dearest level, which the others are held against
ADVANCE = 0.5  # from stop to stop [m]
HALF_AREA = 8.0  # passes begin within this of the middle of the stand [m]
ASIDE, CLOSE = 0.3, 0.1  # a pass recorded for replay: so far aside, with stops so close [m]
SPEED = 0.5  # of the clock between stops [m/s]; nothing moves during a sweep

# The carriage: a scanner at the origin of a frame on the ground; the rest is never used.
CARRIAGE = MachineGeometry(1.0, 1.0, 1.0, 0.5, 1.0, 0.5, 0.0, 0.5, 0.5, (-0.5, 0.5, 0.5, 0.0, 0.5))
Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Settings:
    """densities [stems/m2], sensors (sheets), depressions_deg: every combination is a case.

    crop: sheet
    height_m: of the crop, None = the sheet's
    levels: None = all that can be run
    seed: the first one, seeds: how many
    distance_m: of the crop along the middle beam
    half_sector_deg: beams used to either side
    passes, stops: of the carriage, per case and seed
    sets: parameters of the LiDAR, for those levels that know them
    base: where relative file names start
    """

    densities: tuple[float, ...] = (200.0, 600.0)
    sensors: tuple[str, ...] = ("sick-lms511-hr", "sick-lms511-sr")
    depressions_deg: tuple[float, ...] = (15.0, 30.0, 45.0, 60.0)
    crop: str = "wheat"
    height_m: float | None = None
    levels: tuple[str, ...] | None = None
    seed: int = 1
    seeds: int = 5
    distance_m: float = 5.0
    half_sector_deg: float = 10.0
    passes: int = 4
    stops: int = 8
    sets: dict[str, Any] = field(default_factory=dict)
    base: Path = field(default_factory=Path)

    def __post_init__(self) -> None:
        """InputError for a value that cannot be used."""
        for key, values, low, high in (
            ("--stems-per-m2", self.densities, 1.0, 3000.0),
            ("--depression-deg", self.depressions_deg, 5.0, 85.0),
            ("--crop-height-m", () if self.height_m is None else (self.height_m,), 0.05, 4.0),
            ("--distance-m", (self.distance_m,), 1.0, 30.0),
            ("--seeds", (self.seeds,), 1, 100),
            ("--seed", (self.seed,), 0, 2**31),
        ):
            for value in values:
                check_within(key, value, low, high)
        lists: dict[str, tuple[object, ...]] = {
            "--stems-per-m2": self.densities,
            "--sensor": self.sensors,
            "--depression-deg": self.depressions_deg,
            "--levels": self.levels or (),
        }
        for key, names in lists.items():
            check_once(key, names)


@dataclass(frozen=True)
class Case:
    """A stand and a scanner.

    density: stems per m2
    spot: diameter at the crop [m], mean of both directions
    """

    density: float
    sensor: str
    depression_deg: float
    spot: float


@dataclass(frozen=True)
class CaseHeights:
    """Measured heights [m], nan = no return: level -> one array per seed; all of the same stops."""

    case: Case
    heights: dict[str, tuple[F64, ...]]


@dataclass(frozen=True)
class Lab:
    """What came out. levels: in order, the reference first; crop_height [m]; notes: what was left out."""

    settings: Settings
    crop_height: float
    levels: tuple[str, ...]
    cases: tuple[CaseHeights, ...]
    notes: tuple[str, ...]


def run_lab(settings: Settings, progress: Progress = lambda done, total: None) -> Lab:
    """Scan every case with every level and seed. The same settings give the same heights."""
    crop = load_crop(settings.crop, settings.base)
    height = crop.stand.height if settings.height_m is None else settings.height_m
    sheets = {name: load_lidar(name, settings.base) for name in settings.sensors}
    spots = {name: float(sheet.beam.diameter(settings.distance_m).mean()) for name, sheet in sheets.items()}
    cases = [
        Case(n, name, b, spots[name])
        for n in settings.densities
        for name in settings.sensors
        for b in settings.depressions_deg
    ]
    levels, notes = _choose_levels(settings, height)
    found: dict[Case, dict[str, list[F64]]] = {case: {name: [] for name in levels} for case in cases}
    total, done = len(cases) * settings.seeds * len(levels), 0
    for seed in range(settings.seed, settings.seed + settings.seeds):
        for density in settings.densities:
            stand = make_stand(settings, density, seed)
            for case in [c for c in cases if c.density == density]:
                bench = Bench(settings, case, stand, height, Stream(seed, "lab"))
                for name in levels:
                    found[case][name].append(bench.heights(name))
                    done += 1
                    progress(done, total)
    made = tuple(CaseHeights(c, {k: tuple(v) for k, v in rows.items()}) for c, rows in found.items())
    return Lab(settings, height, levels, made, notes)


def make_stand(settings: Settings, density: float, seed: int) -> Field:
    """The stand of one density and seed, on level ground, drilled as the crop's sheet says."""
    crop = load_crop(settings.crop, settings.base)
    stream = Stream(seed, f"lab.stand.{density:g}")
    return level_stand(crop, density, stream, height=settings.height_m, sheet=settings.crop)


class Bench:
    """One case over one stand: the carriage, its stops, and a level of the LiDAR on it."""

    def __init__(self, settings: Settings, case: Case, stand: Field, height: float, stream: Stream) -> None:
        self.settings, self.case, self.stand, self.stream = settings, case, stand, stream
        down = np.sin(case.depression_deg * DEG)
        self.over = height + settings.distance_m * down  # height of the scanner [m]
        outer = down * np.cos(settings.half_sector_deg * DEG)
        self.mount = Mount(at="axle", z_m=float(self.over), pitch_deg=case.depression_deg)
        self.reach = float(1.05 * self.over / outer)
        sheet = load_lidar(case.sensor, settings.base)
        self.setup = SiteSetup(
            stand, CARRIAGE, Pose.identity(), "left", 1.0 / sheet.rates_hz[0], "lab", base=settings.base
        )

    def stops(self, *, aside: float = 0.0, apart: float = ADVANCE, more: float = 0.0) -> list[Pose]:
        """Where the carriage stands [m]. aside: passes moved to the left; more: longer at both ends."""
        rng = self.stream.child("carriage").at()
        start = rng.uniform(-HALF_AREA, HALF_AREA, (self.settings.passes, 2))
        heading = rng.uniform(-np.pi, np.pi, self.settings.passes)
        length = (self.settings.stops - 1) * ADVANCE + 2.0 * more
        along = -more + apart * np.arange(round(length / apart) + 1)
        found = []
        for (x, y), yaw in zip(start.tolist(), heading.tolist(), strict=True):
            c, s = np.cos(yaw), np.sin(yaw)
            found += [
                Pose.from_euler((x + u * c - aside * s, y + u * s + aside * c, 0.0), 0.0, 0.0, yaw)
                for u in along
            ]
        return found

    def heights(self, level: str) -> F64:
        """Heights of the first echoes above the ground [m], (stops * beams,), nan = no return."""
        return np.concatenate([points[:, 2] for points in self.echoes(level)])

    def echoes(self, level: str) -> list[F64]:
        """First echoes in the world as the scanner places them [m], (beams, 3) for each stop, nan = none."""
        if level != "replay" or "file" in self.settings.sets:
            return [points for _, points, _ in self._sweeps(level, self.stops(), {})]
        with TemporaryFolder("lab") as folder:
            more = {"file": str(self._record(folder / "replay.npz"))}
            return [points for _, points, _ in self._sweeps(level, self.stops(), more)]

    def _sweeps(
        self, level: str, stops: Sequence[Pose], more: dict[str, Any]
    ) -> Iterator[tuple[int, F64, Scan]]:
        """Time [ns], first echoes in the world (beams, 3) as the scanner places them, and the scan."""
        params = make_params(self.settings, level, self._parameters(level) | more)
        lidar = CATALOGUE.registry.get("lidar", level, base=self.settings.base).component(params, self.setup)
        lidar.reset(self.stream.child(f"lidar.{self.case.sensor}"))
        mounting, period = self.mount.pose(CARRIAGE, "left"), round(self.setup.period * NS)
        for k, pose in enumerate(stops):
            t = round((k + 1) * ADVANCE / SPEED * NS)
            states = tuple(MachineState(at, pose, 0.0, 0.0, 0.0, 0.0, 0.0) for at in (t, t + period))
            scan = lidar.step(t, period, {"state": states})["scan"]
            yield t + period, (pose @ mounting).apply(scan.points()[:, 0]), scan

    def _parameters(self, level: str) -> dict[str, Any]:
        half = self.settings.half_sector_deg
        mount = {"at": "axle", "z_m": self.mount.z_m, "pitch_deg": self.mount.pitch_deg}
        values = {
            "sensor": self.case.sensor,
            "mount": mount,
            "sector_deg": [-half, half],
            "reach_m": self.reach,
            "sub_rays": SUB_RAYS,
        }
        known = known_keys(CATALOGUE.registry.get("lidar", level, base=self.settings.base).params)
        return {k: v for k, v in values.items() if k in known}

    def _record(self, path: Path) -> Path:
        """A file for replay: passes 0.3 m aside, scanned by the dearest level."""
        from swath.tools.height_map.build import Settings as GridSettings
        from swath.tools.height_map.build import build_height_map
        from swath.tools.height_map.poses import make_track
        from swath.tools.height_map.source import Echoes, Source

        stops = self.stops(aside=ASIDE, apart=CLOSE, more=0.5)
        half = self.settings.half_sector_deg + 2.0 * ASIDE / self.settings.distance_m / DEG
        sweeps = list(self._sweeps(REFERENCE, stops, {"sector_deg": [-half, half]}))
        time = np.array([t for t, _, _ in sweeps]) / NS
        track = make_track(time, [p.position for p in stops], [p.euler() for p in stops])

        def echoes() -> Iterator[Echoes]:
            for (_, _, scan), at in zip(sweeps, time, strict=True):
                points = scan.points()[:, 0]
                seen = np.isfinite(points[:, 0])
                bright = scan.intensity[seen, 0].astype(np.float64)
                yield Echoes(np.full(int(seen.sum()), at), points[seen], bright, int((~seen).sum()))

        source = Source("lab", track, self.mount.pose(CARRIAGE, "left"), echoes)
        grid = build_height_map(source, GridSettings(reach_m=max(self.reach, 1.0)))
        grid.save(path)
        return path


def make_params(settings: Settings, level: str, values: dict[str, Any]) -> Any:
    """Checked parameters of a level: `values`, and those of `settings.sets` that it knows."""
    kind = CATALOGUE.registry.get("lidar", level, base=settings.base).params
    known = known_keys(kind)
    data = values | {k: v for k, v in settings.sets.items() if k in known}
    return checked(kind, Document(data))


def _choose_levels(settings: Settings, height: float) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The levels asked for, or all of the registry that can be made here, the reference first; and notes."""
    have = CATALOGUE.registry.names("lidar")
    asked = have if settings.levels is None else list(settings.levels)
    for name in asked:
        if name not in have and ".py:" not in name and name not in CATALOGUE.registry.installed("lidar"):
            hint = near_miss(name, have)
            raise InputError("--levels", name, f"expected {', '.join(have)}, or file.py:Class{hint}")
    every = {
        k for n in asked for k in known_keys(CATALOGUE.registry.get("lidar", n, base=settings.base).params)
    }
    for key in settings.sets:
        if key not in every:
            raise InputError(f"--set {key}", None, unknown_key(key, sorted(every)))
    names, notes = [], []
    stand = make_stand(settings, settings.densities[0], settings.seed)
    for name in sorted(asked, key=lambda n: n != REFERENCE):
        case = Case(settings.densities[0], settings.sensors[0], settings.depressions_deg[0], 0.0)
        bench = Bench(settings, case, stand, height, Stream(settings.seed, "lab"))
        if name != "replay":
            values = make_params(settings, name, bench._parameters(name))
            try:
                CATALOGUE.registry.get("lidar", name, base=settings.base).component(values, bench.setup)
            except InputError as error:
                if settings.levels is not None:
                    raise
                notes.append(f"{name} left out: {error}")
                continue
        names.append(name)
    return tuple(names), tuple(notes)
