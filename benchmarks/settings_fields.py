"""The settings controller `climb` against a fixed table: in drawn fields on which neither was tuned.

    python -m benchmarks.settings_fields [--fields 30] [--tries 20] [--tuned 6] [--minutes 60] [--known 10]

A combine cuts for a while in wheat whose feed, straw, weeds, hour of the day (straw that dries), moisture,
threshability and slope are drawn, with organs and sensors (`counted`) whose estimates are drawn from their
bands. Each has --tries to tune four settings: the table those it keeps, the controller
those it starts with. Printed: grain lost and broken [kg/ha], what that costs, the 95 % interval of the mean
gain (Student's t, paired by field), and what is there to be won in the first --known fields: by the best
settings of each field, and of each quarter of it, known in hindsight.
"""

import argparse
import sys
from collections.abc import Mapping, Sequence
from copy import copy
from pathlib import Path
from types import SimpleNamespace

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
from scipy.optimize import minimize
from scipy.stats import t as student
from tests.machine.machine_fakes import Ground, site
from tests.machine.organ_trends import FLOW
from tests.machine.process_rig import Row, flow, state

from swath.control.settings import climb, fixed
from swath.core.estimate import estimates
from swath.core.random import Stream
from swath.core.schedule import NS
from swath.core.units import PERCENT
from swath.field.moisture import Moisture
from swath.scenario.slots import CATALOGUE
from swath.signals.settings import own_settings
from swath.tools.tune.optimiser import Measured, optimise
from swath.tools.tune.parameters import Parameter, sets_at

H = 2.0  # step [s]
PRICE, LESS = 0.20, 0.04  # of wheat [EUR/kg]; by how much broken grain and what is beside it are worth less
DRAWN = [
    CATALOGUE.registry.get(*of)
    for of in (("threshing", "model"), ("cleaning", "model"), ("crop_flow", "counted"))
]
SPEED = 2.0  # [m/s]
OWN = own_settings(site().machine.works, "wheat")
RPM, MM = 30.0 / np.pi, 1e3
TABLE = [
    Parameter("drum_rpm", 0.8 * OWN["drum"] * RPM, 1.2 * OWN["drum"] * RPM),
    Parameter("concave_mm", 0.6 * OWN["concave"] * MM, 1.6 * OWN["concave"] * MM),
    Parameter("fan_rpm", 0.85 * OWN["fan"] * RPM, 1.2 * OWN["fan"] * RPM),
    Parameter("upper_sieve_mm", 0.7 * OWN["upper"] * MM, 1.6 * OWN["upper"] * MM),
]


def wandering(rng: np.random.Generator, count: int, length_s: float) -> np.ndarray:
    """A normal process of unit variance that forgets itself over a time: (count,)."""
    kept, found = np.exp(-H / length_s), np.empty(count)
    found[0] = rng.standard_normal()
    for k, new in enumerate(np.sqrt(1.0 - kept**2) * rng.standard_normal(count - 1)):
        found[k + 1] = kept * found[k] + new
    return found


