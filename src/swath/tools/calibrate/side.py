"""How beams that enter a crop through its side differ from those that enter through its top.

The depth at which a spot is half stopped varies from beam to beam, the more the fewer and thicker the pieces
of plants it meets: their number is a Poisson number. At the top these are ears, below thin stems, so a beam
through the side wall of a stand has its echo at a depth that varies less. Its median stays where half of the
spot is stopped (ln 2 for the median of the spot).
"""

import numpy as np
from numpy.typing import NDArray

from swath.core.random import Stream
from swath.core.units import DEG
from swath.rays.spread import SideSpread
from swath.tools.calibrate.stand_scans import VIEWS, EchoSettings, Place, SampleStands

F64 = NDArray[np.float64]
HEIGHT = (0.3, 0.45, 0.6, 0.75, 0.9)  # relative heights at which beams begin in the crop
TOP = 1.05  # from here on beams enter through the top
ABOVE = 1.2  # where those begin with which the others are compared
SPOT = (0.02, 0.05, 0.125)  # [m]
DENSITY = (0.3, 0.6, 1.2)  # of the usual one
TELLS = ((True, True, False), (False, True, True))  # of these the lower, the upper quarter
DEPRESSION = (8.0, 20.0)  # [deg]
QUARTERS = (0.25, 0.5, 0.75)
GROUND = 0.04  # lower returns are the ground's [m]
NARROWEST, WIDEST = 0.3, 1.5  # factors are kept within


def side_spread(
    stands: SampleStands, echo: EchoSettings, stream: Stream, silhouette: F64, *, fine: float, lines: int
) -> SideSpread:
    """From beams that begin inside a stand; silhouette [m2]: of it as in `SpreadTable`, in steps of `fine`.

    Factors are those between the distances of the lower and the upper quarter of log depth from its median,
    over depressions and densities: of early echoes in thin stands, where they decide whether a beam gets
    through, of late ones in dense stands.
    """
    crop = stands.crop.stand
    begins = (*HEIGHT, ABOVE)
    above = np.zeros((2, len(begins), len(SPOT)))
    inside = np.zeros_like(above)
    median: list[list[float]] = [[] for _ in SPOT]
    for part, tells in zip(DENSITY, zip(*TELLS, strict=True), strict=True):
        for degrees in DEPRESSION:
            for m, spot in enumerate(SPOT):
                place = Place(part * crop.density, crop.height, degrees * DEG, spot)
                child = stream.child(f"{part:g} {degrees:g} {spot:g}")
                quarters = np.array([_quarters(stands, place, z, lines, echo, child, silhouette, fine)
                                     for z in begins])  # fmt: skip
                step = np.diff(quarters, axis=1).T
                known = np.isfinite(step) & np.isfinite(step[:, -1:]) & np.array(tells)[:, None]
                above[:, :, m] += np.where(known, step[:, -1:], 0.0)
                inside[:, :, m] += np.where(known, step, 0.0)
                median[m] += [float(quarters[-1, 1])] if np.isfinite(quarters[-1, 1]) else []
    factor = np.where(above > 0.0, inside / np.where(above > 0.0, above, 1.0), 1.0)
    middle = [float(np.exp(np.mean(found))) if found else np.log(2.0) for found in median]
    factor = np.clip(factor, NARROWEST, WIDEST)
    return SideSpread(np.array([*HEIGHT, TOP]), np.array(SPOT), factor, np.array(middle))


def _quarters(
    stands: SampleStands,
    place: Place,
    relative: float,
    lines: int,
    echo: EchoSettings,
    stream: Stream,
    silhouette: F64,
    fine: float,
) -> F64:
    """Quarters of the log depth at echoes of beams that begin at a relative height, (3,); nan: of ground."""
    seen = stands.scan(place, lines, echo, stream.child(f"{relative:g}"), begin=relative)
    height = seen.height[~np.isnan(seen.height)]
    if not len(height):
        return np.full(len(QUARTERS), np.nan)
    nearest = int(np.argmin(np.abs(np.log(np.tan(np.array(VIEWS) * DEG) / np.tan(place.depression)))))
    at = fine * np.arange(silhouette.shape[1])
    area = np.interp(height / place.height, at, silhouette[nearest])
    depth = area - np.interp(relative, at, silhouette[nearest])
    depth = np.where(height < GROUND, np.inf, np.maximum(depth, 1e-6))
    found = np.quantile(depth, QUARTERS, method="lower") * place.density / np.tan(place.depression)
    return np.asarray(np.where(np.isfinite(found), np.log(found), np.nan))
