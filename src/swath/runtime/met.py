"""What a run met: quantities of a machine and the field at every metre of its way.

They are the truth, sampled where the machine is. A quantity is one function of the machine's state and the
field, but where a part says itself what it meets (`core.abilities.Meets`), as one with its own weather does.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import atan, atan2, cos, degrees, inf, nan, pi, sin
from typing import Any

import numpy as np

from swath.core.abilities import Meets
from swath.core.errors import InputError, near_miss
from swath.core.signal import Signal
from swath.core.units import KPA, PERCENT
from swath.field.field import FEW, Field
from swath.field.field_setup import HasRoughness
from swath.field.weather import GREEN, extinction
from swath.machine.motion import FIRM
from swath.runtime.hooks import ActiveRun, RunHook
from swath.runtime.world import Machine
from swath.signals import MachineState

SUMMARY = "met"
EVERY_M = 1.0  # of the way, between two rows
BASE_M = 6.0  # over which a slope is taken: the length of a combine, more than its tyres bridge
AHEAD_M = (0.0, 4.0, 8.0)  # of the knife, where a scanner beside it looks
LOOKED_AT_M = np.stack(np.meshgrid(AHEAD_M, [0.0, 2.0])).reshape(2, -1)  # ahead, and on into the crop
BESIDE_M = 1.0  # from the edge into the crop, where the stand is looked up that the scanner has before it

Told = Mapping[str, Mapping[str, Any]]  # by slot


class Where:
    """Where a machine was, at one time or at several.

    states: of the machine; told: what parts said that they met, by slot, at each of them
    places: of the fixed axle [m], headings: [rad], of each
    crop: to the side of the crop, a point BESIDE_M within the stand beside the header's end at the edge, x
    and y of each [m]; of a machine without a header its fixed axle
    """

    def __init__(
        self, machine: Machine, field: Field, states: Sequence[MachineState], told: Sequence[Told]
    ) -> None:
        self.machine, self.field, self.states, self.told = machine, field, states, told
        knife, end, cuts = 0.0, 0.0, machine.cuts
        self.inward = 1.0 if machine.edge_side == "right" else -1.0
        if cuts:
            knife, end = machine.sheet.header_end(machine.edge_side)
            end += self.inward * BESIDE_M
        self.places: list[tuple[float, float]] = []
        self.headings: list[float] = []
        beside = []
        for state in states:
            x, y, _ = state.pose.point(0.0, 0.0, 0.0)
            ahead_x, ahead_y, _ = state.pose.point(1.0, 0.0, 0.0)
            self.places.append((x, y))
            self.headings.append(atan2(ahead_y - y, ahead_x - x))
            beside.append(state.pose.point(knife, end, 0.0)[:2] if cuts else (x, y))
        self.crop = np.array(beside).T

    @cached_property
    def slopes(self) -> list[tuple[float, float]]:
        """Rise over run across BASE_M, ahead and to the right, in percent."""
        points = []
        for (x, y), heading in zip(self.places, self.headings, strict=True):
            for aside in (0.0, -0.5 * pi):
                c, s = 0.5 * BASE_M * cos(heading + aside), 0.5 * BASE_M * sin(heading + aside)
                points += [(x + c, y + s), (x - c, y - s)]
        few = len(points) if self.field.profile is None else FEW  # beside a profile without a page
        pieces = [np.array(points[k : k + few]).T for k in range(0, len(points), few)]
        ground = np.concatenate([self.field.ground_height(*piece) for piece in pieces]).reshape(-1, 2, 2)
        rises: list[tuple[float, float]] = (100.0 * (ground[..., 0] - ground[..., 1]) / BASE_M).tolist()
        return rises

    def by_field(self, name: str) -> list[float]:
        """A quantity by the field, at each time; nan where there is none."""
        value = QUANTITIES[name].at(self)
        if isinstance(value, float | int):
            return [float(value)] * len(self.states)
        found: list[float] = np.asarray(value, dtype=np.float64).tolist()
        return found

    def values(self, name: str, slots: Sequence[str] | None = None) -> list[float]:
        """A quantity at each time: the most that parts in these slots, None = in any, say in a number, else
        the field's.
        """
        among = self.told[0] if slots is None else slots
        columns: list[list[Any]] = [[told[n].get(name) for told in self.told] for n in among]
        if len(columns) == 1 and set(map(type, columns[0])) <= {float}:
            return columns[0]
        found, by_field = [], list[float]()
        for k in range(len(self.told)):
            said = [column[k] for column in columns if isinstance(column[k], float)]
            by_field = by_field or ([] if said else self.by_field(name))
            found.append(max([v for v in said if v == v], default=nan) if said else by_field[k])
        return found


@dataclass(frozen=True)
class Quantity:
    """unit as in a scenario key; meaning: one line; at: its value by the field at each time, or at all of
    them, nan where there is none.

    touches: kinds of slots that it changes
    plain: values that need no word where a level of these was not checked for it
    little: beyond any range by so much, it changes nothing that a part gives; estimated
    """

    unit: str
    meaning: str
    at: Callable[[Where], Any]
    touches: tuple[str, ...] = ()
    plain: tuple[float, float] = (-inf, inf)
    little: float = 0.0


def _lean(where: Where) -> Any:
    """The most where sensors look, beside the edge and ahead."""
    x, y = where.crop[..., None]
    c, s = np.array([(cos(a), sin(a)) for a in where.headings]).T[..., None]
    ahead, aside = LOOKED_AT_M[0], where.inward * LOOKED_AT_M[1]
    lean = where.field.stand.lean(x + c * ahead - s * aside, y + s * ahead + c * aside)[0]
    return [degrees(most) for most in lean.max(axis=1).tolist()]


def _wind(where: Where) -> float:
    wind = where.field.wind
    return 0.0 if wind is None else degrees(atan(wind.slope_max))


def _weeds(where: Where) -> float:
    weeds = where.field.stand.weeds
    return 0.0 if weeds is None else float(weeds.plants_per_m2)


def _param(kind: str, name: str) -> Callable[[Where], float]:
    """The largest value that a parameter has among the slots of a kind."""

    def at(where: Where) -> float:
        holders = [choice.params for choice in where.machine.slots.values() if choice.kind.name == kind]
        *above, last = name.split(".")
        for part in above:
            holders = [getattr(held, part, None) for held in holders]
        values = [getattr(held, last, None) for held in holders]
        return max((float(v) for v in values if isinstance(v, int | float)), default=nan)

    return at


def _rain(where: Where) -> Any:
    weather = where.field.weather
    return 0.0 if weather is None else [weather.at(state.t).rain for state in where.states]


def _dust(where: Where) -> Any:
    if (weather := where.field.weather) is None:
        return 0.0
    return [extinction(replace(weather.at(state.t), rain=0.0), GREEN) for state in where.states]


def _light(where: Where) -> Any:
    weather = where.field.weather
    lights = [] if weather is None else [weather.light(state.t) for state in where.states]
    return [nan if light is None else light.lux for light in lights] or nan


def _friction(where: Where) -> float:
    own = _param("motion", "friction")(where)
    return own if own == own else where.machine.sheet.dynamics.friction


def _cone_index(where: Where) -> Any:
    soil = where.field.soil
    return nan if soil is None else soil.at(*np.array(where.places).T) / KPA


def _roughness(where: Where) -> float:
    terrain = where.field.terrain
    return terrain.gd_n0 if isinstance(terrain, HasRoughness) else 0.0


CROP = ("lidar", "camera", "radar", "edge", "header", "process", "powertrain", "crop_flow")
SEEN = ("lidar", "camera", "edge")
MOVED = ("motion", "steer", "powertrain")
# Too little to change anything: 0.1 mm/h is the least rain that a gauge reports (WMO-No. 8); it and 1e-4 1/m
# take 0.4 % of the light on 20 m and back, a step of 8 bits; 0.1 deg moves an ear by 2 mm, less than the
# noise of a range; 10 lx make less than 1 % of the noise of a receiver's amplifier.
QUANTITIES: Mapping[str, Quantity] = {
    "ground_speed_kmh": Quantity("km/h", "true forward speed", lambda w: [3.6 * s.speed for s in w.states],
                                 (*MOVED, "header", "process", "gnss", "unload", "radar"), (-1.0, 14.4)),
    "slope_across_percent": Quantity("%", "rise of the ground to the right of the machine, over 6 m",
                                     lambda w: [right for _, right in w.slopes],
                                     (*MOVED, "process"), (-12.0, 12.0)),
    "slope_along_percent": Quantity("%", "rise of the ground ahead of the machine, over 6 m",
                                    lambda w: [ahead for ahead, _ in w.slopes],
                                    (*MOVED, "process"), (-12.0, 12.0)),
    "stems_per_m2": Quantity("1/m2", "sown density of the stand beside the edge",
                             lambda w: w.field.stand.density(*w.crop), CROP, (200.0, 600.0)),
    "crop_height_m": Quantity("m", "usual height of the upright stand beside the edge",
                              lambda w: w.field.crop_height * w.field.stand.height_factor(*w.crop),
                              CROP, (0.5, 1.6)),
    "lean_deg": Quantity("deg", "mean lean of the stand, the most beside the edge or where beams meet it",
                         _lean, CROP, (0.0, 20.0)),
    "yaw_rate_deg_s": Quantity("deg/s", "rate of turn, > 0 left",
                               lambda w: [degrees(s.yaw_rate) for s in w.states],
                               (*MOVED, "gnss"), (-25.9, 25.9)),
    "wind_lean_deg": Quantity("deg", "the most that wind leans stems, on top of their own lean", _wind,
                              ("lidar", "camera", "radar", "edge", "unload"), (0.0, 0.0), 0.1),
    "weeds_per_m2": Quantity("1/m2", "weeds in the stand", _weeds, CROP, (0.0, 0.0)),
    "friction": Quantity("1", "largest side force of the tyres over load", _friction, MOVED, (0.45, 1.5)),
    "cone_index_kpa": Quantity("kPa", "strength of soil that yields, nan = firm", _cone_index, MOVED,
                               (FIRM.low, inf)),
    "roughness_gd_m3": Quantity("m3", "Gd of the ground at 0.1 cycles/m, ISO 8608",
                                _roughness, (*MOVED, "lidar", "header", "imu"), (0.0, 256e-6)),
    "rain_mm_h": Quantity("mm/h", "rain before a sensor", _rain, (*SEEN, "radar"), (0.0, 0.0), 0.1),
    "dust_per_m": Quantity("1/m", "extinction of dust, plumes and fog before a sensor", _dust, SEEN,
                           (0.0, 0.0), 1e-4),
    "light_lx": Quantity("lx", "sun and sky on level ground, for cameras also work lights; nan = none named",
                         _light, ("camera",), (1000.0, 120_000.0)),
    "receiver_light_lx": Quantity("lx", "light on level ground, where receivers of scanners know it",
                                  lambda w: 0.0, ("lidar", "edge"), (0.0, 0.0), 10.0),
    "straw_moisture_percent": Quantity("%", "water in the straw of the stand",
                                       lambda w: [w.field.moisture.of_straw(s.t) / PERCENT for s in w.states],
                                       CROP, (5.0, 18.0)),
    "other_crop": Quantity("1", "1 where the crop is not wheat, else 0",
                           lambda w: float(w.field.stand.crop != "wheat"), CROP, (0.0, 0.0)),
    "cutting_height_m": Quantity("m", "height of the knife that is asked for",
                                 _param("header", "cutting_height_m"), ("lidar", "edge", "header", "process"),
                                 (0.05, 0.4)),
}  # fmt: skip
# those that hang on the field and on parameters alone, wherever the machine is
FIXED = frozenset((
    "wind_lean_deg", "weeds_per_m2", "friction", "roughness_gd_m3", "other_crop", "cutting_height_m",
))  # fmt: skip


def untold(kind: str, known: Collection[str]) -> list[str]:
    """Quantities that change what slots of a kind do, but for known ones."""
    return [name for name, q in QUANTITIES.items() if kind in q.touches and name not in known]


def check_quantities(names: Sequence[str]) -> None:
    """InputError for one that is not known."""
    for name in names:
        if name not in QUANTITIES:
            expected = f"expected one of {', '.join(QUANTITIES)}{near_miss(name, list(QUANTITIES))}"
            raise InputError("met", name, expected)


def told_by(machine: Machine, state: MachineState) -> Told:
    """What its parts say that they meet, by slot."""
    return {n: p.meets(state) for n, p in machine.parts.items() if isinstance(p, Meets)}


class MetHook(RunHook):
    """Writes quantities down along the way of the leading machine."""

    READS_TRACKS = False

    def __init__(self, names: Sequence[str]) -> None:
        check_quantities(names)
        self._names = list(names)

    def begin(self, run: ActiveRun) -> None:
        """Look at the machine's state after every step."""
        self._machine, self._field = run.world.leader, run.world.field
        self._slot = f"{self._machine.name}.motion"
        self._rows: list[tuple[float, ...]] = []
        self._next = 0.0
        run.observers.append(self._see)

    def _see(self, slot: str, t: int, outputs: Mapping[str, Signal]) -> None:
        if slot != self._slot:
            return
        for sample in outputs.values():
            if isinstance(sample, MachineState) and sample.distance >= self._next:
                self._next = sample.distance + EVERY_M
                self._rows.append(self._row(sample))

    def _row(self, state: MachineState) -> tuple[float, ...]:
        where = Where(self._machine, self._field, [state], [told_by(self._machine, state)])
        values = [_rounded(where.values(name)[0]) for name in self._names]
        return (_rounded(state.t / 1e9), _rounded(state.distance), *values)

    def summarize(self, t: int) -> dict[str, Any]:
        """`met`: columns t_s, distance_m and one for each quantity; null for nan."""
        names = ("t_s", "distance_m", *self._names)
        columns = zip(*self._rows, strict=True) if self._rows else [() for _ in names]
        series = {n: [None if v != v else v for v in c] for n, c in zip(names, columns, strict=True)}
        return {SUMMARY: series}


def _rounded(value: float) -> float:
    """Four digits: a line of a journal is read by people and kept by the million."""
    return float(f"{value:.4g}")