class Field:
    """What is drawn of a field, and of the machine's numbers that nobody knows.

    Straw and weeds in it vary from place to place, as the feed does however it is driven; straw dries from
    25 % at dew with 2 h as time constant, and the grain a little. In moist straw it is driven slower, by as
    much as separation suffers.
    """

    def __init__(self, seed: int, minutes: float) -> None:
        rng = np.random.default_rng([75, seed])
        count = round(60.0 * minutes / H)
        self.seed, self.yielded = seed, rng.uniform(0.6, 1.0)  # [kg/m2]
        feed = rng.uniform(0.7, 1.0) * np.exp(0.15 * wandering(rng, count, 15.0))
        feed *= np.exp(0.1 * wandering(rng, count, 300.0))
        weeds = np.maximum(rng.uniform(0.0, 0.2) * wandering(rng, count, 100.0), 0.0)
        straw = rng.uniform(0.5, 0.8) * np.exp(0.1 * wandering(rng, count, 30.0)) + weeds
        self.roll, self.pitch = (0.04 * wandering(rng, count, 60.0) for _ in range(2))
        self.start_hour, dry, moist = rng.uniform(8, 14), rng.uniform(9, 14), rng.uniform(11, 17)
        hours = self.start_hour + np.linspace(0.0, minutes / 60.0, 13)
        dew = (25.0 - dry) * np.exp(-(hours - 6.0) / 2.0)
        self.moisture = {
            "straw_moisture_percent": tuple(zip(hours, dry + dew, strict=True)),
            "grain_moisture_percent": tuple(zip(hours, moist + 0.2 * dew, strict=True)),
        }
        wet = np.interp(np.arange(count), np.linspace(0, count, 13), dry + dew) * PERCENT
        self.grain = FLOW[0] * feed * np.exp(-2.5 * (wet - 0.12))
        self.straw = self.grain * straw
        drum, shoe, self.sensors = (
            {key: float(rng.uniform(band.low, band.high)) for key, band in estimates(level.params).items()}
            for level in DRAWN
        )
        drum |= {"threshability": float(np.exp(0.15 * rng.standard_normal())), "broken_percent": 0.5}
        self.keys = {"threshing": drum, "separation": drum, "cleaning": shoe}

    def part(self, start: float, minutes: float) -> "Field":
        """Some minutes of it, from others on."""
        part, steps = copy(self), slice(*(round(60.0 * m / H) for m in (start, start + minutes)))
        for name in ("grain", "straw", "roll", "pitch"):
            setattr(part, name, getattr(self, name)[steps])
        part.start_hour = self.start_hour + start / 60.0
        return part


def cut(field: Field, level: object, given: Mapping[str, object]) -> np.ndarray:
    """Grain lost, grain broken, other material in the tank [kg/ha]."""
    ground = Ground()
    ground.stand = SimpleNamespace(crop="wheat")
    ground.moisture = Moisture(**field.moisture, start_hour=field.start_hour)
    setup = site(ground, period=H)
    row = Row(setup, keys=field.keys, unload_at_percent=50.0)
    controller = level.component(level.params(**given), setup)
    counted = CATALOGUE.registry.get("crop_flow", "counted")
    sensors = counted.component(counted.params(**field.sensors), setup)
    stream = Stream(field.seed, "combine.crop_flow")
    made, read = row.reset(stream), sensors.reset(stream)
    row.settings = controller.reset(stream)["settings"]
    step = round(H * NS)
    for k, (grain, straw, roll, pitch) in enumerate(
        zip(field.grain * H, field.straw * H, field.roll, field.pitch, strict=True)
    ):
        at = state(k * step, SPEED * H * k, SPEED, roll=float(roll), pitch=float(pitch))
        made = row.step(k * step, step, {"flow": (flow(k, float(grain), float(straw), H),), "state": at})
        read = sensors.step(k * step, step, made)
        row.settings = controller.step(k * step, step, read)["settings"]
    load, organs = made["load"], made["organs"]
    hectares = field.grain.sum() * H / field.yielded / 1e4
    return np.array([load.lost_grain, organs.tank_broken, organs.tank_mog]) / hectares


def cost(kg_ha: np.ndarray) -> float:
    """EUR/ha."""
    return float(kg_ha @ [PRICE, LESS, LESS])


def tuned(
    parameters: Sequence[Parameter], level: object, fields: Sequence[Field], tries: int
) -> tuple[float, dict[str, object]]:
    """Least cost of all tries, and its keys."""
    found: list[tuple[float, dict[str, object]]] = []

    def measure(shares: np.ndarray) -> list[Measured]:
        for at in shares:
            keys = dict(sets_at(parameters, at))
            found.append((float(np.mean([cost(cut(f, level, keys)) for f in fields])), keys))
        return [Measured((value,), 1.0) for value, _ in found[-len(shares) :]]

    optimise(parameters, 1, tries, 1, measure)
    return min(found, key=lambda each: each[0])


