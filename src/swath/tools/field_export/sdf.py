"""A scene as a world for Gazebo Harmonic: SDFormat 1.10, height map, plants as STL, other meshes as OBJ."""

from collections.abc import Iterator
from math import atan2, cos
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import numpy as np

from swath.core.files.output_folder import held
from swath.core.files.whole_file import write_whole
from swath.core.frames import Pose
from swath.field.memory_layout import Solids
from swath.field.site_setup import Sighted
from swath.record.scan_messages import encoded
from swath.runtime.world import World
from swath.signals import F64
from swath.tools.field_export.glb import MACHINE, picture_bytes
from swath.tools.field_export.scene import BODY, FieldScene, Ground, capsules_of

VERSION = "1.10"  # of SDFormat: what Harmonic's parser (sdformat 14) writes itself
LEAST_SPAN = 0.01  # of a heightmap [m]
SYSTEMS = {
    "gz-sim-physics-system": "gz::sim::systems::Physics",
    "gz-sim-user-commands-system": "gz::sim::systems::UserCommands",
    "gz-sim-scene-broadcaster-system": "gz::sim::systems::SceneBroadcaster",
}
SENSORS = ("gz-sim-sensors-system", "gz::sim::systems::Sensors")
DRIVE = ("gz-sim-velocity-control-system", "gz::sim::systems::VelocityControl")


def write_sdf(folder: Path, scene: FieldScene, world: World) -> list[Path]:
    """`world.sdf` with `ground.png` (heights), `cover.png` (what lies there) and meshes; the machines obey
    Twist on `/model/NAME/cmd_vel`. Returns the files.
    """
    files = {
        "ground.png": height_bytes(scene.ground),
        "cover.png": picture_bytes(scene.ground),
        "level.png": encoded(np.full((8, 8, 3), (128, 128, 255), np.uint8), "PNG"),  # normals that point up
    }
    for surface in scene.surfaces:
        files[f"meshes/{surface.name}.stl"] = stl_bytes(surface.corners)
    root = Element("sdf", version=VERSION)
    made = SubElement(root, "world", name="field")
    _settings(made, scene)
    _ground(made, scene.ground)
    _stand(made, scene)
    for body in scene.bodies:
        _body(made, body, scene, world, files)
    indent(root)
    files["world.sdf"] = b'<?xml version="1.0"?>\n' + tostring(root, encoding="utf-8") + b"\n"
    with held(folder, tuple(files), "export", alone=False):
        return [write_whole(folder / name, data) for name, data in files.items()]


def sdf_size(scene: FieldScene) -> int:
    """Size of the meshes [bytes]."""
    return 50 * sum(len(s.faces) for s in scene.surfaces)


def height_bytes(ground: Ground) -> bytes:
    """Heights as a 16 bit PNG, 0 = lowest, 65535 = highest, the first row in the north, as Gazebo reads
    them.
    """
    share = (ground.filled - ground.low) / span(ground)
    return encoded(np.rint(65535 * share[::-1]).astype(np.uint16), "PNG")


def span(ground: Ground) -> float:
    """What the full scale of the heightmap stands for [m]."""
    return max(float(np.nanmax(ground.heights)) - ground.low, LEAST_SPAN)


