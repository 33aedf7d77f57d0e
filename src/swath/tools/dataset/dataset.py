"""A data set of labelled pictures: which are still to be made, by whom, and the file of all annotations.

A picture is a function of the settings and its number. Its annotations are written last, so what a killed job
left is known, and a later one makes the rest: the same bytes as in one go, for any number of workers.

A sheet shows the first pictures with masks and boxes drawn over them. Pictures of one scene share its world,
the camera goes from place to place. What varies between the pictures is of each a function of the seed and
its number alone.
"""

import io
import json
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass
from functools import partial
from math import cos, hypot, isfinite, sin
from pathlib import Path
from typing import Any, cast

import numpy as np

import swath
from swath.core.component import Outputs
from swath.core.errors import InputError, SwathError
from swath.core.files.place import own_folder
from swath.core.files.whole_file import write_whole
from swath.core.frames import Pose
from swath.core.random import Stream
from swath.core.units import DEG
from swath.documents.json_file import read_object
from swath.documents.packed import LARGEST_BYTES, readable
from swath.documents.text_file import read_bytes
from swath.field.solid.obstacles import SheetKind, SheetObstacle, things_of
from swath.field.weather import KELVIN
from swath.record.scan_messages import encoded
from swath.runtime.assembly import assemble
from swath.runtime.workers import Lost, in_workers
from swath.scenario.overrides import layered
from swath.scenario.scenario import Scenario, load_scenario
from swath.sensing.camera.pinhole import OPTICAL
from swath.signals import F64, OBSTACLE_KINDS
from swath.tools.dataset.coco import CATEGORIES, NAMES, annotations_of, category_map, is_annotation, mask_of
from swath.tools.scan.scan import first_of_kind

CROPS = ("wheat", "barley", "rye")
DENSITIES = (300, 400, 500)  # stems/m2
KINDS: tuple[tuple[SheetKind, float, float], ...] = (  # kind, weight, least distance [m]
    ("person", 0.42, 4.0),
    ("animal", 0.16, 4.0),
    ("vehicle", 0.18, 8.0),
    ("tree", 0.1, 15.0),
    ("hedge", 0.06, 15.0),
    ("building", 0.08, 28.0),
)
MOST_THINGS = 5
STRAW_SHARE, STRAW_KG_M = 0.6, 3.0  # of the scenes with a straw swath; per metre
TURN_SD, PITCH_SD, ROLL_SD, HEIGHT_SD = 6.0, 3.0, 1.5, 0.15  # of the camera about its mount [deg, m]


@dataclass(frozen=True)
class Scene:
    """A field, its light and air. sets: changes of the scenario; straw: a swath of the pass before."""

    number: int
    sets: tuple[str, ...]
    straw: bool


@dataclass(frozen=True)
class View:
    """A picture of a scene. along: of the camera's machine behind its start [m]; aside: leftward [m].

    shift: pose_mount_camera
    """

    along: float
    aside: float
    shift: Pose


def scene_of(seed: int, number: int, machine: str, slot: str, *, varies: Sequence[str]) -> Scene:
    """Scene number k of a seed. varies: of `terrain`, `stand`, `light`, and `dust` before a scanner."""
    draw = Stream(seed, "dataset.scene").at(number)
    u = draw.uniform(size=14).tolist()
    crop, density = CROPS[int(u[0] * len(CROPS))], DENSITIES[int(u[1] * len(DENSITIES))]
    sets = [f"field.seed={int(1 + u[2] * 1e6)}"]
    if "terrain" in varies:
        slope = f"slope_percent: {6 * u[3]:.2f}, slope_azimuth_deg: {360 * u[4]:.0f}"
        sets.append(f"field.terrain={{level: formula, {slope}}}")
    if "stand" in varies:
        grown = f"crop: {crop}, stems_per_m2: {density}, height_factor: {0.85 + 0.3 * u[6]:.2f}"
        patchy = f"density_variation: {{sd_percent: {15 * u[7]:.1f}}}"
        sets.append(f"field.stand={{level: maps, {grown}, {patchy}, lean_deg: {20 * u[5]:.1f}}}")
    at, dust = f"{machine}.{slot}", 0.0 if u[9] < 0.7 else 0.002 * 15.0 ** ((u[9] - 0.7) / 0.3)
    if "dust" in varies:
        puffs = max(0.0, 0.25 * (u[8] - 0.6))
        sets += [f"{at}.weather.extinction_per_m={dust:.4f}", f"{at}.weather.near_returns={puffs:.3f}"]
    if "light" in varies:
        cloud = max(0.0, 180.0 * u[8] - 80.0)
        sets += [
            f"{at}.sun_azimuth_deg={360 * u[10]:.0f}",
            f"{at}.sun_elevation_deg={12 + 48 * u[11]:.0f}",
            f"{at}.cloud_percent={cloud:.0f}",
            f"{at}.weather.extinction_per_m={dust:.4f}",
            f"{at}.green_percent={max(0.0, 120 * (u[12] - 0.75)):.0f}",
        ]
    return Scene(number, tuple(sets), u[13] < STRAW_SHARE)


