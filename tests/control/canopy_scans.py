"""Rays of a scan by a launch of their own, and blocks of rays that a test makes up."""

import numpy as np

from swath.control.edge.blocks import Block
from swath.control.edge.canopy_classes import CLASSES
from swath.control.edge.canopy_rays import CanopyRays
from swath.control.edge.detector_rows import ANSWER, ROW
from swath.control.edge.ground_profile import cells_of
from swath.kernels import of_worlds, repeatable, shared


class Canopy(CanopyRays):
    """Rays of a machine that knows no edge; crop 0.85 m high to the left.

    row: as the newest scan left it; step: what comes with one
    """

    def __init__(self, mounting, *, usual=(0.15, 0.1), base=3.9, **settings):
        row, (first, cells) = np.zeros(1, ROW), cells_of(base)
        own = {"sign": 1.0, "base": base, "first": first, "cells": cells, "search": 0.25, "flat": 1.0}
        for name, value in {**own, "place": mounting.position, **settings}.items():
            row["detector"][name] = value
        super().__init__(mounting, usual, row, Block(row["counted"]))
        self.clear()
        self.row, self.step, self.ground = (row[part][0] for part in ("canopy", "step", "ground"))
        self.row_of_track = row["block"][0]
        self.row_of_track["height"] = 0.85

    def take(self, scan, speed=0.0):
        """A scan into the block of its rays."""
        from swath.control.edge.detector_kernel import Memory, take

        self.aim(scan.azimuth, scan.elevation, scan.beam_t)
        self.step["speed"] = speed
        given = np.ones(1, bool), np.zeros(1, np.int32), np.array([scan.t]), scan.ranges[None]
        held = self.memory()
        repeatable(take, [*map(shared, given), of_worlds(Memory, [held])]).launch()


def answers(cells, **of):
    """What rays of these cells say, and what else is given."""
    found = np.zeros(len(cells), ANSWER)
    for name in ("height", "upper", "lower", "ahead"):
        found[name] = np.nan
    for name, values in {"cell": cells, **of}.items():
        found[name] = values
    return found


def lay(block, rays, travel, *, along=0.0, near=0, solid=None):
    """What rays say into a block, as answer_rays.cpp does. along, near: as of its row; solid: of the rays"""
    row, cells = block.row, rays["cell"].astype(int)
    block.make_room(len(rays))
    into = block.rays[int(row["rays"][0]) :][: len(rays)]
    into[:] = rays
    into["scan"] = row["next"]
    added = {"rays": len(rays), "next": 1, "scans": 1.0, "along": along, "near": near}
    for name, more in {**added, "travel": travel, "lost": travel}.items():
        row[name] += more
    np.add.at(block.counts, np.divmod(cells, CLASSES), 1.0)
    np.add.at(block.solid, np.divmod(cells if solid is None else cells[solid], CLASSES), 1.0)
