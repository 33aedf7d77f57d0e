"""What falls on a surface of the sky and of the ground before it, by a fine integral over the sphere."""

import numpy as np

from swath.field.memory_layout import Organ
from swath.sensing.camera.shading import COLOURS, linear


def sky_light(day, normal, rows=180, columns=360):
    """Linear light (3,) on a surface with a unit normal (3,) in shadow, in a picture's light."""
    up, around = np.meshgrid(
        (np.arange(-rows, rows) + 0.5) / rows, np.arange(columns) * 2.0 * np.pi / columns, indexing="ij"
    )
    flat = np.sqrt(1.0 - up * up)
    ways = np.stack([flat * np.cos(around), flat * np.sin(around), up], axis=-1)
    ground = linear(COLOURS[Organ.GROUND]) * (day.sky + day.sun * max(day.toward[2], 0.0))
    sent = np.where(up[..., None] > 0.0, day.sky_at(ways), ground)
    return 4.0 * (sent * np.maximum(ways @ np.asarray(normal), 0.0)[..., None]).mean(axis=(0, 1))
