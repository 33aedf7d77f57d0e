"""`swath twin check`: whether another recording looks like what a twin says.

The bank is asked what the other recording says. It fits where that is the same within both intervals, and
where its scans are like those of the bank at all. How far apart heights are, and where, is said by `swath
compare scans`, for the twin and for what was known before: the share of the misfit that the twin explains.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import erfc, sqrt
from pathlib import Path

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
from swath.tools.height_map.build import open_source
from swath.tools.height_map.source import Echoes, Source, Wanted
from swath.tools.twin.bank import read_bank, words_of
from swath.tools.twin.fit import Twin, ways_of
from swath.tools.twin.learned import STRAY
from swath.tools.twin.looks import read_looks

FITS, DIFFERS, UNKNOWN = "fits", "does not fit", "too little is known"
CODES = {FITS: 0, DIFFERS: 1, UNKNOWN: 3}
TWIN_RUN, PRIOR_RUN = "simulated", "before"
GRID = Grid(block_m=1.0)
REACH_M = 30.0  # echoes farther from the path are left out; chosen
ALPHA = 0.05  # chance that a recording does not fit though it does


@dataclass(frozen=True)
class Checked:
    """What a check found.

    verdict: FITS, DIFFERS or UNKNOWN
    chance: that what fits is as far off as the recording
    explained: share of the misfit of what was known before, nan = there was none
    names: of the twin and of the recording
    compared: recording and simulation by `compare scans`, None = of a scanner that stands still
    lines: in words
    rows: of evidence.csv
    series: of a scanner that stands still, for the page: azimuth [rad], and deviations of the ranges [m],
        `measured` and `simulated`
    """

    verdict: str
    chance: float
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


@dataclass(frozen=True)
class Agreement:
    """Whether a recording says the same as a twin.

    alike: share of the runs of the bank that are as unlike the others as the recording is
    apart: how far the unknowns of both are apart, in standard deviations, (d,), nan = not known
    """

    alike: float
    apart: F64

    @property
    def same(self) -> float:
        """The chance that any unknown is so far apart (Bonferroni)."""
        far = np.abs(self.apart[np.isfinite(self.apart)])
        return min(1.0, len(far) * erfc(float(far.max()) / sqrt(2.0))) if len(far) else 1.0

    @property
    def chance(self) -> float:
        """That of both tests, of which either may refuse.

        The first one alone refuses what fits: the bank errs alike of two recordings of one field.
        """
        return min(self.alike, self.same)


def agreement(twin: Twin, source: Source) -> Agreement:
    """What the bank of a twin says of a recording that the twin was not made of, beside the twin."""
    seen = read_looks([source], load_lidar(twin.asked.sheet), twin.asked.view)
    bank = read_bank(twin.bank, twin.asked)
    answer, alike = bank.ask(seen.numbers), bank.unlike(seen, ways_of([source])).share
    return Agreement(min(alike, STRAY) if answer.is_stray else alike, twin.answer.apart(answer))


def check_twin(out: Path, twin: Twin, source: Source) -> Checked:
    """Ask the bank about a recording, simulate what a twin says, and compare.

    Parameters
    ----------
    out : folder of the simulations.
    twin, source : the twin, and a recording that it was not made of.
    """
    length, found = ways_of([source])[0], agreement(twin, source)
    made = []
    for name, values in ((TWIN_RUN, twin.values), (PRIOR_RUN, twin.middle)):
        clouds = _cloud(twin, values, source), _simulated(out / name, twin, values, length)
        made.append(compare_clouds(*clouds, grid=GRID, align="path"))
    w1 = [each.number("w1_m").difference for each in made]
    noise = next(iter(made[0].number("w1_m").spread), float("nan"))
    left, before = (max(0.0, value - np.nan_to_num(noise)) for value in w1)
    explained = 1.0 - left / before if before > 0.0 else float("nan")
    verdict = UNKNOWN if twin.answer.is_stray else FITS if found.chance > ALPHA else DIFFERS
    lines = [
        f"{percent_of(found.alike)} of the runs of the bank are as unlike the others as the recording",
        *_apart_lines(twin, found),
        f"heights differ by {num(w1[0], 'm')} (W1, noise {num(noise, 'm')}), before by {num(w1[1], 'm')}",
        f"explained {percent_of(explained)}" if np.isfinite(explained) else "nothing was left to explain",
    ]
    said = ", ".join(f"{key} {num(value)}" for key, value in twin.values.items())
    row = {**scans_row(made[0], source.name), "compared": "twin", "conditions": said, "note": verdict}
    names = twin.folder.name, source.name
    return Checked(verdict, found.chance, explained, names, made[0], lines, [row])


def _apart_lines(twin: Twin, found: Agreement) -> list[str]:
    """Which unknown is furthest apart."""
    if not np.isfinite(found.apart).any():
        return ["no unknown is known of both"]
    most = int(np.nanargmax(np.abs(found.apart)))
    words, far = words_of(twin.estimates[most].key)[0], num(float(found.apart[most]))
    return [f"{words} differs by {far} standard deviations, the others by less: {percent_of(found.same)}"]


def write_evidence_of(out: Path, found: Checked) -> None:
    """Write check.json and evidence.csv, which `swath test plan-field` and a dossier take."""
    plain = {
        "verdict": found.verdict,
        "chance": found.chance,
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
