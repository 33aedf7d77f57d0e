"""Data sheets of obstacles: `data/obstacles/*.yaml`, bodies of simple solids, and what they reflect."""

from dataclasses import dataclass, field
from typing import Annotated, Literal

import numpy as np

from swath.core.portable import power
from swath.documents.data_sheets import read_sheet
from swath.documents.sheet_fields import Key, Quantity
from swath.field.memory_layout import Solids

Six = tuple[float, float, float, float, float, float]
Seven = tuple[float, float, float, float, float, float, float]


@dataclass(frozen=True, kw_only=True)
class ObstacleSheet:
    """A thing with its foot at the origin, x forward, y left, z up.

    length, width, height: of the whole [m]; reflectance: at 905 nm
    rcs_24, rcs_77: radar cross section at 24 and 77 GHz [dBsm]
    boxes, ellipsoids: rows of middle x, y, z and length, width, height [m]
    capsules: rows of two ends x, y, z each and the radius [m]
    """

    format: str
    kind: Literal["obstacle"] = "obstacle"
    name: str
    note: str = ""
    length: Annotated[float, Quantity("m", 0.01, 200)]
    width: Annotated[float, Quantity("m", 0.01, 200)]
    height: Annotated[float, Quantity("m", 0.01, 100)]
    reflectance: Annotated[float, Quantity("", 0, 1)]
    rcs_24: Annotated[float, Quantity("", -60, 60, key="rcs_24_ghz_dbsm")]
    rcs_77: Annotated[float, Quantity("", -60, 60, key="rcs_77_ghz_dbsm")]
    boxes: Annotated[list[Six], Key("body.boxes_m")] = field(default_factory=list)
    ellipsoids: Annotated[list[Six], Key("body.ellipsoids_m")] = field(default_factory=list)
    capsules: Annotated[list[Seven], Key("body.capsules_m")] = field(default_factory=list)

    def solids(self, size: tuple[float, float, float], reflectance: float) -> Solids:
        """The body stretched to a length, width and height [m]; a radius goes with the mean of x and y."""
        scale = np.array(size) / np.array([self.length, self.width, self.height])
        boxes, round_ = (np.array(rows, dtype=float).reshape(-1, 6) for rows in (self.boxes, self.ellipsoids))
        rods = np.array(self.capsules, dtype=float).reshape(-1, 7)
        sides = np.tile(np.eye(3), (len(boxes), 1, 1)), np.tile(np.eye(3), (len(round_), 1, 1))
        return Solids(
            box_centre=scale * boxes[:, :3],
            box_axes=sides[0],
            box_half=0.5 * scale * boxes[:, 3:],
            box_reflectance=np.full(len(boxes), reflectance),
            ellipsoid_centre=scale * round_[:, :3],
            ellipsoid_axes=sides[1],
            ellipsoid_half=0.5 * scale * round_[:, 3:],
            ellipsoid_reflectance=np.full(len(round_), reflectance),
            capsule_a=scale * rods[:, :3],
            capsule_b=scale * rods[:, 3:6],
            capsule_radius=float(power(scale[0] * scale[1], 0.5)) * rods[:, 6],
            capsule_reflectance=np.full(len(rods), reflectance),
        )


def load_obstacle(kind: str) -> ObstacleSheet:
    """The sheet of a kind of obstacle."""
    return read_sheet("obstacles", kind).read(ObstacleSheet)