def view_of(seed: int, number: int, place: int) -> View:
    """Picture number i of a seed, at the k-th place of its scene."""
    draw = Stream(seed, "dataset.view").at(number)
    a, b, c, d = draw.standard_normal(4).tolist()
    along, aside = draw.uniform(0.0, 4.0), draw.uniform(-3.0, 3.0)
    shift = Pose.from_euler(
        (0.0, 0.0, HEIGHT_SD * a), ROLL_SD * DEG * b, PITCH_SD * DEG * c, TURN_SD * DEG * d
    )
    return View(10.0 * place + float(along), float(aside), shift)


def things_of_view(
    seed: int, number: int, eye: Pose, half_angle: float, reach: float
) -> tuple[SheetObstacle, ...]:
    """Things that stand in the view of a camera (pose_world_sensor, x forward), apart from each other."""
    draw = Stream(seed, "dataset.things").at(number)
    x0, y0, ahead = float(eye.position[0]), float(eye.position[1]), eye.euler()[2]
    weights = np.cumsum([weight for _, weight, _ in KINDS])
    found: list[SheetObstacle] = []
    for _ in range(int(draw.integers(0, MOST_THINGS + 1))):
        pick, near, side, turn, tall = draw.uniform(size=5).tolist()
        kind, _, least = KINDS[int(np.searchsorted(weights, pick * weights[-1]))]
        most = max(reach - 5.0, least + 1.0)
        distance = least * (most / least) ** near  # as often near as far
        angle = ahead + (2.0 * side - 1.0) * half_angle
        x, y = round(x0 + distance * cos(angle), 2), round(y0 + distance * sin(angle), 2)
        room = {"tree": 4.0, "hedge": 7.0, "building": 14.0, "vehicle": 3.5}.get(kind, 1.0)
        if any(hypot(o.x_m - x, o.y_m - y) < room + 2.0 for o in found):
            continue
        height = {"person": 1.55 + 0.4 * tall, "tree": 5.0 + 6.0 * tall}.get(kind)
        heading = 180.0 * (2.0 * turn - 1.0)
        name = f"{kind} {number}.{len(found)}"
        found.append(
            SheetObstacle(kind=kind, x_m=x, y_m=y, name=name, heading_deg=round(heading, 1), height_m=height)
        )
    return tuple(found)


JPEG_QUALITY = 95
BETWEEN = 10**9  # times of two pictures of a scene [ns]


@dataclass(frozen=True)
class Settings:
    """scenario: bundled name or path; sets: its changes; machine, camera: whose pictures.

    varies: of `terrain`, `stand`, `light`, `things`
    per_scene: pictures of one field in one light
    count, seed: of all pictures
    """

    scenario: str
    sets: tuple[str, ...]
    machine: str
    camera: str
    varies: tuple[str, ...]
    count: int
    seed: int
    per_scene: int


@dataclass(frozen=True)
class SceneJob:
    """The pictures of a scene that are still to be made."""

    scene: int
    pictures: tuple[int, ...]


def name_of(picture: int) -> str:
    """Name of the files of a picture, without the ending."""
    return f"{picture + 1:06d}"


def part_of(out: Path, picture: int) -> Path:
    """The file with the annotations of a picture: it is written last."""
    return out / "parts" / f"{name_of(picture)}.json"


def make_scene(settings: Settings, out: Path, job: SceneJob) -> "list[int] | str":
    """Make the pictures of a job; what was wrong."""
    try:
        for picture, seen, info in _pictures(settings, job):
            write_picture(out, picture, seen, info)
    except SwathError as error:
        return str(error)
    return list(job.pictures)


def scenario_of(settings: Settings, scene: int) -> Scenario:
    """The scenario of a scene: what varies, then the user's changes."""
    s = settings
    own = scene_of(s.seed, scene, s.machine, s.camera, varies=s.varies)
    return load_scenario(s.scenario, sets=layered(left_of(own.sets, s.sets), s.sets))


