"""A photo from above laid onto the ground: a GeoTIFF of three bands, red, green and blue."""

from pathlib import Path

import numpy as np

from swath.core.errors import InputError
from swath.field.maps.projection import Origin
from swath.field.maps.raster import Raster
from swath.sensing.camera.shading import linear
from swath.signals import F64


class Orthophoto:
    """Colours of the ground. InputError for a file that is no such photo, or a field that lies nowhere.

    Bands are sRGB, 0 to 255, as they are: light and shadow of the day of the flight are in them.
    """

    def __init__(self, file: str, base: Path, origin: Origin | None) -> None:
        if origin is None:
            expected = "expected a field whose place on Earth is known: field.origin, or a field folder"
            raise InputError("orthophoto", file, expected)
        path = Path(file) if Path(file).is_absolute() else base / file
        place = (origin.easting, origin.northing)
        self._bands = [Raster.from_geotiff(path, place, band=band) for band in (1, 2, 3)]
        first = self._bands[0]
        if first.epsg is not None and first.epsg != origin.epsg:
            expected = f"expected a photo in EPSG:{origin.epsg}, as the field"
            raise InputError("orthophoto", f"EPSG:{first.epsg}", expected, file=path)
        values = np.stack([band.values for band in self._bands])
        if np.nanmin(values) < 0.0 or np.nanmax(values) > 255.0:
            raise InputError("orthophoto", file, "expected values from 0 to 255", file=path)
        table = linear(np.arange(256))
        self._bands = [
            Raster(np.where(np.isnan(b.values), np.nan, table[np.nan_to_num(b.values).astype(int)])
                   .astype(np.float32), b.x0, b.y0, b.cell, b.epsg)
            for b in self._bands
        ]  # fmt: skip

    def colours(self, x: F64, y: F64) -> F64:
        """Linear colour at points (n,) of the world, (n, 3), nan beside the photo."""
        return np.stack([band.sample(x, y) for band in self._bands], axis=-1)
