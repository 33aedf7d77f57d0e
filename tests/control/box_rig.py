"""A cart beside a combine with a LiDAR above its pipe: what level `rim` sees of the box, and the truth."""

import numpy as np

from swath.runtime.assembly import assemble
from swath.runtime.loop import drive
from swath.scenario.overrides import layered
from swath.scenario.scenario import parse_scenario
from tests.whole.cart_rig import SCENARIO

EYE = "{level: empirical, sensor: ouster-os1-64, rate_hz: 10, sector_deg: [-65, 65], mount: {%s}%s}"
MOUNT = "at: axle, x_m: -0.6, y_m: 5.2, z_m: 6.8, pitch_deg: 48, yaw_deg: 90"
DUST = ", weather: {extinction_per_m: 0.1, near_returns: 0.1}"
THICK = ", weather: {extinction_per_m: 1.0, near_returns: 0.9}"


def lidar(air="", level="rim"):
    """A scanner above the pipe, and the level that finds the box."""
    return "combine.lidar=" + EYE % (MOUNT, air), f"combine.box={{level: {level}, rate_hz: 10}}"


def look(*sets, ahead=0.0, left=8.4, heading=0.0, fill=0.5, seconds=0.35, seed=1, sees=None, air=""):
    """(seen, truth) of the last look. sees: sensors and level, none = a LiDAR in this air.

    ahead, left: middle of the box from the pipe's pivot and from the middle of the combine [m]
    heading: of the cart against the combine [deg]; fill: of the struck box, above 0.8 poured in cones
    """
    turn = np.radians(90.0 + heading)
    back = 0.3 - 5.8  # from the tractor's axle to the middle of the box [m]
    x, y = 6.0 - left, -4.78 + ahead  # the combine's axle starts at (6, -4.2), its pivot 0.6 m behind
    start = x - back * np.cos(turn), y - back * np.sin(turn)
    world = assemble(parse_scenario(SCENARIO, sets=layered([
        f"seed={seed}",
        *(lidar(air) if sees is None else sees),
        "combine.box_truth={level: truth, rate_hz: 50}",
        "cart.motion={level: kinematic, start_speed_kmh: 4.32}",
        f"cart.start={{x_m: {start[0]}, y_m: {start[1]}, heading_deg: {90.0 + heading}}}",
        f"cart.heap.start_percent={100.0 * min(fill, 0.8)}",
    ], sets)))  # fmt: skip
    found = Looks(world, fill)
    drive(world, [found], until_s=seconds)
    return found.seen, found.truths[min(found.truths, key=lambda t: abs(t - found.seen.t))]


class Looks:
    """Observer: keeps the newest find and the truth by time. Pours what is beyond 80 % at the start."""

    def __init__(self, world, fill):
        self.world, self.rest = world, max(fill - 0.8, 0.0)
        self.seen, self.truths = None, {}

    def __call__(self, slot, t, outputs):
        if slot == "cart.motion" and t > 0 and self.rest:
            self._pour()
        if slot == "combine.box_truth":
            self.truths[outputs["box"].t] = outputs["box"]
        if slot == "combine.box":
            self.seen = outputs["box"]

    def _pour(self):
        heap = self.world.bodies.boxes["cart.trailer"]
        box = heap.box
        volume = self.rest * box.length * box.width * box.depth
        reach, pose = 0.5 * (box.length - box.width), self.world.bodies.pose_of("cart.trailer")
        for place in np.linspace(-reach, reach, 13):
            heap.pour(volume / 13 * heap.density, place, 0.0, self.world.field, pose)
        self.rest = 0.0


def errors(seen, truth):
    """Along, across, height of the rim [m], heading [deg], largest of the profile [m], share of it seen."""
    dx, dy = seen.x - truth.x, seen.y - truth.y
    c, s = np.cos(truth.heading), np.sin(truth.heading)
    grain = seen.profile - truth.profile
    known = np.isfinite(grain)
    worst = float(np.abs(grain[known]).max()) if known.any() else np.nan
    turn = np.degrees(seen.heading - truth.heading)
    return c * dx + s * dy, c * dy - s * dx, seen.rim_height - truth.rim_height, turn, worst, known.mean()
