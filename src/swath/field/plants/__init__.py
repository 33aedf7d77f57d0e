"""Plants of a crop as capsules (stalks, ears, pods) and ribbons (leaves): arrays of plants, no plant objects.

Every stem stands with its foot at the origin; z up. The library moves them to their places. A module per
habit makes them: `cereal` (also stubble), `branched` (oilseed rape), `maize`, `weed`.
"""

from swath.field.plants.make import leaf_parts_of, make_plants
from swath.field.plants.parts import CUTOFF, Plants, silhouette_area

__all__ = ["CUTOFF", "Plants", "leaf_parts_of", "make_plants", "silhouette_area"]
