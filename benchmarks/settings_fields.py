"""The settings controller `climb` against a fixed table: in drawn fields on which neither was tuned.

    python -m benchmarks.settings_fields [--fields 30] [--tries 20] [--tuned 6] [--minutes 60]

A combine cuts for a while in wheat whose density, straw, moisture, threshability and slope are drawn, with
organs whose estimated numbers are drawn from their bands, and the sensors `counted`. Each has --tries to tune
its own keys: the table its settings; the controller, which starts from the manual's, how it goes on. Printed:
grain lost and broken [kg/ha], what that costs, and the 95 % interval of the mean gain (Student's t, paired by
field).
"""

import argparse
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
from scipy.stats import t as student
from tests.machine.machine_fakes import Ground, site
from tests.machine.organ_trends import FLOW
from tests.machine.process_rig import Row, flow, state

from swath.control.settings import climb, fixed
from swath.core.estimate import estimates
from swath.core.random import Stream
from swath.core.schedule import NS
from swath.scenario.slots import CATALOGUE
from swath.signals.settings import own_settings
from swath.tools.tune.optimiser import Measured, optimise
from swath.tools.tune.parameters import Parameter, sets_at

H = 2.0  # step [s]
PRICE, LESS = 0.20, 0.04  # of wheat [EUR/kg]; by how much broken grain and what is beside it are worth less
SPEED = 2.0  # [m/s]
OWN = own_settings(site().machine.works, "wheat")
RPM, MM = 30.0 / np.pi, 1e3
TABLE = [
    Parameter("drum_rpm", 0.8 * OWN["drum"] * RPM, 1.2 * OWN["drum"] * RPM),
    Parameter("concave_mm", 0.6 * OWN["concave"] * MM, 1.6 * OWN["concave"] * MM),
    Parameter("fan_rpm", 0.85 * OWN["fan"] * RPM, 1.2 * OWN["fan"] * RPM),
    Parameter("upper_sieve_mm", 0.7 * OWN["upper"] * MM, 1.6 * OWN["upper"] * MM),
]
CLIMB = [
    Parameter("settle_s", 10.0, 40.0),
    Parameter("window_s", 10.0, 120.0),
    Parameter("better_percent", 0.0, 20.0),
    Parameter("pairs", 1, 4, is_whole=True),
    Parameter("feed_exponent", 1.0, 4.0),
    Parameter("drum_step_rpm", 0.0, 60.0),
    Parameter("concave_step_mm", 0.0, 3.0),
    Parameter("fan_step_rpm", 0.0, 60.0),
    Parameter("upper_step_mm", 0.0, 3.0),
]


def wandering(rng: np.random.Generator, count: int, length_s: float) -> np.ndarray:
    """A normal process of unit variance that forgets itself over a time: (count,)."""
    kept, found = np.exp(-H / length_s), np.empty(count)
    found[0] = rng.standard_normal()
    for k, new in enumerate(np.sqrt(1.0 - kept**2) * rng.standard_normal(count - 1)):
        found[k + 1] = kept * found[k] + new
    return found


class Field:
    """What is drawn of a field, and of the machine's numbers that nobody knows."""

    def __init__(self, seed: int, minutes: float) -> None:
        rng = np.random.default_rng([75, seed])
        count = round(60.0 * minutes / H)
        self.seed, self.yielded = seed, rng.uniform(0.6, 1.0)  # [kg/m2]
        feed = rng.uniform(0.8, 1.1) * np.exp(0.15 * wandering(rng, count, 15.0))
        self.grain = FLOW[0] * feed
        self.straw = self.grain * rng.uniform(0.5, 0.8) * np.exp(0.1 * wandering(rng, count, 30.0))
        self.roll, self.pitch = (0.04 * wandering(rng, count, 60.0) for _ in range(2))
        threshability = float(np.exp(0.15 * rng.standard_normal()))
        drum = {key: float(rng.uniform(e.low, e.high)) for key, e in self._bands("threshing").items()}
        drum["threshability"] = threshability
        self.keys = {
            "feeder": {"grain_moisture_percent": rng.uniform(11, 18),
                       "straw_moisture_percent": rng.uniform(9, 18)},
            "threshing": {**drum, "broken_percent": float(rng.uniform(0.25, 1.0))},
            "separation": drum,
        }  # fmt: skip
        self.sensors = {key: float(rng.uniform(e.low, e.high)) for key, e in self._bands("crop_flow").items()}

    @staticmethod
    def _bands(slot: str) -> Mapping[str, object]:
        return estimates(CATALOGUE.registry.get(slot, {"crop_flow": "counted"}.get(slot, "model")).params)


def cut(field: Field, level: object, given: Mapping[str, object]) -> np.ndarray:
    """Grain lost, grain broken, other material in the tank [kg/ha]."""
    ground = Ground()
    ground.stand = SimpleNamespace(crop="wheat")
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


def main(arguments: Sequence[str] | None = None) -> float:
    """Tune both, then cut the other fields with both. The lower end of the interval of the gain [EUR/ha]."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    for name, value in (("fields", 30), ("tries", 20), ("tuned", 6), ("minutes", 60)):
        parser.add_argument(f"--{name}", type=int, default=value)
    asked = parser.parse_args(arguments)
    known = [Field(1000 + seed, asked.minutes) for seed in range(asked.tuned)]
    table = tuned(TABLE, fixed.LEVEL, known, asked.tries)
    print(f"table  {table[0]:6.2f} EUR/ha where it was tuned: {_said(table[1])}", flush=True)
    own = tuned(CLIMB, climb.LEVEL, known, asked.tries)
    print(f"climb  {own[0]:6.2f} EUR/ha where it was tuned: {_said(own[1])}", flush=True)
    rivals = {
        "manual": (fixed.LEVEL, {}), "table": (fixed.LEVEL, table[1]), "climb": (climb.LEVEL, own[1]),
        "climb from the table": (climb.LEVEL, {**table[1], **own[1]}),
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
    return lows["climb", "EUR/ha"]


def _said(keys: Mapping[str, object]) -> str:
    return ", ".join(f"{key} {value:g}" for key, value in keys.items())


if __name__ == "__main__":
    main()
