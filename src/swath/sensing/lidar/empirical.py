"""LiDAR level `empirical`: one ray per beam against bodies, and a depth drawn from a fitted table.

The paper's second approach. Ground with stubble, obstacles and the canopy are bodies; how deep a beam goes
into the canopy is drawn from the distribution of measured heights that a stand of this density and height
shows under this depression and spot. Neighbouring beams draw alike (AR(1) on normal scores along a scan
line). The draw is an optical depth, so crop adds up along the beam wherever it stands: over the top, through
the side wall at the edge, through gaps. Sweeps are independent of each other.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np

from swath.core import portable
from swath.core.component import Outputs
from swath.core.errors import InputError, SwathError, some_of
from swath.core.random import Stream
from swath.core.registry import Beyond, Checked, KnownError, Level
from swath.core.together import InWorlds
from swath.field.crop_sheet import copied_from, load_crop
from swath.field.field import Field
from swath.field.memory_layout import Organ
from swath.field.site_setup import SiteSetup
from swath.field.solid.solids import solid_count
from swath.kernels import Repeated, of_worlds, start_warp
from swath.kernels import filled as made
from swath.rays.bodies import TOP_ROOM
from swath.rays.field_arrays import LiveScene
from swath.rays.refusals import check_origins
from swath.rays.spread import AXES, SpreadTable
from swath.sensing import AIR
from swath.sensing.lidar.sweeps import Sweeps
from swath.sensing.scanner import OutdoorParams, ScanningLidar
from swath.sensing.single import SingleRays
from swath.sensing.tables import load_table, table_names, valid_range
from swath.signals import F64, U8, MachineState

MOST_SHOWN = 5  # keys in a note
LOOKED_AT = 200  # echoes of a scan
NO_CROP = (Organ.NONE, Organ.GROUND, Organ.STRAW, Organ.STUBBLE, Organ.SOLID)
IS_CROP = ~np.isin(list(Organ), NO_CROP)  # by organ
# Of each axis of a table, in a note: how beams met what they met, and its name.
AXIS_WORDS = (("with a stem density", "density"), ("with a height", "height"),
        ("at an angle to the ground", "angle"), ("with a spot diameter", "diameter"))  # fmt: skip
QUANTITIES = ("stems_per_m2", "crop_height_m", "depression_deg", "spot_mm")  # of a run, of each axis
COMPARED = {"wheat": (120.0, 600.0), "barley": (200.0, 550.0), "rye": (250.0, 300.0), "rape": (40.0, 50.0)}
"""Stems per m2 for which scans were compared with those of `plants`, tests/sensing/test_empirical.py."""
DRIVEN = {"wheat": (120.0, 1170.0), "barley": (200.0, 1000.0), "rye": (87.0, 770.0)}
"""Stems per m2 up to which runs were drawn beyond that, benchmarks/credibility.py."""
MOVED = "lateral_rms_m", "lateral_p95_m", "edge_rmse_m", "least_clearance_m", "rollover_count"


def _beyond(low: float, high: float, *moved: float) -> Beyond:
    """By how much metrics were off `plants` at most, 16 pairs of drawn runs of 25 m. moved: of MOVED."""
    by = dict(zip(MOVED, moved, strict=True))
    return Beyond(low, high, by, {"edge": "likelihood_ratio"}, "benchmarks/credibility.py")


CHECKED = (
    Checked("lean_deg", 0.0, 20.0, "tests/sensing/test_empirical.py", "sibling"),
    Checked(
        "wind_lean_deg",
        0.0,
        0.0,
        "its crop stands still",
        "left out",
        _beyond(0.0, 13.5, 0.166, 0.247, 0.236, 0.105, 0.0),
    ),
    Checked(
        "weeds_per_m2",
        0.0,
        0.0,
        "it sees no weeds",
        "left out",
        _beyond(0.0, 35.7, 0.218, 0.311, 0.274, 0.080, 0.0),
    ),
)
BIASED = "edge_rmse_m", "edge_bias_m", "lateral_rms_m", "lateral_p95_m", "lateral_bias_m"
BIAS = 0.03, "plants", "benchmarks/ranking.py"  # [m], of ten detectors on stands of wheat and rye
LODGED = 1 << 8  # flag of the caster: a beam met crop that leans by more than 20 deg


def compared_stems(table: SpreadTable, level: str = "empirical") -> Checked | None:
    """Range of stems per m2 within which a table was compared with `plants`, None where it was not.

    level: that uses it, on which runs beyond the range depend
    """
    crop = str(table.about.get("crop"))
    if crop not in COMPARED:
        return None
    beyond = (
        _beyond(*DRIVEN[crop], 0.049, 0.081, 0.052, 0.037, 0.0)
        if level == "empirical" and crop in DRIVEN
        else None
    )
    return Checked("stems_per_m2", *COMPARED[crop], "tests/sensing/test_empirical.py", "sibling", beyond)


@dataclass(frozen=True)
class Params(OutdoorParams):
    """table: of the spread, by name or as npz file; none = that of the field's crop and the echo rule.

    echo: the rule the table was made for, `percentile` means the median of the spot
    """

    table: str | None = None
    echo: Literal["percentile", "nearest"] = "percentile"


class TableLidar(InWorlds, ScanningLidar):
    """A scanner whose beams go into crop as a table says.

    beam: keywords of `pack_canopy`; swept: (1,) sweeps so far
    """

    kept = ("ray_count", "_clamped", "_notes", "_window")
    gains = False
    level: ClassVar[str]

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        self.swept = np.zeros(1, np.int64)
        super().__init__(params, setup)
        self.params = params
        crop = setup.field.stand.crop
        original, self._about_crop = _original(crop, self.level)
        if params.table is None and Path(original).is_absolute():
            like = f"no bundled crop is like {Path(crop).name}"
            raise InputError("table", None, f"expected a table: {like}; `swath calibrate lidar` makes one")
        name = params.table or table_name(original, params.echo)
        if params.table is None and name not in table_names():
            none = f"none is bundled for {original} with echo {params.echo}"
            expected = f"expected a table: {none}; take level plants, or make one: `swath calibrate lidar`"
            raise InputError("table", None, expected)
        self._table_name = name
        self.table = load_table(name, setup.base)
        _check_reading(self.table, params, crop, original)
        self.rays = SingleRays(self.scanner)
        beam = self.sheet.beam
        self.beam = {
            "crop_height": load_crop(crop).stand.height,
            "exit_diameter": float(np.mean(beam.exit_diameter)),
            "divergence": float(np.mean(beam.divergence)),
        }
        self._notes: list[str] = []
        self._clamped = 0

    @property
    def ray_count(self) -> int:
        """Since the start."""
        return int(self.swept[0]) * len(self.azimuth)

    @ray_count.setter
    def ray_count(self, value: int) -> None:
        self.swept[0] = value // max(len(self.azimuth), 1)

    def begin(self, stream: Stream) -> None:
        """Nothing noted yet."""
        self._notes, self._clamped = [], 0
        ScanningLidar.reset(self, stream)
        self.rays.reset(stream)

    @property
    def notes(self) -> list[str]:
        """What the user of a run should know of the scanner, of what this level cannot see, and of the table,
        each once.
        """
        about = [self._about_crop] if self._about_crop else []
        return [*self.scanner.notes, *about, *self._notes]

    def labels(self) -> U8:
        """Of the echoes of the newest scan."""
        return self.rays.labels(self.setup)

    def note(self, clamped: int) -> None:
        """Note once what ranges of the table beams left. clamped: flags as of `BodyCaster.cast_beams`."""
        new = clamped & ~self._clamped
        if not new:
            return
        self._clamped |= new
        if new & LODGED:
            text = "crop that leans by more than 20 deg is measured by the table of upright crop"
            self._notes.append(f"lidar {self.level}: {text}")
        for k, (what, grid) in enumerate((("crop", self.table.standing), ("stubble", self.table.stubble))):
            for axis, (key, (low, high)) in enumerate(valid_range(grid).items()):
                if new >> (len(AXES) * k + axis) & 1:
                    how, name = AXIS_WORDS[axis]
                    unit = key.rpartition("_")[2] if axis else "per m2"
                    met = f"some beams met {what} {how} outside {low:g} to {high:g} {unit}"
                    used = f"the range of its table: the nearest {name} in it was used"
                    self._notes.append(f"lidar {self.level}: {met}, {used}")

    @property
    def checked(self) -> Sequence[Checked]:
        """Ranges of the checks of this level: axes of its table; stems per m2 where they were compared."""
        ends = dict(zip(QUANTITIES, valid_range(self.table.standing).values(), strict=True))
        del ends["stems_per_m2"]
        source = f"range of its table {self._table_name}"
        found = [Checked(name, low, high, source, "sibling") for name, (low, high) in ends.items()]
        compared = compared_stems(self.table, self.level)
        return found if compared is None else [compared, *found]

    def note_met(self, state: MachineState) -> tuple[Any, ...]:
        """Some echoes of the newest scan in standing crop: distances, directions, origins; and what it meets
        as every scanner.
        """
        beams = self.rays.beams
        in_crop = IS_CROP[beams.kind[: beams.count]].nonzero()[0]
        in_crop = in_crop[:: 1 + len(in_crop) // LOOKED_AT]
        distance = beams.distance[in_crop].astype(np.float64)
        return distance, beams.directions[in_crop], beams.origins[in_crop], ScanningLidar.meets(self, state)

    def met(self, notes: Sequence[Any]) -> Sequence[Mapping[str, Any]]:
        """How these met it: depression against the ground, spot, and the mean lean of the stand there; else
        as every scanner.
        """
        distance, along, origins = (np.concatenate(own) for own in list(zip(*notes, strict=True))[:3])
        x, y, _ = (origins + distance[:, None] * along).T
        ahead = np.hypot(along[:, 0], along[:, 1])
        x_step, y_step = along[:, :2].T / np.maximum(ahead, 1e-6)  # 1 m
        rise = self.rise((x, y), (x_step, y_step))
        spot = self.beam["exit_diameter"] + self.beam["divergence"] * distance
        down = np.degrees(portable.arctan2(rise * ahead - along[:, 2], ahead))
        lean = np.degrees(self.setup.field.stand.lean(x, y)[0])
        found, begin = [], 0
        for far, _, _, others in notes:
            own = slice(begin, begin := begin + len(far))
            seen = {"depression_deg": down[own], "spot_mm": 1e3 * spot[own], "lean_deg": lean[own]}
            found.append({**others, **seen})
        return found

    def meets(self, state: MachineState) -> Mapping[str, Any]:
        """The same of now."""
        return self.met([self.note_met(state)])[0]

    def rise(self, places: tuple[F64, F64], steps: tuple[F64, F64]) -> F64:
        """How far the ground rises on steps around places [m]."""
        (x, y), (dx, dy), ground = places, steps, self.setup.field.ground_height
        return ground(x + 0.5 * dx, y + 0.5 * dy) - ground(x - 0.5 * dx, y - 0.5 * dy)


class EmpiricalLidar(TableLidar):
    """Scans bodies with a moving scanner."""

    level = "empirical"

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        super().__init__(params, setup)
        self.scene = LiveScene(setup.field, "cpu", top_room=TOP_ROOM + 1e-3, has_plants=False)
        self.sight = self.scanner.sight()

    @classmethod
    def together(cls, parts: Sequence["EmpiricalLidar"]) -> "Scanners":
        """Make one object that steps these parts of many worlds together."""
        return Scanners(parts)

    def scan_from(self, t: int, origins: F64, rotations: F64) -> Outputs:
        """A scan from sensor origins (beam_count, 3) and rotations (beam_count, 3, 3) in the world."""
        alone = self._begun()
        assert isinstance(alone, Scanners)
        return alone.scan_from(t, origins, rotations)

    def check_origins(self) -> None:
        """InputError where a beam of the newest sweep starts under the ground, or where there is none."""
        check_origins(self.setup.field, self.rays.beams.origins[: self.rays.beams.count])

    @property
    def notes(self) -> list[str]:
        """Also what this level leaves out of the field."""
        return [*super().notes, *_unseen(self.setup.field)]


class Scanners(Sweeps):
    """The scanners of many worlds, over pages of the field."""

    def __init__(self, parts: Sequence[EmpiricalLidar]) -> None:
        super().__init__(parts)
        self._asks, self._aired = (np.zeros(self.worlds, np.int32) for _ in range(2))
        self._known = np.zeros((self.worlds, 1), np.int64)

    def casts(self, *scanners: Any) -> Sequence[Repeated]:
        """The pages that beams get to, then all beams at once."""
        from swath.rays.kernel.scene import Scene, SolidArrays
        from swath.rays.sight_kernel import Looking, look
        from swath.rays.single.kernel import cast_bodies

        self._known[:] = -1
        self._aired[:] = [part.may_be_disturbed for part in self.parts]
        self._looking = []
        for part, known in zip(self.parts, self._known, strict=True):
            setup, sight, scene = part.setup, part.sight, part.scene
            scene.shown[:] = -1
            before = {"counters": setup.field.store.counters, "bodies": setup.bodies.changes, "known": known}
            looks = {"whole": sight.whole, "real": sight.real, "shown": scene.shown}
            self._looking.append(made(Looking, growth=1.0 + scene.top_room, **before, **looks))
        self._scenes: list[Any] = [Scene() for _ in self.parts]
        self._solids: list[Any] = [SolidArrays() for _ in self.parts]
        scenes, solids = of_worlds(Scene, self._scenes), of_worlds(SolidArrays, self._solids)
        self._rows = scenes.numpy(), solids.numpy()  # the same memory
        asked, looking = (self.needs, self.active), of_worlds(Looking, self._looking)
        return [
            self.launch(look, *asked, looking, scenes, self._asks),
            self.launch(cast_bodies, *asked, self._asks, scenes, solids, *scanners, self._aired),
        ]

    def scan_from(self, t: int, origins: F64, rotations: F64) -> Outputs:
        """A scan of the only world, see `EmpiricalLidar.scan_from`."""
        if self._launches is None:
            self.link({}, {"state": self._long("state", None)}, self.clock)
        self.clock[:] = t, t, 0
        self.parts[0].rays.place(t, origins, rotations)
        self.counts[:], self.swept[:] = 0, self.swept + 1
        self.go(1)
        if self.errors:
            raise self.errors.pop(0)
        return {name: row.of(0) for name, row in self.sent_at(t).items()}

    def supply(self, stage: int) -> None:
        """Also what is not in memory, and what the air does to a sweep."""
        super().supply(stage)
        if stage == self._cast - 1:
            for world in np.flatnonzero(self._asks).tolist():
                self._try(world, self._bring)
        elif stage == self._cast:
            for world in np.flatnonzero((self._aired != 0) & self.active).tolist():
                self._try(world, self._disturb)

    def _try(self, world: int, supply: Callable[[int], None]) -> None:
        if world not in self.errors:
            try:
                supply(world)
            except SwathError as error:
                self.errors[world] = error

    def _bring(self, world: int) -> None:
        """The pages that its beams get to, and all that it sees as it is now."""
        wp, part = start_warp(), self.parts[world]
        beams, setup = part.rays.beams, part.setup
        part.sight.ensure(beams.origins[: beams.count], beams.directions[: beams.count])
        if solid_count(solids := setup.solids()) or self._solids[world].count:
            self._solids[world] = part.scene.solid_arrays(wp, solids)
        self._scenes[world] = part.scene.refresh(wp)
        self._rows[0][world] = self._scenes[world].numpy_value()
        self._rows[1][world] = self._solids[world].numpy_value()
        is_moving = bool(setup.bodies.beside(setup.name))
        self._known[world] = -1 if is_moving else setup.bodies.changes[0]
        self._asks[world] = 0

    def _disturb(self, world: int) -> None:
        """What the air does to the newest sweep."""
        part, t = self.parts[world], int(self.clock[1])
        beams, n = part.rays.beams, part.rays.beams.count
        met = np.where(beams.kind[:n] > 0, beams.distance[:n], np.nan)[:, None]
        air = part.air(t, beams.origins[:n], beams.directions[:n], met)
        part.rays.disturb(air)
        if (window := part.scanner.window) is not None:
            self.sent["window"].put(world, window.told)


def _unseen(field: Field) -> list[str]:
    """What of a field this level leaves out."""
    found = []
    if field.wind is not None:
        found.append("wind: the crop stands still")
    if field.stand.weeds is not None:
        found.append("weeds")
    return [f"lidar empirical does not see {what}" for what in found]


def table_name(crop: str, echo: str) -> str:
    """Name of the bundled table of a crop and an echo rule."""
    return f"{crop}-{'median' if echo == 'percentile' else echo}"


def _original(crop: str, level: str) -> tuple[str, str]:
    """The bundled crop that a crop is copied from, or itself: whose tables it may use; and a note on that."""
    found = copied_from(crop)
    if found is None:
        return crop, ""
    name, differing = found
    shown = some_of(differing, MOST_SHOWN)
    other = f"other numbers are {shown}" if differing else "all numbers are the same"
    return (
        name,
        f"lidar {level}: {Path(crop).name} is measured as {name}, which it was copied from: {other}",
    )


def _check_reading(table: SpreadTable, params: Params, crop: str, original: str) -> None:
    reading = table.about.get("reading")
    rule = reading.get("echo") if isinstance(reading, dict) else None
    if rule is not None and rule != params.echo:
        raise InputError("table", params.table, f"expected one made for echo: {params.echo}, it says {rule}")
    made_for = table.about.get("crop")
    same = made_for == original or Path(str(made_for)).name == Path(crop).name
    if made_for is not None and not same:
        raise InputError("table", params.table, f"expected one made for {crop}, it says {made_for}")


LEVEL = Level(
    EmpiricalLidar,
    Params,
    "bodies, one ray per beam, with a fitted spread of the measured height",
    cost="1/20 to 1/32 of plants with 37 sub-rays",
    tolerance="heights against plants: Wasserstein-1 2 cm, KS 0.10, ground share 0.05",
    checked=(*CHECKED, *AIR),
    errors=tuple(KnownError(metric, *BIAS) for metric in BIASED),
)
