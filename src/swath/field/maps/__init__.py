"""Maps from files: bands of a GeoTIFF, regular grids, and the projection of positions."""
