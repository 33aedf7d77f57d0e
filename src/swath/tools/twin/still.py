"""Twins of a scanner that stands still: its range noise and lost beams, of any scene.

What it looks at is not known, so the scene is the median range of each beam, and a bank of its own is made of
that: the noise of the data sheet times a factor, and beams lost by chance. That takes a second or two, so
nothing is kept. A beam that flickers between two surfaces, as at the edge of one, tells of its scene, not of
its noise, and is left out.
"""

import json
import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from swath.core.errors import InputError
from swath.core.files.whole_file import new_file
from swath.core.number_text import num, percent_of
from swath.core.random import Stream
from swath.documents.json_file import read_object, write_json
from swath.documents.packed import read_arrays, readable
from swath.scenario.scenario import load_scenario
from swath.sensing.lidar_sheet import LidarSheet, load_lidar
from swath.signals import F32, F64, I64
from swath.tools.distributions import wasserstein1
from swath.tools.height_map.source import Source
from swath.tools.tune.parameters import Parameter
from swath.tools.twin.check import ALPHA, DIFFERS, FITS, UNKNOWN, Checked
from swath.tools.twin.fit import Estimate, estimates_of, folder_of_twin, write_scenario
from swath.tools.twin.learned import Answer, answer_in, ask, learn
from swath.tools.twin.looks import Recorded, View, read_looks

STILL, SCENE = "twin-still.json", "twin-scene.npz"
FACTOR, LOST = (0.2, 5.0), (0.001, 20.0)  # range noise over the sheet's; lost beams [%]
SPOT = (0.6, 1.6)  # over the sheet's: nothing that stands still shows it
UNEVEN = 0.5  # sd of the logarithm of a beam's noise over that of all at most: surfaces differ; estimated
RUNS, SCANS = 400, 200  # of the bank; looked at of a recording
STEADY = 0.5  # share of the scans in which a beam that counts has an echo
FLICKER = 6.0  # noise of a beam over the data sheet's above which it sees two surfaces; chosen
BEAMS = 10  # steady ones at least
ONE_SIGMA = (0.1587, 0.8413)  # shares of a normal distribution below
SHRUNK, LEAST = 0.3, 0.02  # of covariances: towards their diagonal, and a floor; chosen
SPREAD = (0.1, 0.25, 0.5, 0.75, 0.9)  # quantiles over the beams
PARAMETERS = [
    Parameter("noise_factor", *FACTOR, is_log=True),
    Parameter("drop_out_percent", *LOST, is_log=True),
]
PRIOR = np.full(len(PARAMETERS), 0.5)  # the middle of what is possible