def left_of(drawn: Sequence[str], sets: Sequence[str]) -> list[str]:
    """What was drawn of a scenario, where the user's changes do not say it."""
    written = {text.split("=", 1)[0].strip() for text in sets}
    return [text for text in drawn if not _is_written(text.split("=", 1)[0], written)]


def _is_written(key: str, written: set[str]) -> bool:
    return any(w == key or w.startswith(key + ".") for w in written)


def _pictures(settings: Settings, job: SceneJob) -> Iterator[tuple[int, Outputs, dict[str, Any]]]:
    s = settings
    scenario = scenario_of(s, job.scene)
    scene = scene_of(s.seed, job.scene, s.machine, s.camera, varies=s.varies)
    slot = f"{s.machine}.{s.camera}"
    world = assemble(scenario, only={slot})
    with closing(world):
        machine = world.machines[s.machine]
        camera = machine.parts[s.camera]
        setup = camera.setup
        if scene.straw and "stand" in s.varies:
            lay_straw(setup)
        for picture in job.pictures:
            camera.reset(Stream(s.seed, f"dataset.{slot}.{picture}"))
            view = view_of(s.seed, picture, picture % s.per_scene)
            eye = eye_of(setup, view) @ camera.mounting @ view.shift
            if "things" in s.varies:
                half = float(np.arctan(0.5 * camera.pinhole.width / camera.pinhole.focal))
                wanted = things_of_view(s.seed, picture, eye, min(half, 1.2), camera.params.reach_m)
                setup.bodies.set_things(things_of(wanted, setup.field))
            t = (picture % s.per_scene + 1) * BETWEEN
            seen = camera.picture_from(t, eye @ OPTICAL)
            yield picture, seen, {"scene": job.scene, "sets": [*scene.sets]}


def eye_of(setup: Any, view: View) -> Pose:
    """pose_world_machine: along the edge from the start, and aside."""
    edge, start = setup.edge, setup.start
    if edge is None:
        forward = start.rotation[:, 0]
        place, heading = start.position + view.along * forward, start.euler()[2]
    else:
        s0, _ = edge.project(start.position[0], start.position[1])
        s1 = float(s0) + view.along
        turn = float(edge.heading_at(s1)) - float(edge.heading_at(s0))
        away = start.position[:2] - edge.point_at(s0)
        c, d = np.cos(turn), np.sin(turn)
        at = edge.point_at(s1) + np.array([c * away[0] - d * away[1], d * away[0] + c * away[1]])
        place, heading = np.array([at[0], at[1], 0.0]), start.euler()[2] + turn
    x = place[0] - view.aside * np.sin(heading)
    y = place[1] + view.aside * np.cos(heading)
    return Pose.from_euler((x, y, float(setup.field.ground_height(x, y))), yaw=float(heading))


def lay_straw(setup: Any) -> None:
    """A swath of straw where the pass before went, half a header beside the edge."""
    edge = setup.edge
    if edge is None:
        return
    side = -1.0 if edge.crop_side == "left" else 1.0
    s0, _ = edge.project(setup.start.position[0], setup.start.position[1])
    away = 0.5 * setup.machine.header_width + 1.0 if setup.machine.has_header else 3.0
    for s in np.arange(float(s0) - 5.0, float(s0) + 110.0):
        (x, y), heading = edge.point_at(s), float(edge.heading_at(s))
        left = side * np.array([-np.sin(heading), np.cos(heading)])
        ahead = np.array([np.cos(heading), np.sin(heading)])
        middle = np.array([x, y]) + away * left
        corners = [middle + a * ahead + b * left for a, b in ((0, -0.8), (1, -0.8), (1, 0.8), (0, 0.8))]
        if setup.field.covers(*middle):
            setup.field.deposit_straw(np.array(corners), STRAW_KG_M, heading=heading)


