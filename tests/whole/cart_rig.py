"""A combine and a cart on level ground, cheap: kinematic in long steps, no scanner, the edge known."""

import numpy as np

from swath.runtime.assembly import assemble
from swath.runtime.loop import drive
from swath.scenario.scenario import parse_scenario
from swath.signals import HeapState, MachineLoad, MachineState, Station, TrailerState, UnloadState

SCENARIO = """
format: swath scenario 2
name: beside
seed: 1
run: {distance_m: 1000, max_duration_s: 400, on_contact: note}
field:
  terrain: {level: plane}
  stand: {level: uniform, crop: wheat, stems_per_m2: 60}
  edge: {shape: straight, length_m: 1200}
machines:
  combine:
    machine: lexion-700-class
    edge_side: left
    peer: cart
    lidar: off
    imu: off
    motion: {level: kinematic, rate_hz: 50}
    edge: {level: truth, rate_hz: 10}
    odometry: ideal
    process: {level: threshing, tank_start_percent: 100}
    speed: {speed_kmh: 4.32}
    unload: auger
    peer_link: {level: ideal, rate_hz: 10}
    cooperate: unloader
  cart:
    machine: tractor-grain-cart
    peer: combine
    start: {x_m: -2.4, y_m: -1.5, heading_deg: 90}
    motion: {level: kinematic, rate_hz: 50, start_speed_kmh: 3}
    odometry: ideal
    peer_link: {level: ideal, rate_hz: 10}
    cooperate: one_spot
    steer: station
    speed: station
"""
COLUMNS = (
    "t",
    "along",
    "across",
    "spot",
    "flow",
    "drawn",
    "caught",
    "missed",
    "level",
    "speed",
    "full",
    "angle",
)


class Run:
    """Drives the pair and keeps a row of COLUMNS at every step of the auger. sets: as `--set`"""

    def __init__(self, *sets, seconds, base=None, resume=None, scenario=SCENARIO):
        self.world = assemble(parse_scenario(scenario, base=base, sets=list(sets)))
        self.latest, self.rows = {}, []
        if resume is not None:
            self.world.load(resume)
        self.drive_on(seconds, resume=resume is not None)

    def drive_on(self, seconds, resume=True):
        """From where it stands, or the start, to a time."""
        drive(self.world, [self._see], until_s=seconds, resume=resume)
        self.table = np.array(self.rows)

    def __getitem__(self, name):
        return self.table[:, COLUMNS.index(name)]

    def of(self, machine, kind):
        return self.latest[machine, kind]

    def _see(self, slot, t, outputs):
        machine = slot.partition(".")[0]
        for signal in outputs.values():
            self.latest[machine, type(signal)] = signal
        needed = ("combine", MachineState), ("cart", Station), ("cart", HeapState), ("cart", TrailerState)
        if slot == "combine.unload" and all(key in self.latest for key in needed):
            self.rows.append(self._row(t * 1e-9))

    def _row(self, t):
        state, pipe = self.of("combine", MachineState), self.of("combine", UnloadState)
        station, heap = self.of("cart", Station), self.of("cart", HeapState)
        x, y = self.deviation(state, pipe)
        amounts = pipe.flow, pipe.drawn, pipe.caught, pipe.missed, heap.level
        return (t, x - station.spot, y, station.spot, *amounts, state.speed, station.is_full, pipe.angle)

    def deviation(self, state, pipe):
        """Where the stream comes down, from the middle of the box [m]."""
        box, trailer = self.world.machines["cart"].sheet.box, self.of("cart", TrailerState)
        c, s = np.cos(trailer.yaw), np.sin(trailer.yaw)
        there = state.pose.apply([pipe.impact_x, pipe.impact_y, 0.0])
        dx, dy = there[0] - trailer.x - c * box.x, there[1] - trailer.y - s * box.x
        return c * dx + s * dy, c * dy - s * dx

    def while_pouring(self, after=0.0):
        """Rows with grain flowing, from so long after the first one on."""
        flows = self["flow"] > 0.0
        begin = self["t"][flows][0] if flows.any() else np.inf
        return self.table[flows & (self["t"] >= begin + after)]

    @property
    def tank(self):
        return self.of("combine", MachineLoad).tank_grain
