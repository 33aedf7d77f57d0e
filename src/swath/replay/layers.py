"""What lies in a page, layer by layer: the field, the machines, and what was recorded of them."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.machine.body.body import corners_of
from swath.replay.area import Area
from swath.replay.charts import columns_of, shown_charts
from swath.replay.cut_times import KnifeWay, cut_times
from swath.replay.ground import far_ground, ground_of
from swath.replay.machines import STATE, Columns, cutting_height, describe, path_of, thinned
from swath.replay.plants import plants_of
from swath.replay.scans import MOST_POINTS, Recorded, pack_echoes
from swath.replay.straw import stations, swath_width
from swath.runtime.world import Machine, World
from swath.signals import F64

HEIGHT_UNIT = 1e-3  # of terrain heights [m], where they fit into 16 bits
MOST_TRIANGLES = 12000  # of a body from a file, and of its header
EDGE_STEP = 0.5  # between points of the initial edge [m]
Values = dict[str, Any]
Arrays = dict[str, NDArray[Any]]


class Layers:
    """Collects values, arrays, and notes on what is left out. tracks: by machine, not thinned.

    origin: a world point [m] that places in the page count from, so that float32 is fine enough
    """

    def __init__(self, world: World, tracks: Mapping[str, Columns], origin: F64) -> None:
        self.world, self.tracks, self.origin = world, tracks, origin
        self.machines: dict[str, Machine] = {name: world.machines[name] for name in tracks}
        self.values: Values = {}
        self.arrays: Arrays = {}
        self.notes: list[str] = []

    def add_field(self, area: Area, duration: float) -> None:
        """Terrain, stand, when it was cut, plants, and the country around."""
        field, plants = self.world.field, plants_of(self.world.field.library)
        ground = ground_of(field, area, plants.count)
        ways = [self._knife(name) for name, machine in self.machines.items() if machine.cuts]
        cut = cut_times(area, ground.codes, ways, duration)
        grid, far_heights, far_codes = far_ground(field, area)
        self.notes += plants.notes
        self.arrays |= {
            "tiles": ground.stand,
            "shown": area.shown.astype(np.uint8),
            "cut_when": cut.when,
            "cut_code": cut.codes,
            "far_codes": far_codes,
            "plant_ends": plants.ends,
            "plant_width": plants.width,
            "plant_organ": plants.organ,
            "plant_stem": plants.stem,
            "plant_feet": plants.feet,
        }
        self.arrays["heights"], near = _heights(ground.heights)
        self.arrays["far_heights"], far = _heights(far_heights)
        self.values["area"] = {
            "tile": area.tile, "first": list(area.first), "nx": area.shape[1], "ny": area.shape[0],
            "cells": area.cells, "yaw": field.stand_yaw, "unit_s": cut.unit, **near,
            "scale_max": ground.scale_max,
        }  # fmt: skip
        self.values["far"] = {**grid, **far}
        self.values["plants"] = {
            "mains": plants.mains, "per": plants.ends.shape[1], "most": plants.feet.shape[1],
            "height": field.library.height_max, "rows": field.library.row_spacing,
        }  # fmt: skip

    def _knife(self, name: str) -> KnifeWay:
        columns, machine = self.tracks[name], self.machines[name]
        ends = []
        for side in ("left", "right"):
            path = path_of(columns, *machine.sheet.header_end(side))
            ends.append(np.stack(self.world.field.to_stand(path[:, 0], path[:, 1]), axis=1))
        return KnifeWay(columns["t_s"], np.stack(ends, axis=1), cutting_height(machine, columns))

    def add_machines(self, ahead: Mapping[str, Columns] | None = None) -> None:
        """Geometry, charts, columns and edge of every machine.

        ahead: of a run that goes on, the way that each machine will go, for its edge
        """
        described = []
        for index, (name, machine) in enumerate(self.machines.items()):
            own = thinned(self.tracks[name])
            charts = shown_charts(own, cuts=machine.cuts, is_live=ahead is not None)
            names = list(dict.fromkeys([n for n in (*STATE, *columns_of(charts)) if n in own]))
            placed = dict(own)
            for column, axis in (("x_m", 0), ("y_m", 1), ("trailer_x_m", 0), ("trailer_y_m", 1)):
                if column in own:
                    placed[column] = own[column] - self.origin[axis]
            self.arrays[f"track_{index}"] = np.stack([placed[n] for n in names]).astype(np.float32)
            edge = self._edge(machine, own if ahead is None else ahead[name]) - self.origin
            self.arrays[f"edge_{index}"] = edge.astype(np.float32)
            described.append({**describe(machine), "columns": names, "charts": charts})
            self._add_body(machine, index, described[-1])
        self.values["machines"] = described

    def _add_body(self, machine: Machine, index: int, about: Values) -> None:
        """Triangles of a body from a file: what is fixed, and the header with its axes."""
        if machine.body is None:
            return
        about["header_axes"] = list(machine.header_kinematics.axes)
        for name, solids in (("body", machine.body.fixed), ("header", machine.body.header)):
            corners = corners_of(solids)
            every = max(1, -(-len(corners) // MOST_TRIANGLES))
            if every > 1:
                self.notes.append(f"{machine.name}: of its {name} one triangle in {every} is drawn")
            self.arrays[f"own_{name}_{index}"] = corners[::every].astype(np.float32)

    def _edge(self, machine: Machine, columns: Columns) -> F64:
        """The initial edge beside the way, (n, 3) [m]; none for a machine that does not cut."""
        if not machine.cuts:
            return np.zeros((0, 3))
        path = path_of(columns, *machine.sheet.header_end(machine.edge_side))
        way = machine.edge.project(path[:, 0], path[:, 1])[0]
        points = machine.edge.point_at(np.arange(float(way.min()) - 8.0, float(way.max()) + 25.0, EDGE_STEP))
        points = points[np.asarray(self.world.field.covers(points[:, 0], points[:, 1]), dtype=bool)]
        return np.column_stack([points, self.world.field.ground_height(points[:, 0], points[:, 1])])

    def add_recorded(self, found: Recorded | None) -> None:
        """Scans and straw. found: None where nothing was recorded"""
        self.values |= {"scanners": [], "straw": []}
        if found is None:
            self.notes.append("nothing was recorded: scans and straw are missing")
            return
        names = list(self.machines)
        for index, scanner in enumerate(found.scanners):
            packed = pack_echoes(scanner, MOST_POINTS // len(found.scanners), self.origin)
            if packed.shown < packed.recorded:
                slot = f"{scanner.machine}.{scanner.slot}"
                self.notes.append(f"{packed.shown} of {packed.recorded} scans of {slot} are shown")
            self.arrays |= {f"scan_{what}_{index}": array for what, array in packed.arrays().items()}
            about = {"machine": names.index(scanner.machine), "slot": scanner.slot, "unit_m": packed.unit_m}
            self.values["scanners"].append(about)
        known = {(s.machine, s.slot) for s in found.scanners}
        for name, machine in self.machines.items():
            for slot in machine.slots_of("lidar"):
                if (name, slot) not in known:
                    self.notes.append(f"{name}.{slot}: where its echoes lay in the world is not recorded")
            if name in found.straw:
                self._add_straw(name, found.straw[name])

    def _add_straw(self, name: str, straw: F64) -> None:
        width, is_spread = swath_width(self.machines[name])
        laid = stations(self.tracks[name], straw, width, self.world.field.straw_density)
        if is_spread:
            self.notes.append(f"{name}: chopped straw is not drawn")
        elif laid[:, 1].any():
            listed = self.values["straw"]
            self.arrays[f"straw_{len(listed)}"] = laid.astype(np.float32)
            listed.append({"machine": list(self.machines).index(name), "width": width})


def _heights(heights: F64) -> tuple[NDArray[np.uint16], Values]:
    """Heights as whole numbers of a unit above the lowest."""
    low, unit = float(heights.min()), max(HEIGHT_UNIT, float(np.ptp(heights)) / 65000.0)
    return np.rint((heights - low) / unit).astype(np.uint16), {"low": low, "unit_m": unit}
