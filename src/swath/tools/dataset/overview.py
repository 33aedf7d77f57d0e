"""A sheet of the first pictures of a data set with masks and boxes drawn over them, to look at."""

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.whole_file import new_file
from swath.tools.dataset.coco import NAMES, mask_of

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
