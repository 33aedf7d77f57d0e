"""Branched plants (oilseed rape): a main stem, branches that curve upwards into a layer, pods along them."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from swath.documents.sheet_fields import Quantity
from swath.field.crop import CV, Crop, GrainYield, Habit, Organs
from swath.field.memory_layout import Organ, ranked
from swath.field.plants.drawing import Drawing
from swath.field.plants.parts import (
    Array,
    Part,
    Plants,
    Stalks,
    arc,
    assemble,
    heights_of,
    normal,
    pointing,
    rods,
    shared,
    sizes,
    stalk_capsules,
    stalks_of,
)

Ints = NDArray[np.int64]
BRANCH_PARTS = 3  # capsules of a branch
GOLDEN = 2.4  # from a branch to the next around the stem [rad]: 137.5 deg
UPRIGHT_TOP = 0.98  # of the height: the main stem ends a little below the tip of its topmost pod


@dataclass(frozen=True, kw_only=True)
class BranchFacts:
    """Branches of a main stem, curved upwards.

    count_min, count_max; foot_min, foot_max: where they leave the stem, tip_min, tip_max: how high they
    reach [share of the stem's length]; angle_foot, angle_tip [rad] from vertical; diameter_foot,
    diameter_tip [m]
    """

    count_min: Annotated[int, Quantity("", 0, 30)]
    count_max: Annotated[int, Quantity("", 0, 30)]
    foot_min: Annotated[float, Quantity("percent", 2, 95)]
    foot_max: Annotated[float, Quantity("percent", 2, 95)]
    tip_min: Annotated[float, Quantity("percent", 10, 120)]
    tip_max: Annotated[float, Quantity("percent", 10, 120)]
    angle_foot: Annotated[float, Quantity("deg", 0, 85)]
    angle_tip: Annotated[float, Quantity("deg", 0, 75)]
    diameter_foot: Annotated[float, Quantity("mm", 0.2, 30)]
    diameter_tip: Annotated[float, Quantity("mm", 0.2, 30)]


@dataclass(frozen=True, kw_only=True)
class PodFacts:
    """per_plant, per_plant_cv; along: share of a branch, from its tip, that bears pods; main: length of the
    main stem's own pod-bearing top [share of the stem]; length, diameter [m]; length_cv; inclination_mean,
    inclination_sd [rad] from vertical.
    """

    per_plant: Annotated[int, Quantity("", 1, 2000)]
    per_plant_cv: Annotated[float, CV]
    along: Annotated[float, Quantity("percent", 5, 100)]
    main: Annotated[float, Quantity("percent", 2, 80)]
    length: Annotated[float, Quantity("mm", 5, 300)]
    length_cv: Annotated[float, CV]
    diameter: Annotated[float, Quantity("mm", 0.5, 50)]
    inclination_mean: Annotated[float, Quantity("deg", 0, 170)]
    inclination_sd: Annotated[float, Quantity("deg", 0, 60)]


@dataclass(frozen=True, kw_only=True)
class PodYield(GrainYield):
    """seeds_per_pod: mean."""

    seeds_per_pod: Annotated[float, Quantity("", 1, 5000)]

    def grains(self, organs: Organs) -> float:
        """Seeds of a mean plant."""
        return self.seeds_per_pod * organs[PodFacts].per_plant


def make(crop: Crop, count: int, rng: np.random.Generator, how: Drawing) -> Plants:
    """Grain is shared out by the length of a plant's pods, straw by the volume of its main stem."""
    height = heights_of(crop, rng, count)
    stalks = stalks_of(crop, rng, UPRIGHT_TOP * height, upright=how.upright)
    lines, owner = _branches(crop.organs[BranchFacts], stalks, rng)
    pods, weight = _pods(crop.organs[PodFacts], stalks, lines, owner, rng, limit=height)
    stalk = stalk_capsules(crop.stem, stalks, 2 * how.stalk_parts)
    parts = [stalk, _rods(crop.organs[BranchFacts], lines, owner, stalks.scale)]
    if how.ears:
        parts.append(pods)
    grain = shared(weight, crop.yields.grain_mass)
    straw = shared(stalks.length * stalks.scale**2, crop.yields.straw_mass)
    return assemble(height, grain, straw, parts)


def _branches(facts: BranchFacts, stalks: Stalks, rng: np.random.Generator) -> tuple[Array, Ints]:
    """Points of the branches (n, BRANCH_PARTS + 1, 3) and their stems (n,): as long as their tips need."""
    stems = len(stalks.length)
    count_of = rng.integers(facts.count_min, facts.count_max + 1, stems)
    owner, rank = ranked(count_of)
    count = len(owner)
    share = (rank + rng.random(count)) / count_of[owner]  # low branches first, spread along the stem
    low = facts.foot_min + (facts.foot_max - facts.foot_min) * share
    tip = rng.uniform(facts.tip_min, facts.tip_max, count)
    azimuth = (
        2.4 * rank + rng.uniform(-0.5, 0.5, count) + rng.uniform(-np.pi, np.pi, stems)[owner]
    )  # 137.5 deg
    unit = np.ones(count)
    start = stalks.point(low, owner)
    curve = arc(
        np.zeros_like(start), unit, facts.angle_foot * unit, facts.angle_tip * unit, azimuth, BRANCH_PARTS
    )
    length = np.maximum(tip - low, 0.1) * stalks.length[owner] / curve[:, -1, 2]
    return start[:, None, :] + length[:, None, None] * curve, owner


def _rods(facts: BranchFacts, lines: Array, owner: Ints, scale: Array) -> Part:
    middle = (np.arange(BRANCH_PARTS) + 0.5) / BRANCH_PARTS
    diameter = facts.diameter_foot + (facts.diameter_tip - facts.diameter_foot) * middle
    radius = 0.5 * diameter * scale[owner, None]
    owners = np.repeat(owner, BRANCH_PARTS).reshape(-1, BRANCH_PARTS)
    return rods(Organ.BRANCH, lines[:, :-1], lines[:, 1:], radius, owners)


def _pods(
    facts: PodFacts, stalks: Stalks, lines: Array, owner: Ints, rng: np.random.Generator, *, limit: Array
) -> tuple[Part, Array]:
    """Pods around the ends of branches and the top of the main stem, and the length of each plant's pods [m].

    A branch bears as many as its bearing length is of the plant's. limit: height that no pod rises above [m]
    """
    stems = len(stalks.length)
    lengths = np.linalg.norm(np.diff(lines, axis=1), axis=2).sum(axis=1)
    bearing = np.concatenate([facts.main * stalks.length, facts.along * lengths])
    of = np.concatenate([np.arange(stems), owner])
    total = np.bincount(of, bearing, stems)
    per_plant = sizes(rng, facts.per_plant, facts.per_plant_cv, stems)
    count_of = np.floor(per_plant[of] * bearing / total[of] + rng.random(len(of))).astype(np.int64)
    count_of[:stems] = np.maximum(count_of[:stems], 1)
    line, rank = ranked(count_of)
    place = (rank + rng.random(len(line))) / count_of[line]
    foot = np.empty((len(line), 3))
    is_main = line < stems
    foot[is_main] = stalks.point(1.0 - facts.main * (1.0 - place[is_main]), line[is_main])
    foot[~is_main] = _along(lines, line[~is_main] - stems, 1.0 - facts.along * (1.0 - place[~is_main]))
    length = sizes(rng, facts.length, facts.length_cv, len(line))
    tilt = np.maximum(normal(rng, facts.inclination_mean, facts.inclination_sd, len(line)), 0.0)
    direction = pointing(tilt, rng.uniform(-np.pi, np.pi, len(line)))
    radius = np.full(len(line), 0.5 * facts.diameter)
    stem = of[line]
    rise = foot[:, 2] + length * direction[:, 2]
    foot[:, 2] -= np.maximum(rise - limit[stem], 0.0)
    a, b = foot + radius[:, None] * direction, foot + (length - radius)[:, None] * direction
    return rods(Organ.POD, a, b, radius, stem), np.asarray(np.bincount(stem, length, stems), float)


def _along(lines: Array, which: Ints, share: Array) -> Array:
    """Points at a share of lines with parts of equal length, (n, 3)."""
    parts = lines.shape[1] - 1
    index = np.minimum((share * parts).astype(np.int64), parts - 1)
    rest = (share * parts - index)[:, None]
    return np.asarray(lines[which, index] * (1.0 - rest) + lines[which, index + 1] * rest)


HABIT = Habit(
    make,
    yields=PodYield,
    organs={"branch": BranchFacts, "pod": PodFacts},
    reflective=("stem", "branch", "pod"),
)
