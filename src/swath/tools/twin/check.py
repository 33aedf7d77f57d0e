"""`swath twin check`: whether another recording looks like what a twin says.

Simulations are drawn as a twin says, unknown things as they may be, and so are what it is not asked of. The
recording fits where it lies no further from them than they lie from each other (a posterior predictive check:
Gelman et al. 1996, Statistica Sinica 6, 733). How far apart heights are, and where, is said by `swath compare
scans`, for the twin and for what was known before: the share of the misfit that the twin explains.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import ceil
from pathlib import Path
from typing import Any

import numpy as np

from swath.core.frames import Pose
from swath.core.number_text import num, percent_of
from swath.core.units import DEG
from swath.documents.json_file import write_json
from swath.runtime.job import run_job
from swath.scenario.scenario import load_scenario
from swath.sensing.lidar_sheet import load_lidar
from swath.signals import F64
from swath.tools.compare_scans.clouds import Cloud, Reading, cloud_of
from swath.tools.compare_scans.compare import Comparison, Grid, compare_clouds
from swath.tools.function_test.case import Scalar
from swath.tools.function_test.evidence import CHECK, Evidence, scans_row, write_evidence
from swath.tools.function_test.pool import Done
from swath.tools.height_map.build import open_source
from swath.tools.height_map.source import Echoes, Source, Wanted
from swath.tools.twin.bank import Params, simulated
from swath.tools.twin.fit import Twin, shares_drawn, way_of
from swath.tools.twin.looks import numbers_of, read_looks

FITS, DIFFERS, UNKNOWN = "fits", "does not fit", "too little is known"
CODES = {FITS: 0, DIFFERS: 1, UNKNOWN: 3}
DRAWS, TWIN_RUN, PRIOR_RUN = "draws", "simulated", "before"
GRID = Grid(block_m=1.0)
REACH_M = 30.0
ALPHA = 0.05  # chance that a recording does not fit though it is one of the simulations
SHRUNK, LEAST = 0.3, 0.02  # of covariances: towards their diagonal, and a floor; chosen
FASTEST, FARTHEST_M = 5.0, 12.0  # of simulations: scans a second [Hz], way [m]


@dataclass(frozen=True)
class Checked:
    """What a check found.

    verdict: FITS, DIFFERS or UNKNOWN
    further: share of the simulations that lie further from the others than the recording does
    explained: share of the misfit of what was known before, nan = there was none
    names: of the twin and of the recording
    compared: recording and simulation by `compare scans`, None = of a scanner that stands still
    lines: in words
    rows: of evidence.csv
    series: of a scanner that stands still, for the page: azimuth [rad], and deviations of the ranges [m],
        `measured` and `simulated`
    """

    verdict: str
    further: float
    explained: float
    names: tuple[str, str]
    compared: Comparison | None
    lines: Sequence[str]
    rows: Sequence[Mapping[str, object]]
    series: Mapping[str, F64] = field(default_factory=dict)

    @property
    def exit_code(self) -> int:
        """0 fits, 1 does not, 3 too little is known."""
        return CODES[self.verdict]


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


def check_twin(
    out: Path, twin: Twin, source: Source, draws: int, seed: int, workers: int, done: Done, client: Any = None
) -> Checked:
    """Simulate what a twin says, and compare.

    Parameters
    ----------
    out : folder of the simulations.
    twin, source : the twin, and a recording that it was not made of.
    draws, seed : how many simulations, of their draws.
    workers, client, done : as in `make_bank`.
    """
    length, further = way_of([source]), predicted(out, twin, source, draws, seed, workers, done, client)
    made = []
    for name, values in ((TWIN_RUN, twin.values), (PRIOR_RUN, twin.middle)):
        clouds = _cloud(twin, values, source), _simulated(out / name, twin, values, length)
        made.append(compare_clouds(*clouds, grid=GRID, align="path"))
    w1 = [each.number("w1_m").difference for each in made]
    noise = next(iter(made[0].number("w1_m").spread), float("nan"))
    left, before = (max(0.0, value - np.nan_to_num(noise)) for value in w1)
    explained = 1.0 - left / before if before > 0.0 else float("nan")
    verdict = UNKNOWN if twin.answer.is_stray else FITS if further > ALPHA else DIFFERS
    lines = [
        f"{percent_of(further)} of the simulations lie as far from the others as the recording",
        f"heights differ by {num(w1[0], 'm')} (W1, noise {num(noise, 'm')}), before by {num(w1[1], 'm')}",
        f"explained {percent_of(explained)}" if np.isfinite(explained) else "nothing was left to explain",
    ]
    said = ", ".join(f"{key} {num(value)}" for key, value in twin.values.items())
    row = {**scans_row(made[0], source.name), "compared": "twin", "conditions": said, "note": verdict}
    return Checked(verdict, further, explained, (twin.folder.name, source.name), made[0], lines, [row])


def predicted(
    out: Path, twin: Twin, source: Source, draws: int, seed: int, workers: int, done: Done, client: Any = None
) -> float:
    """Share of simulations of what a twin says that lie as far from the others as a recording does."""
    seen = read_looks([source], load_lidar(twin.asked.sheet), twin.asked.view)
    thin = ceil(seen.rate / FASTEST)
    run = Params(min(way_of([source]), FARTHEST_M), seen.rate / thin)
    shares = shares_drawn(twin, draws, seed)
    sims = simulated(out / DRAWS, twin.asked, shares, workers, done, client, run)
    there = np.isfinite(sims).any(axis=1)
    known = shares[there][:, np.flatnonzero(twin.answer.is_known)]
    return further_than(sims[there], numbers_of(seen.stack[::thin], seen.view), known)


def write_evidence_of(out: Path, found: Checked) -> None:
    """Write check.json and evidence.csv, which `swath test plan-field` and a dossier take."""
    plain = {
        "verdict": found.verdict,
        "further": found.further,
        "explained": found.explained,
        "rows": found.rows,
    }
    write_json(out / CHECK, plain)
    write_evidence(out, [Evidence({}, found.rows)])


def _cloud(twin: Twin, values: Mapping[str, Scalar], source: Source) -> Cloud:
    """Echoes where the mounting of some values puts them, over the path of the scanner: crop edges may lie
    elsewhere from other machines.
    """
    mount = f"{twin.asked.slot}.mount"
    z, roll, pitch, yaw = (float(values[f"{mount}.{k}"]) for k in ("z_m", "roll_deg", "pitch_deg", "yaw_deg"))
    mounting = Pose.from_euler((0.0, 0.0, z), roll * DEG, pitch * DEG, yaw * DEG)

    def sweeps() -> Iterator[Echoes]:
        return (replace(echoes, mounting=None) for echoes in source.sweeps())

    return cloud_of(replace(source, mounting=mounting, sweeps=sweeps), Reading(Wanted(), reach_m=REACH_M))


def _simulated(folder: Path, twin: Twin, values: Mapping[str, Scalar], length: float) -> Cloud:
    """The echoes of a run of a twin."""
    run_job(load_scenario(twin.asked.scenario, sets=twin.sets(values, length)), folder)
    return _cloud(twin, values, open_source(folder, Wanted()))
