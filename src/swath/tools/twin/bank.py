"""A bank of simulations of one scanner on one machine: what it is asked of, and what it has learned.

Runs are drawn from the prior, all unknowns at once, and done as those of a function test: in processes or on
a cluster, gone on with where they were stopped. What is asked of is evenly distributed in its range; what
else varies (where stems lean to, ground, speed, yaw) is drawn, too, and not told.
"""

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from swath.core.errors import InputError, check_within, near_miss
from swath.core.files.whole_file import new_file
from swath.core.foreign_code import allow_code
from swath.core.frames import Pose
from swath.core.random import Stream
from swath.core.units import DEG
from swath.documents.json_file import write_json
from swath.documents.packed import read_arrays, readable
from swath.field.crop_sheet import load_crop
from swath.scenario.scenario import Scenario, folder_of, load_scenario
from swath.signals import F64
from swath.tools.function_test.case import FORMAT, Scalar
from swath.tools.function_test.plan import AS_SET, Plan
from swath.tools.function_test.pool import Done
from swath.tools.function_test.session import Session, claim_folder
from swath.tools.scan.scan import first_of_kind
from swath.tools.tune.parameters import Parameter, read_parameter, sets_at
from swath.tools.twin.learned import Answer, ask, learn
from swath.tools.twin.looks import EVERY, NAMES, REFERENCE, Recorded, View
from swath.tools.twin.structure import NAMES as STRUCTURE
from swath.tools.twin.unlike import Unlike, unlike

ASKED, CASE, BANK = "twin-bank.json", "twin-bank.yaml", "bank.npz"
USABLE = 0.8  # share of the runs that must have scans; chosen
TABLES = ("shares", "numbers", "structure", "tuned")
FEWEST, MOST = 40, 20_000  # runs


@dataclass(frozen=True)
class Params:
    """What a run of a bank is, beside what is drawn.

    distance: driven [m]; chosen: as long as the height of a crop changes little
    rate: scans a second [Hz]; chosen: scans half a metre apart tell something else each
    """

    distance: float = 12.0
    rate: float = 5.0


PARAMS = Params()
WORDS = {  # what is asked of by the end of its key, its unit and how it is called
    "stems_per_m2": ("1/m2", "stems"), "height_factor": ("", "crop height over the sheet's"),
    "stubble_height_m": ("m", "stubble height"), "mount.roll_deg": ("deg", "mounting, roll"),
    "mount.pitch_deg": ("deg", "mounting, pitch"), "mount.z_m": ("m", "mounting, height"),
    "mount.y_m": ("m", "mounting, outward of the crop edge"), "lean_deg": ("deg", "lean of the stems"),
    "noise_factor": ("", "range noise over the sheet's"), "spot_factor": ("", "spot over the sheet's"),
    "drop_out_percent": ("%", "lost beams"), "extinction_per_m": ("1/m", "extinction by dust"),
    "near_returns": ("", "puffs of dust per scan and beam"),
}  # fmt: skip


