"""Compiled reports of rows that a test chooses."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from swath.control.edge.detectors import Detectors
from swath.control.edge.likelihood_ratio import LikelihoodRatio, Params
from swath.control.edge.profile import TOLERANCE
from tests.control.closed_loop import setup_of
from tests.control.synthetic_edge import mounting


class Reports(Detectors):
    """Detectors whose report is launched by its stages."""

    def __init__(self, parts):
        super().__init__(parts)
        self.feet_of, self.edge_of, self.all_of = (each.launch for each in self.reports())

    def learn(self, points):
        """Points of the edge are these, (n, 4); it was found again nowhere."""
        self.points[0, : len(points)], self.blocks["points"], self.blocks["returns"] = (
            points,
            len(points),
            0.0,
        )

    def edge(self):
        """What the first one told."""
        return self.sent["edge"].of(0)


RAMP = ("ramp_chance", "ramp", "ramp_sd")


def reports_of(*, usual=0.0, rows=0.0, view=None, **params):
    """Of a detector whose edge was begun, on its left."""
    setup = replace(setup_of("right", 0.04, mounting("right")), crop_height=usual, row_spacing=rows)
    made = Reports([LikelihoodRatio(Params(**params), setup, view)])
    made.blocks["is_begun"] = made.blocks["agreed"] = 1.0
    made.steps["missing"] = np.nan
    return made


def see(reports, points, at=(0.0, 0.0, 0.0), **block):
    """The row of feet of an edge of points (n, 4), seen from x, u [m] with a heading [rad].

    block: numbers of its row
    """
    for name, value in block.items():
        (reports.ground if name.startswith("plane") else reports.blocks)[name] = value
    reports.learn(points)
    for name, value in zip(("x", "u", "heading"), at, strict=True):
        reports.steps[name] = value
    reports.feet_of()
    return reports.feet[0]


def straight(length=16.0, sd=0.02):
    """Points of an edge along x."""
    x = np.arange(0.0, length, 0.4)
    return np.column_stack([x, np.zeros(len(x)), np.full(len(x), sd**2), x])


class Hang(NamedTuple):
    """How far the feet stand behind the edge of the tops as it is told [m], its deviation; chance that they
    are within TOLERANCE of that, that they are further out than it, and of the less likely mode.
    """

    told: float
    sd: float
    within: float
    leans: float
    other: float


class Overhang:
    """A detector of whose edge nothing is uncertain but what hangs over it.

    cut: the header missed so much of its width, where feet at the canopy's edge would stand `beside` its end
    """

    def __init__(self, upright, *, view=3.0, percent=14.0, lean_deg=20.0, cut_sd=0.03):
        usual = {"height_percent": percent, "lean_deg": lean_deg, "cut_sd_m": cut_sd}
        self._reports = reports_of(usual=upright, view=view, **usual)
        detector = self._reports.detectors
        detector["open"] = detector["closed"] = detector["centre"] = 0.0
        detector["knife"] = detector["reference"]

    def lean(self, crop, stopped):
        """Of the stems, as their height says [rad]."""
        return float(see(self._reports, straight(), crop=crop, stopped=stopped)["low"])

    def cut(self, missing, beside):
        """Over a metre, in widths [m]."""
        self._tell(beside, missing, 0.01)
        return self

    def of(self, crop, crop_sd, stopped, ramp, known=0.01):
        """Of a crop height and its deviation [m], a share of rays stopped and a ramp.

        known: deviation of all else [m]
        """
        self._reports.blocks["crop"], self._reports.ground["plane_sd"] = crop, crop_sd
        self._reports.feet["dense"] = stopped
        for name, value in zip(RAMP, ramp, strict=True):
            self._reports.feet[name] = value
        edge = self._tell(0.0, np.nan, known)
        told, other = edge.offset, edge.other_chance
        leans = 1.0 - other if told > TOLERANCE else other
        return Hang(told, float(self._reports.feet["hang_sd"][0]), edge.confidence, leans, other)

    def _tell(self, canopy, missing, known):
        reports = self._reports
        reports.learn([[0.0, 0.0, 1e-4, 0.0]])
        reports.steps["missing"], reports.steps["travel"] = missing, 1.0
        reports.feet["is_found"] = 1.0
        line = {"x": reports.detectors["reference"][0], "u": canopy, "offset_sd": known}
        for name in reports.lines.dtype.names:
            reports.lines[name] = line.get(name, 0.0)
        reports.edge_of()
        return reports.edge()