@dataclass(frozen=True)
class Scene:
    """What a scanner that stands still looks at.

    azimuth [rad], ranges: median of each beam [m], nan = none, (beams,); deviations: from it (scans, beams)
    [m]; seen: beams that count
    """

    azimuth: F64
    ranges: F64
    deviations: F32
    seen: I64

    @classmethod
    def of(cls, recorded: Recorded, sheet: LidarSheet) -> "Scene":
        """The scene of a recording. InputError where few beams see anything steadily."""
        flat = recorded.stack[:: -(-len(recorded.stack) // SCANS)].reshape(-1, recorded.view.count)
        there = np.isfinite(flat).mean(axis=0) >= STEADY
        ranges = np.full(flat.shape[1], np.nan)
        ranges[there] = np.nanmedian(flat[:, there], axis=0)
        off = (flat - ranges).astype(np.float32)
        sigma = np.full(len(ranges), np.nan)
        sigma[there] = _spread(off[:, there]) / sheet.noise_sigma(ranges[there])
        seen = np.flatnonzero(there & (sigma < FLICKER))
        if len(seen) < BEAMS:
            raise InputError("scans", len(seen), f"expected {BEAMS} beams or more that see one surface each")
        return cls(recorded.view.azimuth, ranges, off, seen)

    def numbers(self, off: F64 | F32, sheet: LidarSheet) -> F64:
        """How deviations look: spread of the noise over the sheet's over the beams, and lost beams."""
        some = off[:, self.seen]
        ratio = np.log(np.maximum(_spread(some), 1e-5) / sheet.noise_sigma(self.ranges[self.seen]))
        return np.array([*np.quantile(ratio, SPREAD), np.log(1e-5 + np.isnan(some).mean())])

    def simulated(self, sheet: LidarSheet, shares: F64, rng: np.random.Generator) -> F64:
        """Deviations (scans, beams) [m] at shares of the ranges of noise and lost beams."""
        factor, lost = (float(p.value_at(float(s))) for p, s in zip(PARAMETERS, shares[:2], strict=True))
        uneven = np.exp(UNEVEN * rng.random() * rng.standard_normal(len(self.ranges)))
        sigma = factor * uneven * sheet.noise_sigma(self.ranges)
        told = self.ranges + sigma * rng.standard_normal(self.deviations.shape)
        told = np.round(told / sheet.resolution) * sheet.resolution if sheet.resolution > 0.0 else told
        return np.where(rng.random(told.shape) < 0.01 * lost, np.nan, told - self.ranges)


def _spread(off: F64 | F32) -> F64:
    """Half of what lies between one sigma on both sides of a normal distribution, by beam (n,).

    off: (scans, n), nan = no echo. As by `np.nanquantile`, which takes beams one by one.
    """
    ordered, last = np.sort(off, axis=0), np.count_nonzero(np.isfinite(off), axis=0) - 1
    beams = np.arange(off.shape[1])

    def at(share: float) -> F64:
        place = share * np.maximum(last, 0)
        below = place.astype(np.int64)
        first, then = (ordered[np.minimum(n, last), beams] for n in (below, below + 1))
        return np.asarray(first + (place - below) * (then - first), np.float64)

    return 0.5 * (at(ONE_SIGMA[1]) - at(ONE_SIGMA[0]))


def answer_of(scene: Scene, sheet: LidarSheet, seed: int) -> Answer:
    """What the scans of a scene say of noise and lost beams, by a bank of its own."""
    shares = Stream(seed, "still twin").at(0).random((RUNS, len(PARAMETERS)))
    numbers = _simulations(scene, sheet, shares, seed)
    return ask(shares, numbers, learn(shares, numbers), scene.numbers(scene.deviations, sheet))


def _simulations(scene: Scene, sheet: LidarSheet, shares: F64, seed: int) -> F64:
    each = (scene.simulated(sheet, at, Stream(seed, "still scans").at(n)) for n, at in enumerate(shares))
    return np.stack([scene.numbers(off, sheet) for off in each])


def further_than(sims: F64, seen: F64, shares: F64) -> float:
    """Share of simulations, the recording counted with them, that lie at least as far from the others.

    Far is the distance that is left when the unknowns are moved to where it is least, by a plane through the
    others, in deviations of these about it and of the unknowns (a profile likelihood with their prior).

    sims: numbers (n, m); seen: (m,), nan = not there; shares: what simulations differ in and is known (n, d)
    """
    usable = np.isfinite(seen) & np.isfinite(sims).all(axis=0)
    others, one = sims[:, usable], seen[usable]
    moves = (shares - shares.mean(axis=0)) / np.maximum(shares.std(axis=0), 1e-6)
    every = np.arange(len(others))
    far = np.array([_left(others[every != n], moves[every != n], others[n]) for n in every])
    last = _left(others, moves, one)
    return float((1 + np.count_nonzero(far >= last)) / (len(sims) + 1))


def _left(others: F64, moves: F64, one: F64) -> float:
    """The squared distance of `further_than`."""
    mean, sd = others.mean(axis=0), np.maximum(others.std(axis=0), 1e-3)
    plain, seen, moved = (others - mean) / sd, (one - mean) / sd, moves - moves.mean(axis=0)
    ridge = np.eye(moves.shape[1])
    slopes = np.linalg.solve(moved.T @ moved + ridge, moved.T @ plain)
    about = plain - moved @ slopes
    free = max(1.0, len(others) - 1.0 - moves.shape[1])
    covariance = (1.0 - SHRUNK) * about.T @ about / free
    covariance[np.diag_indices(len(covariance))] += SHRUNK * (about**2).sum(axis=0) / free + LEAST
    weighed = np.linalg.solve(covariance, np.column_stack([seen, slopes.T]))
    best = np.linalg.solve(slopes @ weighed[:, 1:] + ridge, slopes @ weighed[:, 0])
    rest = weighed[:, 0] - weighed[:, 1:] @ best
    return float((seen - best @ slopes) @ rest + best @ best)


def fit_still(out: Path, sources: Sequence[Source], sheet: str, seed: int) -> tuple[list[Estimate], Answer]:
    """Ask what recordings of one scene say; writes twin.yaml, with the scanner as it was found."""
    made = load_lidar(sheet)
    recorded = read_looks(sources, made)
    scene = Scene.of(recorded, made)
    answer = answer_of(scene, made, seed)
    slot, names = "combine.lidar", [source.name for source in sources]
    found = [replace(e, key=f"{slot}.{e.key}") for e in estimates_of(PARAMETERS, answer)]
    found.append(Estimate(f"{slot}.spot_factor", 1.0, *SPOT, SPOT, is_known=False))
    sets = [
        f"{slot}={json.dumps({'level': 'plants', 'sensor': sheet})}",
        *(f"{e.key}={e.value}" for e in found if e.is_known),
    ]
    write_scenario(out, load_scenario("straight", sets=[*sets, "name=twin"]), names, found)
    plain = {"sheet": sheet, "view": asdict(recorded.view), "recordings": names, "answer": asdict(answer)}
    write_json(out / STILL, {**plain, "estimates": [asdict(e) for e in found]})
    with new_file(out / SCENE) as file:
        np.savez_compressed(file, ranges=scene.ranges)
    return found, answer


def is_still(path: Path) -> bool:
    """Whether a twin is of a scanner that stood still."""
    return os.path.isfile(folder_of_twin(path) / STILL)


def check_still(path: Path, source: Source, draws: int, seed: int) -> Checked:
    """Predict another recording of the same scene, beam by beam."""
    folder = folder_of_twin(path)
    data = read_object(folder / STILL, "twin", "a twin")
    with readable("twin", "a twin", folder / STILL):
        view = View(**{**data["view"], "lines": tuple(data["view"]["lines"])})
        answer = answer_in(data["answer"])
    before = read_arrays(folder / SCENE, "twin", "the scene of a twin")["ranges"]
    sheet = load_lidar(data["sheet"])
    scene = Scene.of(read_looks([source], sheet, view), sheet)
    shares = answer.draws(draws, Stream(seed, "still check").at(0))
    sims = [scene.simulated(sheet, at, Stream(seed, "still draws").at(n)) for n, at in enumerate(shares)]
    further = further_than(np.stack([scene.numbers(off, sheet) for off in sims]),
                           scene.numbers(scene.deviations, sheet), shares)  # fmt: skip
    seen = scene.seen
    measured = scene.deviations[:, seen] + (scene.ranges - before)[seen]
    plain = scene.simulated(sheet, PRIOR, Stream(seed, "still prior").at(0))
    w1 = [wasserstein1(off[:, seen], measured) for off in (sims[0], plain)]
    noise = float(np.quantile([wasserstein1(off[:, seen], sims[0][:, seen]) for off in sims[1:21]], 0.95))
    left, there = (max(0.0, value - noise) for value in w1)
    explained = 1.0 - left / there if there > 0.0 else float("nan")
    verdict = UNKNOWN if answer.is_stray else FITS if further > ALPHA else DIFFERS
    row = {"compared": "twin", "number": "ranges, Wasserstein-1", "unit": "m", "says": verdict,
           "value": num(w1[0]), "noise": num(noise), "file": source.name}  # fmt: skip
    apart = f"{num(w1[0], 'm')} (W1, noise {num(noise, 'm')}), by {num(w1[1], 'm')} as of the sheet"
    lines = [
        f"{percent_of(further)} of the simulations lie as far from the others as the recording",
        f"ranges differ by {apart}",
        f"medians moved by {num(1e3 * float(np.median(scene.ranges[seen] - before[seen])), 'mm')}",
        f"{len(seen)} of {view.count} beams see one surface each; the others are not predicted",
    ]
    series = {"azimuth": scene.azimuth[seen], "measured": _spread(scene.deviations[:, seen]),
              "simulated": _spread(np.concatenate(sims[:10])[:, seen]), "ranges": scene.ranges[seen],
              "moved": (scene.ranges - before)[seen]}  # fmt: skip
    return Checked(verdict, further, explained, (folder.name, source.name), None, lines, [row], series)