@dataclass(frozen=True)
class BankAsked:
    """What a bank is made of.

    scenario: bundled name or file, with a machine and a scanner in it; sheet: of the scanner
    mount: x, y, z, roll, pitch, yaw on the machine, as far as they are known [m, deg]
    first, step, beams, lines: the view [rad]
    params: ranges as after `--param`, instead of the usual ones
    sets: changes of the scenario
    runs, seed: how many simulations, of their draws
    """

    sheet: str
    mount: tuple[float, ...]
    first: float
    step: float
    beams: int
    lines: tuple[float, ...]
    scenario: str = "straight"
    params: tuple[str, ...] = ()
    sets: tuple[str, ...] = ()
    runs: int = 700
    seed: int = 1

    def __post_init__(self) -> None:
        check_within("--runs", self.runs, FEWEST, MOST)

    @property
    def view(self) -> View:
        """The beams."""
        return View(self.first, self.step, self.beams, self.lines)

    @cached_property
    def base(self) -> Scenario:
        """The scenario that runs are changes of."""
        return load_scenario(self.scenario, sets=list(self.sets))

    @cached_property
    def slot(self) -> str:
        """The scanner, `combine.lidar`. InputError where the scenario has none."""
        for name, machine in self.base.machines.items():
            if (slot := first_of_kind("lidar", machine.slots)) is not None:
                return f"{name}.{slot}"
        raise InputError("--scenario", self.scenario, "expected a machine with a scanner")

    @cached_property
    def fixed(self) -> dict[str, Any]:
        """Keys and values that all runs have."""
        machine = self.slot.partition(".")[0]
        found: dict[str, Any] = {
            "expect": {},
            f"{self.slot}.level": "plants",
            f"{self.slot}.sensor": self.sheet,
            f"{self.slot}.sector_deg": self.view.sector_deg,
            f"{self.slot}.step_deg": self.step / DEG,
            f"{self.slot}.mount.at": "edge_end",
        }
        if "edge" in self.base.machines[machine].slots:
            found[f"{machine}.edge.level"] = "truth"
        return found

    @cached_property
    def parameters(self) -> list[Parameter]:
        """What is asked of. InputError for a range of anything else."""
        plain = self.base.plain()["field"]["stand"]
        crop = load_crop(plain["crop"], folder_of(self.base))
        stems = plain.get("stems_per_m2") or crop.stand.density
        _, _, z, roll, pitch, _ = self.mount
        at, lidar = "field.stand", self.slot
        usual = [
            Parameter(f"{at}.stems_per_m2", 0.3 * stems, 1.4 * stems, is_log=True),
            Parameter(f"{at}.height_factor", 0.7, 1.3),
            Parameter("field.edge.stubble_height_m", 0.05, min(0.35, 0.4 * crop.stand.height)),
            Parameter(f"{lidar}.mount.roll_deg", roll - 3.0, roll + 3.0),
            Parameter(f"{lidar}.mount.pitch_deg", pitch - 3.0, pitch + 3.0),
            Parameter(f"{lidar}.mount.z_m", z - 0.1, z + 0.1),
            Parameter(f"{lidar}.mount.y_m", -1.0, 1.0),
            Parameter(f"{at}.lean_deg", 0.0, 25.0),
            Parameter(f"{lidar}.noise_factor", 0.5, 3.0, is_log=True),
            Parameter(f"{lidar}.spot_factor", 0.6, 1.6, is_log=True),
            Parameter(f"{lidar}.drop_out_percent", 0.1, 10.0, is_log=True),
            Parameter(f"{lidar}.weather.extinction_per_m", 0.002, 0.2, is_log=True),
            Parameter(f"{lidar}.weather.near_returns", 0.005, 0.5, is_log=True),
        ]
        own = {p.key: p for p in map(read_parameter, self.params)}
        known = [p.key for p in usual]
        for key in own:
            if key not in known:
                raise InputError("--param", key, f"expected one of {', '.join(known)}{near_miss(key, known)}")
        return [own.get(p.key, p) for p in usual]

    @property
    def beside(self) -> list[Parameter]:
        """What else varies."""
        lidar, machine, yaw = self.slot, self.slot.partition(".")[0], self.mount[5]
        return [
            Parameter("field.stand.lean_azimuth_deg", 0.0, 360.0),
            Parameter("field.terrain.slope_percent", -3.0, 3.0),
            Parameter("field.terrain.slope_azimuth_deg", 0.0, 360.0),
            Parameter("field.terrain.roughness_class", choices=("none", "B", "C")),
            Parameter(f"{machine}.speed.speed_kmh", 3.0, 9.0),
            Parameter(f"{lidar}.mount.yaw_deg", yaw - 1.5, yaw + 1.5),
        ]

    def drawn(self, number: int) -> F64:
        """Shares of the ranges of a run, of what is asked of and of what else varies, (d,)."""
        return Stream(self.seed, "twin bank").at(number).random(len(self.parameters) + len(self.beside))

    def check(self) -> None:
        """InputError where a run of it is none."""
        every = [*self.parameters, *self.beside]
        load_scenario(self.scenario, sets=self.sets_of(sets_at(every, self.drawn(0))))

    def sets_of(self, values: Mapping[str, Scalar]) -> list[str]:
        """Changes of the scenario for some values, as after `--set`."""
        return [
            *self.sets,
            *(f"{key}={json.dumps(value)}" for key, value in {**self.fixed, **values}.items()),
        ]


@dataclass(frozen=True)
class Bank:
    """A bank in its folder. shares: of its runs (n, d); numbers, structure: of their scans (n, m), (n, k);
    tuned: by `learn`.
    """

    folder: Path
    asked: BankAsked
    shares: F64
    numbers: F64
    structure: F64
    tuned: F64

    def ask(self, seen: F64) -> Answer:
        """What scans say. seen: their numbers, (m,)."""
        return ask(self.shares, self.numbers, self.tuned, seen)

    def unlike(self, seen: Recorded, ways: Sequence[float]) -> Unlike:
        """How unlike the runs scans are. ways: lengths of the recordings [m]."""
        parts = [min(1.0, PARAMS.distance / way) for way in ways]
        structure = seen.structure(PARAMS.rate, parts)
        return unlike(self.shares, self.numbers, self.structure, seen.numbers, structure)


