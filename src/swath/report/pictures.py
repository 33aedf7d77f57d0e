"""What the cameras of a machine saw: pictures on the way, and how a report shows them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from swath.record.messages import RecordedMachine
from swath.report import plots
from swath.signals import OBSTACLE_KINDS, Image, MachineState, Signal
from swath.signals.image import ImageBoxes

SPACING_M = 2.0  # between kept pictures at first; doubles whenever MOST are kept
MOST = 8
SHOWN = 4


@dataclass(frozen=True)
class KeptPicture:
    """A picture, the boxes around what is in it where the camera gives them, and where it was taken [m]."""

    image: Image
    boxes: ImageBoxes | None
    distance: float

    @property
    def nearest(self) -> float:
        """Distance of the nearest thing in it [m], inf where there is none."""
        return float(min(self.boxes.distance, default=np.inf)) if self.boxes is not None else float("inf")


@dataclass
class _Camera:
    newest: KeptPicture
    nearest: KeptPicture
    kept: list[KeptPicture] = field(default_factory=list)
    spacing: float = SPACING_M


class PictureSampler:
    """Observer that keeps pictures of every camera of a machine at even distances, the newest, and the one
    with the nearest thing in it.
    """

    def __init__(self, machine: RecordedMachine) -> None:
        self.machine, self._distance = machine, 0.0
        self._cameras: dict[str, _Camera] = {}

    def __call__(self, slot: str, t: int, outputs: Mapping[str, Signal]) -> None:
        """Watch what `slot` published."""
        name, _, part = slot.partition(".")
        if name != self.machine.name:
            return
        image = boxes = None
        for signal in outputs.values():
            if isinstance(signal, MachineState):
                self._distance = signal.distance
            elif isinstance(signal, Image):
                image = signal
            elif isinstance(signal, ImageBoxes):
                boxes = signal
        if image is None or image.t == 0:  # black, before the first exposure
            return
        if image.colour.size or image.depth.size:
            self._keep(part, KeptPicture(image, boxes, self._distance))

    def _keep(self, part: str, picture: KeptPicture) -> None:
        camera = self._cameras.setdefault(part, _Camera(picture, picture))
        camera.newest = picture
        if picture.nearest < camera.nearest.nearest:
            camera.nearest = picture
        if not camera.kept or picture.distance - camera.kept[-1].distance >= camera.spacing:
            camera.kept.append(picture)
            if len(camera.kept) > MOST:
                camera.kept, camera.spacing = camera.kept[::2], 2.0 * camera.spacing

    def pick(self) -> dict[str, list[KeptPicture]]:
        """By camera SHOWN pictures at the most, in the order of time: spread over the run, and the one with
        the nearest thing in it.
        """
        return {slot: _picked(camera) for slot, camera in self._cameras.items()}


def _picked(camera: _Camera) -> list[KeptPicture]:
    pictures = camera.kept if camera.newest is camera.kept[-1] else [*camera.kept, camera.newest]
    wanted = _spread(pictures, SHOWN)
    if np.isfinite(camera.nearest.nearest) and all(p is not camera.nearest for p in wanted):
        wanted = [*_spread(pictures, SHOWN - 1), camera.nearest]
    return sorted(wanted, key=lambda picture: picture.image.t)


def _spread(pictures: Sequence[KeptPicture], count: int) -> list[KeptPicture]:
    places = np.round(np.linspace(0, len(pictures) - 1, min(count, len(pictures))))
    return [pictures[i] for i in np.unique(places).astype(int).tolist()]


def pictures_figure(pictures: Sequence[KeptPicture]) -> Any:
    """Pictures side by side, boxes drawn; depth in colours where a camera measures nothing else."""
    rows, shape = (len(pictures) + 1) // 2, pictures[0].image.height / pictures[0].image.width
    fig = plots.figure(11.0, rows * (5.4 * shape + 0.35))
    axes = fig.subplots(rows, 2, squeeze=False).ravel()
    far = max((_far(p.image) for p in pictures), default=1.0)
    drawn = None
    for ax, picture in zip(axes, pictures, strict=False):
        image = picture.image
        if image.colour.size:
            ax.imshow(image.colour)
        else:
            drawn = ax.imshow(image.depth, cmap="viridis_r", vmin=0.0, vmax=far)
        if picture.boxes is not None:
            _draw_boxes(ax, picture.boxes)
        ax.set_title(f"{picture.distance:.1f} m, {image.t * 1e-9:.1f} s", loc="left", fontsize=9.5)
    for ax in axes:
        ax.set_axis_off()
    if drawn is not None:
        fig.colorbar(drawn, ax=list(axes), label="distance along the optical axis [m]", shrink=0.8)
    return fig


def _far(image: Image) -> float:
    known = image.depth[np.isfinite(image.depth)]
    return float(np.percentile(known, 98.0)) if known.size else 1.0


def _draw_boxes(ax: Any, boxes: ImageBoxes) -> None:
    from matplotlib.patches import Rectangle

    for kind, left, top, right, bottom, distance in zip(
        boxes.kind, boxes.left, boxes.top, boxes.right, boxes.bottom, boxes.distance, strict=True
    ):
        ax.add_patch(Rectangle((left, top), right - left, bottom - top, fill=False, ec=plots.ORANGE, lw=1.4))
        ax.text(
            left,
            bottom + 2.0,
            f"{OBSTACLE_KINDS[kind]}, {distance:.1f} m",
            color="white",
            fontsize=8.0,
            va="top",
            bbox={"fc": plots.ORANGE, "ec": "none", "pad": 1.0},
            clip_on=True,
        )