def hindsight(field: Field, table: Mapping[str, float], minutes: int) -> tuple[float, float]:
    """Gain over the table [EUR/ha] by settings known best for all quarters of a field, and for each."""
    parts = [field.part(quarter * minutes / 4.0, min(5.0, minutes / 4.0)) for quarter in range(4)]
    start = np.array(list(table.values()))
    low, high = (np.array([getattr(p, end) for p in TABLE]) for end in ("low", "high"))

    def costs(logs: np.ndarray, some: Sequence[Field]) -> float:
        at = dict(zip(table, np.clip(start * np.exp(logs), low, high), strict=True))
        return float(np.mean([cost(cut(part, fixed.LEVEL, at)) for part in some]))

    def gain(some: Sequence[Field]) -> float:
        simplex = np.vstack([np.zeros(4), np.diag([-0.05, -0.1, 0.04, 0.1])])
        options = {"maxfev": 40, "initial_simplex": simplex}
        found = minimize(costs, np.zeros(4), (some,), method="Nelder-Mead", options=options)
        return costs(np.zeros(4), some) - float(found.fun)

    return gain(parts), float(np.mean([gain([part]) for part in parts]))


def main(arguments: Sequence[str] | None = None) -> float:
    """Tune both, then cut the other fields with both. The lower end of the interval of the gain [EUR/ha]."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    for name, value in (("fields", 30), ("tries", 20), ("tuned", 6), ("minutes", 60), ("known", 10)):
        parser.add_argument(f"--{name}", type=int, default=value)
    asked = parser.parse_args(arguments)
    known = [Field(1000 + seed, asked.minutes) for seed in range(asked.tuned)]
    table, own = (tuned(TABLE, level, known, asked.tries) for level in (fixed.LEVEL, climb.LEVEL))
    for name, (least, keys) in (("table", table), ("climb", own)):
        print(f"{name}  {least:6.2f} EUR/ha where it was tuned: {_said(keys)}", flush=True)
    rivals = {
        "manual": (fixed.LEVEL, {}), "table": (fixed.LEVEL, table[1]), "climb": (climb.LEVEL, own[1]),
        "climb from the table": (climb.LEVEL, table[1]),
    }  # fmt: skip
    fields = [Field(seed, asked.minutes) for seed in range(asked.fields)]
    results = {name: np.array([cut(f, *rival) for f in fields]) for name, rival in rivals.items()}
    for name, rows in results.items():
        lost, broken, beside = rows.mean(axis=0)
        euros = np.mean([cost(row) for row in rows])
        kg = f"lost {lost:6.1f}, broken {broken:6.1f}, beside {beside:5.1f} kg/ha"
        print(f"{name:32} {kg}, {euros:6.2f} EUR/ha")
    lows = {}
    for name in ("climb", "climb from the table"):
        for what, of in (("EUR/ha", cost), ("kg/ha lost and broken", lambda row: row[0] + row[1])):
            gains = np.array([of(a) - of(b) for a, b in zip(results["table"], results[name], strict=True)])
            half_width = student.ppf(0.975, len(gains) - 1) * gains.std(ddof=1) / np.sqrt(len(gains))
            mean, lows[name, what] = gains.mean(), gains.mean() - half_width
            print(f"gain of {name} over the table: {mean:.2f} ({lows[name, what]:.2f} to "
                  f"{mean + half_width:.2f}) {what}, better in {int((gains > 0).sum())}")  # fmt: skip
    won = np.array([hindsight(field, table[1], asked.minutes) for field in fields[: asked.known]])
    if len(won):
        print("to be won over the table, EUR/ha: by the best settings of a field {:.2f}, "
              "of each quarter of it {:.2f}".format(*won.mean(axis=0)))  # fmt: skip
    return lows["climb", "EUR/ha"]


def _said(keys: Mapping[str, object]) -> str:
    return ", ".join(f"{key} {value:g}" for key, value in keys.items())


if __name__ == "__main__":
    main()