def words_of(key: str) -> tuple[str, str]:
    """How a key is called, and its unit."""
    return next((said[1], said[0]) for end, said in WORDS.items() if key.endswith(end))


def rounded_mount(mount: Pose) -> tuple[float, ...]:
    """x, y, z, roll, pitch, yaw [m, deg], as roughly as two recordings of one machine agree."""
    return (
        *(round(float(v), 1) for v in mount.position),
        *(round(float(a) / DEG) + 0.0 for a in mount.euler()),
    )


def make_bank(folder: Path, asked: BankAsked, workers: int, done: Done, client: Any = None) -> Bank:
    """The bank in a folder: its runs are done where they are not there, and learned from once.

    Parameters
    ----------
    folder : of the bank, which is gone on with.
    asked : what it is made of.
    workers, client : processes here, or of dask.
    done : gets each new result.
    """
    try:
        claim_folder(folder / ASKED, asked, "a bank")
    except InputError as error:
        raise InputError("--bank", str(folder), error.expected) from error
    if not os.path.isfile(folder / BANK):
        drawn = np.stack([asked.drawn(n) for n in range(asked.runs)])
        numbers = simulated(folder, asked, drawn, workers, done, client)
        there = np.isfinite(numbers).any(axis=1)
        shares, numbers = drawn[there, : len(asked.parameters)], numbers[there]
        numbers, structure = numbers[:, : len(NAMES)], numbers[:, len(NAMES) :]
        with new_file(folder / BANK) as file:
            tuned = learn(shares, numbers)
            np.savez_compressed(file, shares=shares, numbers=numbers, structure=structure, tuned=tuned)
    return read_bank(folder, asked)


def read_bank(folder: Path, asked: BankAsked) -> Bank:
    """The bank that was made in a folder."""
    data = read_arrays(folder / BANK, "--bank", "the runs of a bank")
    with readable("--bank", "the runs of a bank", folder / BANK):
        kept = [np.asarray(data[name], np.float64) for name in TABLES]
        unknowns, count = len(asked.parameters), len(kept[0])
        shapes = [(count, unknowns), (count, len(NAMES)), (count, len(STRUCTURE)), (unknowns, 3)]
        if [k.shape for k in kept] != shapes:
            raise ValueError("other numbers of runs or of unknowns")
        if (
            np.isinf(np.hstack(kept[:3])).any() or np.isnan(kept[0]).any() or not (kept[3] > 0.0).all()
        ):  # nan of the latter, too
            raise ValueError("numbers that are none")
        return Bank(folder, asked, *kept)


def simulated(
    folder: Path,
    asked: BankAsked,
    shares: F64,
    workers: int,
    done: Done,
    client: Any = None,
) -> F64:
    """How scans look, (n, m + k), at shares of what is asked of and of what else varies (n, d).

    nan = no scan. The runs go on with those that lie in the folder. InputError where few saw anything.
    """
    every = [*asked.parameters, *asked.beside]
    fixed = {**asked.fixed, "run.distance_m": PARAMS.distance, f"{asked.slot}.rate_hz": PARAMS.rate}
    vary = {p.key: {"key": p.key, **({"at": list(p.choices)} if p.choices else {"range": [p.low, p.high]})}
            for p in every}  # fmt: skip
    case = {"format": FORMAT, "objective": "how scans look", "source": "drawn", "scenario": asked.scenario,
            "set": fixed, "vary": vary, "seeds": 1, "expect": {}}  # fmt: skip
    write_json(folder / CASE, case)
    points = tuple((n + 1, sets_at(every, at)) for n, at in enumerate(shares))
    sets = (*asked.sets, f"evaluators={json.dumps([REFERENCE])}")
    plan = Plan(str(folder / CASE), sets=sets, level=AS_SET, chosen={Path(CASE).stem: points})
    with allow_code((REFERENCE,)):
        plan.check()
        results = Session(folder, plan).made(workers, done, client)
    found = np.full((len(shares), len(EVERY)), np.nan)
    for result in results:
        values = [result["metrics"].get(name) for name in EVERY]
        found[result["seed"] - 1] = [np.nan if v is None else v for v in values]
    there = int(np.isfinite(found).any(axis=1).sum())
    if there < USABLE * len(shares):
        why = next((r["reason"] for r in results if r["verdict"] == "error"), "no scan with echoes")
        raise InputError(
            "--bank", str(folder), f"expected runs with scans, {there} of {len(shares)} are: {why}"
        )
    return found
