"""Organs that only some crops have: the bend of a nodding ear, awns, branches, pods, tassel, cob."""

from dataclasses import dataclass

from swath.core.units import DEG
from swath.field.facts import ANGLE, CV, LENGTH, RATIO, Limits


@dataclass(frozen=True)
class NeckFacts:
    """The bend between an upright stalk and a nodding ear. length [m], length_cv."""

    length: float
    length_cv: float


@dataclass(frozen=True)
class AwnFacts:
    """per_ear: awns of an ear; drawn: how many thicker ones stand for them, with the same silhouette
    length, diameter [m], length_cv; spread [rad]: between an awn and its ear.
    """

    per_ear: int
    drawn: int
    length: float
    length_cv: float
    diameter: float
    spread: float


@dataclass(frozen=True)
class BranchFacts:
    """Branches of a main stem, curved upwards.

    count_min, count_max; foot_min, foot_max: where they leave the stem, tip_min, tip_max: how high they
    reach [share of the stem's length]; angle_foot, angle_tip [rad] from vertical; diameter_foot,
    diameter_tip [m]
    """

    count_min: int
    count_max: int
    foot_min: float
    foot_max: float
    tip_min: float
    tip_max: float
    angle_foot: float
    angle_tip: float
    diameter_foot: float
    diameter_tip: float


@dataclass(frozen=True)
class PodFacts:
    """per_plant, per_plant_cv; along: share of a branch, from its tip, that bears pods; main: length of the
    main stem's own pod-bearing top [share of the stem]; length, diameter [m]; length_cv; inclination_mean,
    inclination_sd [rad] from vertical.
    """

    per_plant: int
    per_plant_cv: float
    along: float
    main: float
    length: float
    length_cv: float
    diameter: float
    inclination_mean: float
    inclination_sd: float


@dataclass(frozen=True)
class TasselFacts:
    """The top of a maize plant. drawn: its spikes; length, diameter [m]; spread [rad] from the stalk."""

    drawn: int
    length: float
    diameter: float
    spread: float


@dataclass(frozen=True)
class CobFacts:
    """An ear of maize in its husk. height, height_sd: of its foot above ground [m]; length, length_cv,
    diameter [m]; inclination_mean, inclination_sd [rad] from vertical, above 90 deg it hangs.
    """

    height: float
    height_sd: float
    length: float
    length_cv: float
    diameter: float
    inclination_mean: float
    inclination_sd: float


NECK: dict[str, Limits] = {"length": (LENGTH, 0.005, 0.4), "length_cv": CV}
AWN: dict[str, Limits] = {
    "per_ear": (RATIO, 1, 200),
    "drawn": (RATIO, 1, 60),
    "length": (LENGTH, 0.005, 0.3),
    "length_cv": CV,
    "diameter": (LENGTH, 5e-5, 3e-3),
    "spread": (ANGLE, 0.0, 90 * DEG),
}
BRANCH: dict[str, Limits] = {
    "count_min": (RATIO, 0, 30),
    "count_max": (RATIO, 0, 30),
    "foot_min": (RATIO, 0.02, 0.95),
    "foot_max": (RATIO, 0.02, 0.95),
    "tip_min": (RATIO, 0.1, 1.2),
    "tip_max": (RATIO, 0.1, 1.2),
    "angle_foot": (ANGLE, 0.0, 85 * DEG),
    "angle_tip": (ANGLE, 0.0, 75 * DEG),
    "diameter_foot": (LENGTH, 2e-4, 0.03),
    "diameter_tip": (LENGTH, 2e-4, 0.03),
}
POD: dict[str, Limits] = {
    "per_plant": (RATIO, 1, 2000),
    "per_plant_cv": CV,
    "along": (RATIO, 0.05, 1.0),
    "main": (RATIO, 0.02, 0.8),
    "length": (LENGTH, 0.005, 0.3),
    "length_cv": CV,
    "diameter": (LENGTH, 5e-4, 0.05),
    "inclination_mean": (ANGLE, 0.0, 170 * DEG),
    "inclination_sd": (ANGLE, 0.0, 60 * DEG),
}
TASSEL: dict[str, Limits] = {
    "drawn": (RATIO, 1, 40),
    "length": (LENGTH, 0.02, 0.6),
    "diameter": (LENGTH, 2e-4, 0.02),
    "spread": (ANGLE, 0.0, 90 * DEG),
}
COB: dict[str, Limits] = {
    "height": (LENGTH, 0.2, 2.5),
    "height_sd": (LENGTH, 0.0, 0.5),
    "length": (LENGTH, 0.05, 0.5),
    "length_cv": CV,
    "diameter": (LENGTH, 0.01, 0.12),
    "inclination_mean": (ANGLE, 0.0, 170 * DEG),
    "inclination_sd": (ANGLE, 0.0, 60 * DEG),
}
