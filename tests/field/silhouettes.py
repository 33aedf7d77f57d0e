"""What stems show from the side."""

import numpy as np

from swath.field.memory_layout import Organ, Shape
from swath.field.plants import Plants


def silhouette_area(plants: Plants) -> dict[Organ, float]:
    """Summed side silhouette of each organ [m2]: capsule length times diameter; half the face of a ribbon or
    triangle.
    """
    span = np.linalg.norm(plants.b - plants.a, axis=1)
    capsule = plants.shape == Shape.CAPSULE
    face = np.linalg.norm(np.cross(plants.b - plants.a, plants.width), axis=1)
    face = np.where(plants.shape == Shape.TRIANGLE, 0.5 * face, face)
    is_fruit = np.isin(plants.organ, (Organ.EAR, Organ.POD, Organ.COB))
    rod = 2.0 * plants.radius * span + np.where(is_fruit, np.pi * plants.radius**2, 0.0)
    area = np.where(capsule, rod, face)
    kinds = sorted({Organ.STEM, Organ.EAR, Organ.LEAF} | {Organ(int(o)) for o in np.unique(plants.organ)})
    return {o: float(area[plants.organ == o].sum()) for o in kinds}