def stl_bytes(corners: F64) -> bytes:
    """Triangles (n, 3, 3) as a binary STL file."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    rows = np.zeros(len(corners), np.dtype([("n", "<f4", 3), ("c", "<f4", (3, 3)), ("more", "<u2")]))
    rows["n"], rows["c"] = normal, corners
    return b"swath".ljust(80) + np.uint32(len(rows)).tobytes() + rows.tobytes()


def obj_bytes(corners: F64) -> bytes:
    """Triangles (n, 3, 3) as a Wavefront OBJ file, which every reader of SDF can collide with."""
    points, faces = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    lines = [f"v {_numbers(point)}" for point in points]
    lines += [f"f {a} {b} {c}" for a, b, c in (faces.reshape(-1, 3) + 1).tolist()]
    return "\n".join([*lines, ""]).encode("ascii")


def _settings(world: Element, scene: FieldScene) -> None:
    physics = SubElement(world, "physics", name="steps", type="ignored")
    _tell(physics, max_step_size="0.004", real_time_factor="1.0")
    for file, name in SYSTEMS.items():
        SubElement(world, "plugin", filename=file, name=name)
    sensors = SubElement(world, "plugin", filename=SENSORS[0], name=SENSORS[1])
    _tell(sensors, render_engine="ogre2")
    sky = SubElement(world, "scene")
    _tell(sky, ambient="0.6 0.6 0.6 1", background="0.75 0.85 0.95 1")
    sun = SubElement(world, "light", name="sun", type="directional")
    _tell(sun, cast_shadows="true", pose="0 0 50 0 0 0", diffuse="0.9 0.9 0.85 1", direction="-0.4 0.3 -0.85")
    if scene.origin is not None:
        place = scene.origin.to_lon_lat([[0.0, 0.0], [0.0, 1000.0]])
        lon, lat = place[0].tolist()
        north = atan2((place[1, 0] - lon) * cos(np.radians(lat)), place[1, 1] - lat)
        earth = SubElement(world, "spherical_coordinates")
        _tell(earth, surface_model="EARTH_WGS84", world_frame_orientation="ENU", latitude_deg=f"{lat:.9f}",
              longitude_deg=f"{lon:.9f}", elevation=_number(scene.origin.height),
              heading_deg=f"{-np.degrees(north):.6f}")  # fmt: skip


def _ground(world: Element, ground: Ground) -> None:
    """The model of the ground stands at its lowest height, so that the map itself begins at 0."""
    side = float(ground.x[-1] - ground.x[0])
    middle = [0.5 * (ground.x[0] + ground.x[-1]), 0.5 * (ground.y[0] + ground.y[-1]), ground.low]
    link = _static(world, "ground", Pose(np.array(middle), np.eye(3)))
    for tag in ("collision", "visual"):
        geometry = SubElement(SubElement(link, tag, name=tag), "geometry")
        heights = SubElement(geometry, "heightmap")
        _tell(heights, uri="ground.png", size=_numbers([side, side, span(ground)]), pos="0 0 0")
        if tag == "visual":
            texture = SubElement(heights, "texture")
            _tell(texture, size=_number(side), diffuse="cover.png", normal="level.png")
        _tell(heights, use_terrain_paging="false", sampling="1")


def _stand(world: Element, scene: FieldScene) -> None:
    if not scene.surfaces:
        return
    link = _static(world, "stand", Pose.identity())
    for surface in scene.surfaces:
        visual = SubElement(link, "visual", name=surface.name)
        mesh = SubElement(SubElement(visual, "geometry"), "mesh")
        _tell(mesh, uri=f"meshes/{surface.name}.stl")
        _coloured(visual, surface.colour)


def _body(world: Element, body: Sighted, scene: FieldScene, whole: World, files: dict[str, bytes]) -> None:
    """An obstacle stands; a machine obeys Twist and nothing else: no wheels, no weight on the ground."""
    name = body.name.replace(" ", "_")
    is_machine = body.name in scene.machines
    pose = body.pose
    if is_machine:
        model = SubElement(world, "model", name=name)
        _tell(model, pose=_pose(pose))
        link = SubElement(model, "link", name="link")
        _tell(link, gravity="false")
        machine = whole.machines.get(body.name)
        _inertial(link, 5000.0 if machine is None else machine.sheet.dynamics.mass)
        SubElement(model, "plugin", filename=DRIVE[0], name=DRIVE[1])
    else:
        link = _static(world, name, pose)
    colour = MACHINE if is_machine else BODY
    for number, (at, geometry, mesh) in enumerate(_shapes(body.solids)):
        inner = pose.inverse() @ at
        if mesh is not None:
            uri = f"meshes/{name}_{number}.obj"
            files[uri] = obj_bytes(mesh)
            geometry = Element("geometry")
            _tell(SubElement(geometry, "mesh"), uri=uri)
        for tag in ("collision", "visual"):
            part = SubElement(link, tag, name=f"{tag}_{number}")
            _tell(part, pose=_pose(inner))
            part.append(geometry)
            if tag == "visual":
                _coloured(part, colour)


def _shapes(solids: Solids) -> Iterator[tuple[Pose, Element, F64 | None]]:
    """Frame in the world and geometry of every part; of a mesh its triangles in that frame instead."""
    for centre, axes, half in solids.boxes:
        yield Pose(centre, axes), _geometry("box", size=_numbers(2.0 * half)), None
    for centre, axes, half in solids.ellipsoids:
        yield Pose(centre, axes), _geometry("ellipsoid", radii=_numbers(half)), None
    for a, b, radius, pose in capsules_of(solids):
        length = float(np.linalg.norm(b - a))
        if length > 0.0:
            yield pose, _geometry("capsule", radius=_number(radius), length=_number(length)), None
        else:
            yield pose, _geometry("sphere", radius=_number(radius)), None
    for mesh, centre, axes in zip(solids.mesh_shape, solids.mesh_centre, solids.mesh_axes, strict=True):
        yield Pose(centre, axes), Element("geometry"), mesh.corners.astype(float)


def _inertial(link: Element, mass: float) -> None:
    """A mass, and the inertia of a ball of 2 m with it: Twist moves the model whatever they are."""
    inertial = SubElement(link, "inertial")
    _tell(inertial, mass=_number(mass))
    turn = _number(0.4 * mass * 4.0)
    _tell(SubElement(inertial, "inertia"), ixx=turn, ixy="0", ixz="0", iyy=turn, iyz="0", izz=turn)


def _static(world: Element, name: str, pose: Pose) -> Element:
    """A model that stands; its link."""
    model = SubElement(world, "model", name=name)
    _tell(model, static="true", pose=_pose(pose))
    return SubElement(model, "link", name="link")


def _geometry(tag: str, **numbers: str) -> Element:
    found = Element("geometry")
    _tell(SubElement(found, tag), **numbers)
    return found


def _coloured(visual: Element, colour: str) -> None:
    share = " ".join(f"{int(colour[i : i + 2], 16) / 255:.4f}" for i in (1, 3, 5)) + " 1"
    _tell(SubElement(visual, "material"), ambient=share, diffuse=share)


def _tell(node: Element, **texts: str) -> None:
    for tag, text in texts.items():
        SubElement(node, tag).text = text


def _pose(pose: Pose) -> str:
    return _numbers([*pose.position, *pose.euler()])


def _numbers(values: F64 | list[float]) -> str:
    return " ".join(_number(float(v) + 0.0) for v in values)


def _number(value: float) -> str:
    return f"{value:.9g}"
