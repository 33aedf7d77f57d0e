"""Plants of a crop as capsules (stalks, ears, pods) and ribbons (leaves): arrays of plants, no plant objects.

Every stem stands with its foot at the origin; z up. The library moves them to their places. Each file
that defines `HABIT` is a habit: what the data sheet of such a crop says and how its plants are drawn.
"""

from swath.field.plants.drawing import Drawing
from swath.field.plants.make import leaf_parts_of, make_plants
from swath.field.plants.parts import CUTOFF, Plants, silhouette_area

__all__ = ["CUTOFF", "Drawing", "Plants", "leaf_parts_of", "make_plants", "silhouette_area"]
