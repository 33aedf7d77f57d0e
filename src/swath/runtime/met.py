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
from swath.field.field import Field
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


@dataclass(frozen=True)
class Where:
    """Where the machine is.

    place: of the fixed axle [m]; heading [rad]
    crop: to the side of the crop, a point BESIDE_M within the stand beside the header's end at the edge [m]
    """

    machine: Machine
    state: MachineState
    field: Field
    place: tuple[float, float]
    heading: float
    crop: tuple[float, float]

    @cached_property
    def slopes(self) -> tuple[float, float]:
        """Rise over run across BASE_M, ahead and to the right, in percent."""
        x, y = self.place
        ends = []
        for aside in (0.0, -0.5 * pi):
            c, s = 0.5 * BASE_M * cos(self.heading + aside), 0.5 * BASE_M * sin(self.heading + aside)
            ends += [(x + c, y + s), (x - c, y - s)]
        ahead, behind, right, left = self.field.ground_height(*np.array(ends).T).tolist()
        return 100.0 * (ahead - behind) / BASE_M, 100.0 * (right - left) / BASE_M

    @cached_property
    def told(self) -> dict[str, Mapping[str, Any]]:
        """What parts say that they meet, by slot."""
        return {n: p.meets(self.state) for n, p in self.machine.parts.items() if isinstance(p, Meets)}

    def value(self, name: str, slots: Sequence[str] | None = None) -> float:
        """A quantity: the most that parts in these slots, None = in any, say in a number, else the field's;
        nan where there is none.
        """
        among = self.told if slots is None else slots
        said = [v for n in among if isinstance(v := self.told[n].get(name), float)]
        known = [v for v in said if v == v]
        return max(known, default=nan) if said else QUANTITIES[name].at(self)


@dataclass(frozen=True)
class Quantity:
    """unit as in a scenario key; meaning: one line; at: its value by the field, nan where there is none.

    touches: kinds of slots that it changes
    plain: values that need no word where a level of these was not checked for it
    little: beyond any range by so much, it changes nothing that a part gives; estimated
    """

    unit: str
    meaning: str
    at: Callable[[Where], float]
    touches: tuple[str, ...] = ()
    plain: tuple[float, float] = (-inf, inf)
    little: float = 0.0


def _lean(where: Where) -> float:
    """The most where sensors look, beside the edge and ahead."""
    (x, y), c, s = where.crop, cos(where.heading), sin(where.heading)
    inward = 1.0 if where.machine.edge_side == "right" else -1.0
    ahead, aside = LOOKED_AT_M[0], inward * LOOKED_AT_M[1]
    return degrees(
        float(where.field.stand.lean(x + c * ahead - s * aside, y + s * ahead + c * aside)[0].max())
    )


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


def _rain(where: Where) -> float:
    weather = where.field.weather
    return 0.0 if weather is None else weather.at(where.state.t).rain


def _dust(where: Where) -> float:
    weather = where.field.weather
    return 0.0 if weather is None else extinction(replace(weather.at(where.state.t), rain=0.0), GREEN)


def _light(where: Where) -> float:
    weather = where.field.weather
    light = None if weather is None else weather.light(where.state.t)
    return nan if light is None else light.lux


def _friction(where: Where) -> float:
    own = _param("motion", "friction")(where)
    return own if own == own else where.machine.sheet.dynamics.friction


def _cone_index(where: Where) -> float:
    soil = where.field.soil
    return nan if soil is None else float(soil.at(*where.place)) / KPA


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
    "ground_speed_kmh": Quantity("km/h", "true forward speed", lambda w: 3.6 * w.state.speed,
                                 (*MOVED, "header", "process", "gnss", "unload", "radar"), (-1.0, 14.4)),
    "slope_across_percent": Quantity("%", "rise of the ground to the right of the machine, over 6 m",
                                     lambda w: w.slopes[1], (*MOVED, "process"), (-12.0, 12.0)),
    "slope_along_percent": Quantity("%", "rise of the ground ahead of the machine, over 6 m",
                                    lambda w: w.slopes[0], (*MOVED, "process"), (-12.0, 12.0)),
    "stems_per_m2": Quantity("1/m2", "sown density of the stand beside the edge",
                             lambda w: float(w.field.stand.density(*w.crop)), CROP, (200.0, 600.0)),
    "crop_height_m": Quantity("m", "usual height of the upright stand beside the edge",
                              lambda w: w.field.crop_height * float(w.field.stand.height_factor(*w.crop)),
                              CROP, (0.5, 1.6)),
    "lean_deg": Quantity("deg", "mean lean of the stand, the most beside the edge or where beams meet it",
                         _lean, CROP, (0.0, 20.0)),
    "yaw_rate_deg_s": Quantity("deg/s", "rate of turn, > 0 left", lambda w: degrees(w.state.yaw_rate),
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
                                       lambda w: w.field.moisture.of_straw(w.state.t) / PERCENT,
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


def where_is(machine: Machine, field: Field, state: MachineState) -> Where:
    """Where a machine is; of one without a header the crop is at its fixed axle."""
    x, y, _ = state.pose.point(0.0, 0.0, 0.0)
    ahead_x, ahead_y, _ = state.pose.point(1.0, 0.0, 0.0)
    beside = 0.0, 0.0
    if machine.cuts:
        knife, end = machine.sheet.header_end(machine.edge_side)
        beside = knife, end - (BESIDE_M if machine.edge_side == "left" else -BESIDE_M)
    crop_x, crop_y, _ = state.pose.point(*beside, 0.0)
    return Where(machine, state, field, (x, y), atan2(ahead_y - y, ahead_x - x), (crop_x, crop_y))


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
        where = where_is(self._machine, self._field, state)
        values = [_rounded(where.value(name)) for name in self._names]
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
