"""A process and a powertrain driven over even ground, without field and world."""

from swath.core.frames import Pose
from swath.core.schedule import NS
from swath.machine.powertrain.hydrostat import HydrostatPowertrain
from swath.machine.powertrain.hydrostat import Params as DriveParams
from swath.machine.process import organs
from swath.machine.process.threshing import Params, ThreshingProcess
from swath.scenario.slots import CATALOGUE
from swath.signals import CropFlow, MachineState
from tests.machine.machine_fakes import STREAM, Ground, site

WIDTH = 12.0  # of the header [m]
GRAIN, STRAW = 0.97, 0.97 * 0.65  # of the record's wheat [kg/m2]


def state(t, x, speed, roll=0.0, pitch=0.0):
    return MachineState(t, Pose.from_euler((x, 0.0, 0.0), roll, pitch), speed, 0.0, 0.0, 0.0, x)


def flow(t, grain, straw, dt):
    return CropFlow(t, grain, straw, 1.0, 500, 1.0, dt)


class Row(ThreshingProcess):
    """The process `organs` behind organs of its own, wired as their slots are; levels and keys by slot."""

    outputs = organs.Organs.outputs
    _held, _organ_loads = organs.Organs._held, organs.Organs._organ_loads

    def __init__(self, setup, levels=(), keys=(), **params):
        super().__init__(Params(**params), setup)
        self.settings = None
        self._organs = {n: self._made_of(n, dict(levels), dict(keys), setup) for n in self._organs}

    @staticmethod
    def _made_of(slot, levels, keys, setup):
        level = levels.get(slot, CATALOGUE.default_level(slot))
        if not isinstance(level, str):
            return level
        found = CATALOGUE.registry.get(slot, level)
        return found.component(found.params and found.params(**keys.get(slot, {})), setup)

    def step(self, t, dt, inputs):
        self._bring(("settings", "settings"), self.settings)
        return super().step(t, dt, inputs)


class Rig:
    """Machine at a wanted speed [m/s]; `crop` gives grain and straw [kg/m2] at x."""

    def __init__(self, *, engine=True, rated_power_kw=None, dt=0.1, crop=None, process=None, **params):
        self.ground = Ground()
        self.site = site(self.ground, period=dt)
        self.process = process or ThreshingProcess(Params(**params), self.site)
        self.load = self.process.reset(STREAM)["load"]
        drive = DriveParams(rated_power_kw=rated_power_kw)
        self.drive = HydrostatPowertrain(drive, self.site) if engine else None
        self.engine = self.drive.reset(STREAM)["engine"] if engine else None
        self.crop = crop or (lambda x: (GRAIN, STRAW))
        self.dt, self.t, self.x, self.speed = round(dt * NS), 0, 0.0, None
        self.grain = self.straw = 0.0
        self.rows = []

    def step(self, wanted, roll=0.0, pitch=0.0):
        h = self.dt / NS
        if self.speed is None:
            self.speed = wanted
        limit = self.engine.speed_limit if self.engine else wanted
        aim = min(wanted, limit)
        self.speed = min(max(aim, self.speed - 0.8 * h), self.speed + 0.5 * h)
        grain, straw = (m * WIDTH * self.speed * h for m in self.crop(self.x))
        self.x += self.speed * h
        self.grain, self.straw = self.grain + grain, self.straw + straw
        here = state(self.t + self.dt, self.x, self.speed, roll, pitch)
        inputs = {"flow": (flow(self.t + self.dt, grain, straw, h),), "state": here, "engine": self.engine}
        made = self.process.step(self.t, self.dt, inputs)
        self.load, self.organs = made["load"], made.get("organs")
        if self.drive:
            self.engine = self.drive.step(self.t, self.dt, {"state": here, **made})["engine"]
        self.t += self.dt
        self.rows.append((self.load, self.engine, self.speed))
        return self.load

    def run(self, wanted, seconds, **slope):
        for _ in range(round(seconds * NS / self.dt)):
            self.step(wanted, **slope)
        return self.load

    def balance(self):
        """Relative errors of grain and straw."""
        load = self.load
        grain = load.tank_gain + load.lost_grain + load.held_grain
        return abs(grain - self.grain) / self.grain, abs(
            load.dropped_straw + load.held_straw - self.straw
        ) / self.straw