def write_picture(out: Path, picture: int, seen: Outputs, info: dict[str, Any]) -> None:
    """Picture, mask of categories, shares of things, and last the annotations."""
    image, boxes, shares = (cast(Any, seen[name]) for name in ("image", "boxes", "shares"))
    kinds = {int(n): OBSTACLE_KINDS[k] for n, k in zip(boxes.instance, boxes.kind, strict=True)}
    names = tuple(kinds.get(n, "other") for n in range(1, max(kinds, default=0) + 1))
    categories = category_map(image.label, image.instance, names)
    name = name_of(picture)
    write_whole(out / "images" / f"{name}.jpg", encoded(image.colour, "JPEG", quality=JPEG_QUALITY))
    write_whole(out / "masks" / f"{name}.png", encoded(categories, "PNG", compress_level=3))
    held = io.BytesIO()
    np.savez_compressed(held, share=shares.share, instance=shares.instance.astype(np.int64))
    write_whole(out / "shares" / f"{name}.npz", held.getvalue())
    if isfinite(image.black):
        info = {"black_white_c": [image.black - KELVIN, image.white - KELVIN], **info}
    areas = dict(zip(boxes.instance.astype(int).tolist(), boxes.area.tolist(), strict=True))
    entry = {
        "image": {
            "id": picture + 1,
            "file_name": f"{name}.jpg",
            "width": image.width,
            "height": image.height,
            "focal_px": image.focal,
            "centre_px": [image.centre_x, image.centre_y],
            "distortion": image.distortion.tolist(),
            "exposure_s": image.exposure,
            "gain": image.gain,
            **info,
        },
        "annotations": annotations_of(image.instance, categories, names, areas),
    }
    write_whole(part_of(out, picture), json.dumps(entry, separators=(",", ":")))


COLOURS = {
    "person": "#FF1744", "animal": "#AA00FF", "vehicle": "#2979FF", "machine": "#00E5FF", "tree": "#00C853",
    "hedge": "#64DD17", "building": "#FF9100", "post": "#6D4C41", "stone": "#78909C", "other": "#000000",
    "crop": "#F9D71C", "stubble": "#8D6E63", "straw": "#FFF59D", "soil": "#4E342E", "weed": "#1B5E20",
}  # fmt: skip
SHOWN, ACROSS = 12, 3


