"""What a camera sees as files: its channels side by side in scan.camera.png, its arrays in .npz."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swath.field.memory_layout import Organ
from swath.report.stand3d import COLOURS, GROUND
from swath.signals import Image

GAP = 4  # between the channels [px]
OTHERS = {Organ.NONE: "#FFFFFF", Organ.GROUND: GROUND, Organ.STRAW: "#F5E9C8", Organ.SOLID: "#56606B"}


def write_picture(folder: Path, image: Image) -> list[Path]:
    """Write both files; returns their paths. Colour, depth (near bright) and label, as far as it has them."""
    from matplotlib.image import imsave

    drawn = []
    if image.colour.size:
        drawn.append(image.colour)
    if image.depth.size:
        drawn.append(_depth_colours(image.depth))
    if image.label.size:
        drawn.append(_label_colours(image.label))
    gap = np.full((image.height, GAP, 3), 255, np.uint8)
    row = [part for pixels in drawn for part in (gap, pixels)][1:]
    picture, arrays = folder / "scan.camera.png", folder / "scan.camera.npz"
    imsave(picture, np.ascontiguousarray(np.concatenate(row, axis=1)))
    np.savez_compressed(
        arrays,
        t_ns=image.t,
        focal_px=image.focal,
        centre_px=np.array([image.centre_x, image.centre_y]),
        colour=image.colour,
        depth_m=image.depth,
        label=image.label,
        label_names=np.array([organ.name.lower() for organ in Organ]),
    )
    return [picture, arrays]


def _depth_colours(depth: NDArray[np.float32]) -> NDArray[np.uint8]:
    """By the logarithm of the depth, from the nearest to the furthest in the picture; white = nothing."""
    import matplotlib

    seen = np.isfinite(depth)
    if not seen.any():
        return np.full((*depth.shape, 3), 255, np.uint8)
    logs = np.log(np.where(seen, depth, np.nanmin(depth)))
    share = (logs.max() - logs) / max(float(np.ptp(logs)), 1e-6)
    shown = matplotlib.colormaps["cividis"](share, bytes=True)[..., :3]
    return np.where(seen[..., None], shown, 255).astype(np.uint8)


def _label_colours(label: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """In the colours of the other pictures of the stand."""
    from matplotlib.colors import to_rgb

    table = np.array([to_rgb({**COLOURS, **OTHERS}[organ]) for organ in Organ])
    return np.round(255.0 * table[label]).astype(np.uint8)
