"""The field: terrain, stand, crop and its plants, cutting, straw, obstacles; the one truth of a run."""