def write_overview(out: Path) -> Path:
    """Draw overview.png: the first pictures, each beside itself with its masks."""
    from matplotlib.image import imread

    from swath.report import plots

    whole = json.loads(read_bytes(out / "annotations.json", "file", "annotations", LARGEST_BYTES))
    images = whole["images"][:SHOWN]
    down = -(-len(images) // ACROSS)
    figure = plots.figure(6.6 * ACROSS, 2.5 * down)
    axes = np.atleast_1d(figure.subplots(down, 2 * ACROSS)).ravel()
    for each in axes:
        each.axis("off")
    for k, image in enumerate(images):
        picture = imread(io.BytesIO(picture_bytes(out, image["file_name"])), format="jpg").astype(float)
        own = [a for a in whole["annotations"] if a["image_id"] == image["id"]]
        axes[2 * k].imshow(picture.astype(np.uint8))
        axes[2 * k].set_title(image["file_name"], fontsize=7, loc="left", pad=2)
        _draw(axes[2 * k + 1], picture, own)
    return plots.write_picture(out / "overview.png", figure, 80)


def _draw(axes: Any, picture: F64, annotations: list[dict[str, Any]]) -> None:
    from matplotlib.colors import to_rgb
    from matplotlib.patches import Rectangle

    shown = picture.copy()
    for annotation in annotations:
        colour = COLOURS[NAMES[annotation["category_id"] - 1]]
        mask = mask_of(annotation["segmentation"])
        shown[mask] = 0.5 * shown[mask] + 127.5 * np.array(to_rgb(colour))
    axes.imshow(shown.astype(np.uint8))
    for annotation in annotations:
        if not annotation["iscrowd"]:
            left, top, width, height = annotation["bbox"]
            name = NAMES[annotation["category_id"] - 1]
            box = Rectangle((left - 0.5, top - 0.5), width, height, fill=False, color=COLOURS[name])
            axes.add_patch(box)
            axes.text(left, top - 4, name, color=COLOURS[name], fontsize=6)


SETTINGS = "dataset.json"
VARIED = {"terrain": ("plane", "formula"), "stand": ("uniform",)}  # levels that may be replaced


def settings_of(
    scenario: str,
    *,
    count: int,
    seed: int = 1,
    sets: tuple[str, ...] = (),
    width: int = 640,
    height: int = 480,
    per_scene: int = 5,
) -> Settings:
    """What a data set is made of. InputError for what no camera or scenario can be.

    The camera is the first of the first machine that has one; where there is none, the first machine gets one
    of level `error`.
    """
    for key, value, low in (("--count", count, 1), ("--per-scene", per_scene, 1), ("--width-px", width, 16)):
        if value < low:
            raise InputError(key, value, f"expected >= {low}")
    machine, camera, own = _camera_of(load_scenario(scenario, sets=list(sets)))
    usual = (
        f"{machine}.{camera}.width_px={width}",
        f"{machine}.{camera}.height_px={height}",
        f"{machine}.{camera}.channels=[colour, label, instance]",
        f"{machine}.{camera}.shares=true",
    )
    every = tuple(layered(own, usual, sets))
    read = load_scenario(scenario, sets=list(every))
    varies = [
        part
        for part, levels in VARIED.items()
        if getattr(read.field, part) is not None and getattr(read.field, part).level in levels
    ]
    return Settings(scenario, every, machine, camera, (*varies, "light", "things"), count, seed, per_scene)


def _camera_of(scenario: Scenario) -> tuple[str, str, tuple[str, ...]]:
    """Machine, slot, and the changes that make the slot where there is none."""
    for name, machine in scenario.machines.items():
        if (slot := first_of_kind("camera", machine.slots)) is not None:
            return name, slot, ()
    name = next(iter(scenario.machines))
    mount = "{at: axle, x_m: 2.5, y_m: 0, z_m: 3.2, pitch_deg: 12}"
    return (
        name,
        "camera",
        (f"{name}.camera={{level: error, reach_m: 50, samples_per_sun_ray: 4, mount: {mount}}}",),
    )


def make_dataset(
    settings: Settings, out: Path, *, workers: int, progress: Callable[[int, int], None] | None = None
) -> Path:
    """Make the pictures that are missing in the folder `out`, then its annotations.json; returns its path.

    progress: given (pictures there, all of them)
    InputError where the folder holds a data set of other settings; SwathError where a picture cannot be made.
    """
    for folder in ("images", "masks", "shares", "parts"):
        own_folder(out / folder)
    check_same(settings, out)
    jobs = missing(settings, out)
    there = settings.count - sum(len(job.pictures) for job in jobs)
    if progress is not None:
        progress(there, settings.count)
    for job, found in in_workers(jobs, partial(partial, make_scene, settings, out), workers):
        if isinstance(found, Lost | str):
            raise SwathError(f"scene {job.scene}: {found}")
        there += len(found)
        if progress is not None:
            progress(there, settings.count)
    return join(settings, out)


def picture_bytes(out: Path, name: str) -> bytes:
    """What the file of a picture holds. InputError where it cannot be read."""
    return read_bytes(out / "images" / name, "file", "a picture", LARGEST_BYTES)


def is_there(out: Path, picture: int) -> bool:
    """Whether a picture and its annotations are there, and whole; else they are made again."""
    from PIL import Image

    name = name_of(picture)
    try:
        part = read_object(part_of(out, picture), "part", "annotations")
        image = part["image"]
        across, down = Image.open(io.BytesIO(picture_bytes(out, f"{name}.jpg"))).size
        is_own = image["id"] == picture + 1 and image["file_name"] == f"{name}.jpg"
        is_whole = all(is_annotation(a, down, across) for a in part["annotations"])
    except Exception:  # what is in damaged files may raise anything
        return False
    return bool(is_own and is_whole)


def missing(settings: Settings, out: Path) -> list[SceneJob]:
    """The pictures that are not there, by scene."""
    rest: dict[int, list[int]] = {}
    for picture in range(settings.count):
        if not is_there(out, picture):
            rest.setdefault(picture // settings.per_scene, []).append(picture)
    return [SceneJob(scene, tuple(pictures)) for scene, pictures in rest.items()]


def join(settings: Settings, out: Path) -> Path:
    """Write annotations.json from the parts of all pictures."""
    images: list[dict[str, Any]] = []
    annotations: list[dict[str, Any]] = []
    for picture in range(settings.count):
        file, what = part_of(out, picture), "what swath dataset wrote of a picture"
        part = read_object(file, "part", what)
        with readable("part", what, file):
            images.append(part["image"])
            for annotation in part["annotations"]:
                numbers = {"id": len(annotations) + 1, "image_id": part["image"]["id"]}
                annotations.append({**numbers, **annotation})
    info = {"description": f"swath {swath.__version__}: {settings.scenario}", "version": swath.__version__}
    whole: dict[str, Any] = {"info": info, "licenses": [], "images": images, "annotations": annotations}
    whole["categories"] = CATEGORIES
    return write_whole(out / "annotations.json", json.dumps(whole, separators=(",", ":")))


def check_same(settings: Any, out: Path) -> None:
    """The folder's settings, but the count, are these, a dataclass; written where there are none."""
    said = {**asdict(settings), "version": swath.__version__}
    del said["count"]
    said = json.loads(json.dumps(said))
    file = out / SETTINGS
    if not os.path.isfile(file):
        write_whole(file, json.dumps(said, indent=1))
        return
    there = read_object(file, "--out", "settings of a data set")
    for key, value in said.items():
        if there.get(key) != value:
            expected = f"expected {there.get(key)}, as in {SETTINGS} there, or another folder"
            raise InputError(key, value, expected, file=file)
