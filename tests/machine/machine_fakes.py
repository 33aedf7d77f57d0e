"""A tiny ground and the wiring of a component, for tests of the machine alone."""

from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np

from swath.core.frames import Pose
from swath.core.random import Stream
from swath.core.schedule import NS
from swath.field.cutting.cut_result import Cut
from swath.field.ground.footprint import Footprint
from swath.field.moisture import Moisture
from swath.field.site_setup import SiteSetup
from swath.machine.machine_sheet import MachineSheet, load_machine

STREAM = Stream(1, "test")
NODE = 1.0 / 64.0  # of the lattice on which a footprint reads heights [m]


def signed_area(polygon):
    """Area [m2] of a polygon, > 0 when anticlockwise."""
    x, y = (np.array(polygon) - polygon[0]).T
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


@dataclass
class Ground:
    """Ground z = height(x, y); records what is done to it. 0.8 kg grain and 0.6 kg straw per m2."""

    height: object = lambda x, y: np.zeros(np.broadcast(x, y).shape)
    cuts: list = field(default_factory=list)
    straw: list = field(default_factory=list)
    grain: list = field(default_factory=list)
    stand: object = field(default_factory=lambda: SimpleNamespace(crop="wheat"))
    moisture: Moisture = field(default_factory=Moisture)
    soil: object = None

    def ground_height(self, x, y):
        return self.height(np.asarray(x), np.asarray(y))

    def footprint(self, points):
        def around(u, v, reach, turn):
            i, j, count = int(u - reach) - 1, int(v - reach) - 1, int(2.0 * reach) + 4
            x, y = np.meshgrid(NODE * np.arange(i, i + count), NODE * np.arange(j, j + count))
            return i, j, self.ground_height(x, y) + np.zeros(x.shape)

        return Footprint(points, (1.0, 0.0), NODE, around)

    def cut(self, polygon, height_m):
        area = signed_area(polygon)
        self.cuts.append(np.array(polygon))
        return Cut(0.8 * area, 0.6 * area, int(500 * area), area)

    def lend(self, tasks, world):
        """Compiled code does not know it."""

    def deposit_grain(self, x, y, mass_kg):
        self.grain.append((x, y, mass_kg))

    def receive(self, mass_kg, place):
        self.deposit_grain(float(place[0]), float(place[1]), mass_kg)

    def deposit_straw(self, polygon, mass_kg, *, heading=None):
        self.straw.append((np.array(polygon), mass_kg))


def slope(along=0.0, left=0.0):
    """Plane ground with a rise per metre of x and of y."""
    return Ground(lambda x, y: along * x + left * y)


def site(ground=None, machine: MachineSheet | None = None, start=None, period=0.01):
    """What a machine's slot is told."""
    return SiteSetup(
        field=ground or Ground(),
        machine=machine or load_machine("lexion-700"),
        start=start or Pose.identity(),
        edge_side="left",
        period=period,
    )


def drive(component, seconds, *, dt=0.01, **inputs):
    """Step a component with constant inputs from t = 0; the list of its outputs (first port)."""
    port = component.outputs[0].name
    step = round(dt * NS)
    return [component.step(i * step, step, inputs)[port] for i in range(round(seconds * NS) // step)]
