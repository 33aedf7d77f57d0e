"""A data set of labelled pictures: which are still to be made, by whom, and the file of all annotations.

A picture is a function of the settings and its number. Its annotations are written last, so what a killed job
left is known, and a later one makes the rest: the same bytes as in one go, for any number of workers.

A sheet of the first pictures of a data set with masks and boxes drawn over them, to look at.
"""

import json
from collections.abc import Callable
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import swath
from swath.core.errors import InputError, SwathError
from swath.core.whole_file import new_file, own_folder, write_whole
from swath.documents.json_file import read_object
from swath.documents.packed import readable
from swath.runtime.workers import Lost, in_workers
from swath.scenario.overrides import layered
from swath.scenario.scenario import Scenario, load_scenario
from swath.scenario.slots import kind_of
from swath.tools.dataset.coco import CATEGORIES, NAMES, mask_of
from swath.tools.dataset.pictures import SceneJob, Settings, part_of, worker

COLOURS = {
    "person": "#FF1744", "animal": "#AA00FF", "vehicle": "#2979FF", "machine": "#00E5FF", "tree": "#00C853",
    "hedge": "#64DD17", "building": "#FF9100", "post": "#6D4C41", "stone": "#78909C", "other": "#000000",
    "crop": "#F9D71C", "stubble": "#8D6E63", "straw": "#FFF59D", "soil": "#4E342E", "weed": "#1B5E20",
}  # fmt: skip
SHOWN, ACROSS = 12, 3


def write_overview(out: Path) -> Path:
    """Draw overview.png: the first pictures, each beside itself with its masks."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.image import imread

    whole = json.loads((out / "annotations.json").read_text(encoding="utf-8"))
    images = whole["images"][:SHOWN]
    down = -(-len(images) // ACROSS)
    figure = Figure(figsize=(6.6 * ACROSS, 2.5 * down), dpi=80, layout="constrained")
    FigureCanvasAgg(figure)
    axes = np.atleast_1d(figure.subplots(down, 2 * ACROSS)).ravel()
    for each in axes:
        each.axis("off")
    for k, image in enumerate(images):
        picture = imread(out / "images" / image["file_name"]).astype(float)
        own = [a for a in whole["annotations"] if a["image_id"] == image["id"]]
        axes[2 * k].imshow(picture.astype(np.uint8))
        axes[2 * k].set_title(image["file_name"], fontsize=7, loc="left", pad=2)
        _draw(axes[2 * k + 1], picture, own)
    file = out / "overview.png"
    with new_file(file) as stream:
        figure.savefig(stream, format="png", metadata={"Software": None})
    return file


def _draw(axes: Any, picture: NDArray[np.float64], annotations: list[dict[str, Any]]) -> None:
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
        for slot in machine.slots:
            kind = kind_of(slot)
            if kind is not None and kind.name == "camera":
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

    progress: told (pictures there, all of them)
    InputError where the folder holds a data set of other settings; SwathError where a picture cannot be made.
    """
    for folder in ("images", "masks", "parts"):
        own_folder(out / folder)
    _check_same(settings, out)
    jobs = missing(settings, out)
    there = settings.count - sum(len(job.pictures) for job in jobs)
    if progress is not None:
        progress(there, settings.count)
    for job, found in in_workers(jobs, partial(worker, settings, out), workers):
        if isinstance(found, Lost | str):
            raise SwathError(f"scene {job.scene}: {found}")
        there += len(found)
        if progress is not None:
            progress(there, settings.count)
    return join(settings, out)


def missing(settings: Settings, out: Path) -> list[SceneJob]:
    """The pictures that are not there, by scene."""
    rest: dict[int, list[int]] = {}
    for picture in range(settings.count):
        if not part_of(out, picture).is_file():
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


def _check_same(settings: Settings, out: Path) -> None:
    """The folder's settings, but the count, are these; written where there are none."""
    said = {**asdict(settings), "version": swath.__version__}
    del said["count"]
    said = json.loads(json.dumps(said))
    file = out / SETTINGS
    if not file.is_file():
        write_whole(file, json.dumps(said, indent=1))
        return
    there = read_object(file, "--out", "settings of a data set")
    for key, value in said.items():
        if there.get(key) != value:
            expected = f"expected {there.get(key)}, as in {SETTINGS} there, or another folder"
            raise InputError(key, value, expected, file=file)
