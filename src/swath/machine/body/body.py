"""A machine's body from a file, with a header that moves."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from swath.core.errors import InputError
from swath.core.frames import Array, Pose
from swath.core.portable import product
from swath.core.units import DEG
from swath.field.memory_layout import Solids
from swath.field.mesh_file import UNITS, UP, file_up, read_mesh
from swath.field.solids import merge, mesh, moved
from swath.machine.body.model_xml import LENGTH_MAX, Part
from swath.machine.body.sdf import read_sdf
from swath.machine.body.urdf import read_urdf
from swath.scenario.sections import BodySection

HEADER = "header"
READERS = {".urdf": read_urdf, ".sdf": read_sdf}


@dataclass(frozen=True)
class MachineBody:
    """A body in the machine frame. fixed: what does not move in it; header: as with a level header"""

    fixed: Solids
    header: Solids

    @property
    def level(self) -> Solids:
        """All of it, with the header as the file has it."""
        return merge(self.fixed, self.header)

    @property
    def triangles(self) -> Array:
        """All of it with a level header, (n, 3, 3) [m]."""
        return corners_of(self.level)

    def with_header_at(self, pose: Pose) -> Solids:
        """All of it. pose: of the header in the machine frame, identity where it is level"""
        return merge(self.fixed, moved(self.header, pose))


def corners_of(solids: Solids) -> Array:
    """Triangles of what was read from a file, (n, 3, 3) [m]."""
    places = zip(solids.mesh_shape, solids.mesh_centre, strict=True)
    found = [shape.corners.astype(float) + centre for shape, centre in places]
    return np.concatenate([*found, np.zeros((0, 3, 3))])


def read_body(section: BodySection, key: str) -> MachineBody:
    """The body that a section of a scenario names. key: of the section, for errors

    InputError for a file that cannot be read, a header that it does not have, or a size that no machine has.
    """
    path = Path(section.file)
    reader = READERS.get(path.suffix.lower())
    parts = reader(path, f"{key}.file") if reader else _of_mesh(section, path, f"{key}.file")
    at = Pose.from_euler([section.x_m, section.y_m, section.z_m], yaw=section.heading_deg * DEG)
    corners = [at.apply(part.corners * section.scale) for part in parts]
    size = np.ptp(np.concatenate(corners).reshape(-1, 3), axis=0).max()
    if not 0.1 <= size <= LENGTH_MAX:
        expected = f"expected a machine of 0.1 to {LENGTH_MAX:g} m, it is {size:.3g} m: unit, scale?"
        raise InputError(f"{key}.file", path.name, expected)
    wanted = section.header or HEADER
    lifted = [wanted in part.group for part in parts]
    if section.header is not None and not any(lifted):
        names = ", ".join(sorted({name for part in parts for name in part.group}))
        raise InputError(f"{key}.header", section.header, f"expected one of {names}")
    solid = [mesh(c, Pose.identity(), section.reflectance) for c in corners]
    pairs = list(zip(solid, lifted, strict=True))
    return MachineBody(merge(*(s for s, up in pairs if not up)), merge(*(s for s, up in pairs if up)))


def _of_mesh(section: BodySection, path: Path, key: str) -> tuple[Part, ...]:
    """The parts of a mesh file, each a link by its name."""
    turn: Array = UP[section.up or file_up(path)]
    found = read_mesh(path, key=key)
    return tuple(
        Part(p.names[0] if p.names else "", p.names, product(p.corners, turn.T) * UNITS[section.unit])
        for p in found
    )
