"""Terrain from the heights a combine logged: outliers out, drift between passes out, linear in between."""

import contextlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swath.field.maps.raster import Raster
from swath.field_io.clean import Cleaned

Array = NDArray[np.float64]
COARSE_CELL = 10.0  # m, of the smooth surface that outliers and slopes are taken from
REACH = 35.0  # m, of the quadratic fitted at each node of it
NEIGHBOUR_WIDTHS = 1.35  # header widths to a neighbouring pass at most
OUTLIER_SIGMA = 6.0  # robust standard deviations from the smooth surface
LEAST_OUTLIER = 0.5  # m
PULL = 0.1  # of an offset to zero, against 1 for a neighbour: (0.04 m step error / 0.13 m drift) squared
LEAST_GAIN = 0.85  # offsets are used only when they bring the step between passes below this share


@dataclass(frozen=True)
class Heights:
    """Terrain fitted to a log.

    raster: height [m] as logged less the pass offsets
    offset: of each pass [m], shape (pass_count,)
    step_before, step_after: robust sd of the height step between neighbouring passes [m]
    outlier_count: records dropped
    missing_count: records of passes without a height
    far_share: share of cells too far from any record, where the surface is only carried on smoothly
    """

    raster: Raster
    offset: Array
    step_before: float
    step_after: float
    outlier_count: int
    missing_count: int
    far_share: float


def fit_terrain(cleaned: Cleaned, grid: Raster) -> Heights | None:
    """Terrain on the cells of grid (values ignored; same coordinates as the log).

    None where less than half of the records in passes have a height.
    """
    log = cleaned.log
    in_pass = cleaned.pass_id >= 0
    usable = in_pass & np.isfinite(log.elevation)
    if not usable.any() or usable.sum() < 0.5 * in_pass.sum():
        return None
    xy, z, group = log.position[usable], log.elevation[usable], cleaned.pass_id[usable]
    reach = float(np.median(log.width[log.width > 0])) * NEIGHBOUR_WIDTHS
    residual = z - _smooth(xy, z)[0].sample(*xy.T)
    sigma = 1.4826 * float(np.median(np.abs(residual - np.median(residual))))
    good = np.abs(residual) <= max(OUTLIER_SIGMA * sigma, LEAST_OUTLIER)
    xy, z, group = xy[good], z[good], group[good]
    offset, before, after = _pass_offsets(xy, z, group, reach)
    values = _interpolate(xy, z - offset[group], grid, reach)
    far = ~np.isfinite(values)
    values = carry_on(values)
    raster = Raster(values.astype(np.float32), grid.x0, grid.y0, grid.cell, grid.epsg)
    dropped, missing = int((~good).sum()), int((in_pass & ~usable).sum())
    return Heights(raster, offset, before, after, dropped, missing, float(far.mean()))


def carry_on(values: Array) -> Array:
    """Fill nan cells smoothly from the known ones: means of ever larger squares, relaxed at each size."""
    known = np.isfinite(values)
    if known.all() or not known.any():
        return values
    ny, nx = values.shape
    padded = np.pad(values, ((0, ny % 2), (0, nx % 2)), constant_values=np.nan)
    blocks = padded.reshape(padded.shape[0] // 2, 2, -1, 2)
    count = np.isfinite(blocks).sum(axis=(1, 3))
    mean = np.where(count > 0, np.nansum(blocks, axis=(1, 3)) / np.maximum(count, 1), np.nan)
    filled = np.where(known, values, np.kron(carry_on(mean), np.ones((2, 2)))[:ny, :nx])
    for _ in range(60):
        edged = np.pad(filled, 1, mode="edge")
        around = 0.25 * (edged[:-2, 1:-1] + edged[2:, 1:-1] + edged[1:-1, :-2] + edged[1:-1, 2:])
        filled = np.where(known, values, around)
    return filled


def _smooth(xy: Array, z: Array) -> tuple[Raster, Raster, Raster]:
    """Height [m] and its slope to the east and to the north of a smooth surface.

    At nodes every COARSE_CELL a quadratic surface is fitted to the records within REACH, Gaussian weights of
    REACH / 2; nan where no record is near. Fitting a surface, not averaging cells, keeps the slope free of
    where in a cell the passes happen to lie.
    """
    from scipy.spatial import cKDTree

    low = xy.min(axis=0) - 2 * COARSE_CELL
    nx, ny = (((xy.max(axis=0) - low) / COARSE_CELL).astype(int) + 3).tolist()
    x, y = np.meshgrid(low[0] + COARSE_CELL * np.arange(nx), low[1] + COARSE_CELL * np.arange(ny))
    thinned, height = xy[::3], z[::3]
    tree = cKDTree(thinned)
    nodes = np.stack([x.ravel(), y.ravel()], axis=1)
    nodes_used = np.flatnonzero(tree.query(nodes, distance_upper_bound=2 * COARSE_CELL)[0] < np.inf)
    distance, near = tree.query(nodes[nodes_used], k=min(96, len(thinned)), distance_upper_bound=REACH)
    found = np.isfinite(distance)
    near = np.where(found, near, 0)
    weight = np.where(found, np.exp(-2.0 * (np.where(found, distance, 0.0) / REACH) ** 2), 0.0)
    u, v = ((thinned[near] - nodes[nodes_used][:, None]) / REACH).transpose(2, 0, 1)
    terms = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=-1)
    level = float(np.median(z))
    normal = np.einsum("nka,nk,nkb->nab", terms, weight, terms) + 1e-3 * np.eye(6)
    right = np.einsum("nka,nk->na", terms, weight * (height[near] - level))
    fit = np.linalg.solve(normal, right[..., None])[..., 0]
    rasters = []
    for column, scale, shift in ((0, 1.0, level), (1, 1.0 / REACH, 0.0), (2, 1.0 / REACH, 0.0)):
        values = np.full(nx * ny, np.nan, dtype=np.float32)
        values[nodes_used] = fit[:, column] * scale + shift
        rasters.append(Raster(values.reshape(ny, nx), float(low[0]), float(low[1]), COARSE_CELL))
    return rasters[0], rasters[1], rasters[2]


def _pass_offsets(xy: Array, z: Array, group: NDArray[np.int64], reach: float) -> tuple[Array, float, float]:
    """Height offset of each pass [m], and the robust step between neighbours before and after.

    Every second record is paired with the nearest records of other passes; the slope of the smooth surface
    between the two is taken off; medians per pair of passes are fitted by offsets, least squares with Huber
    weights and a pull to zero, three times with the smooth surface made anew. Offsets that do not help are
    left at zero.
    """
    from scipy.spatial import cKDTree

    count = int(group.max()) + 1
    tree = cKDTree(xy)
    index = np.arange(0, len(xy), 2)
    distance, near = tree.query(xy[index], k=min(32, len(xy)), distance_upper_bound=reach)
    row, rank = np.nonzero(np.isfinite(distance))
    i, j = index[row], near[row, rank]
    other = group[i] != group[j]
    i, j = i[other], j[other]
    offset = np.zeros(count)
    if not len(i):
        return offset, float("nan"), float("nan")
    steps = _steps(xy, z, z, i, j)
    before = _spread(steps)
    for _ in range(3):
        offset = _fit(steps, group[i], group[j], count)
        steps = _steps(xy, z, z - offset[group], i, j)
    after = _spread(steps - (offset[group[i]] - offset[group[j]]))
    if after > LEAST_GAIN * before:
        return np.zeros(count), before, before
    return offset, before, after


def _steps(xy: Array, z: Array, z_smooth: Array, i: NDArray[np.int64], j: NDArray[np.int64]) -> Array:
    """z[i] - z[j] less what the slope of the surface through z_smooth explains [m]."""
    _, east, north = _smooth(xy, z_smooth)
    gradient = np.nan_to_num(np.stack([east.sample(*xy.T), north.sample(*xy.T)], axis=1))
    slope = 0.5 * (gradient[i] + gradient[j])
    steps: Array = z[i] - z[j] - (slope * (xy[i] - xy[j])).sum(axis=1)
    return steps


def _fit(steps: Array, a: NDArray[np.int64], b: NDArray[np.int64], count: int) -> Array:
    pair, member = np.unique(a * count + b, return_inverse=True)
    order = np.lexsort((steps, member))
    number = np.bincount(member)
    start = np.r_[0, np.cumsum(number)[:-1]]
    median = steps[order][start + number // 2]
    first, second = pair // count, pair % count
    offset: Array = np.zeros(count)
    for _ in range(5):
        error = median - (offset[first] - offset[second])
        huber = np.minimum(1.0, 0.05 / np.maximum(np.abs(error), 1e-9))
        weight = number / (number + 30.0) * huber
        normal, right = np.diag(np.full(count, PULL)), np.zeros(count)
        np.add.at(normal, (first, first), weight)
        np.add.at(normal, (second, second), weight)
        np.add.at(normal, (first, second), -weight)
        np.add.at(normal, (second, first), -weight)
        np.add.at(right, first, weight * median)
        np.add.at(right, second, -weight * median)
        offset = np.asarray(np.linalg.solve(normal, right), dtype=np.float64)
    return offset - float(np.median(offset))


def _spread(steps: Array) -> float:
    return 1.4826 * float(np.median(np.abs(steps)))


def _interpolate(xy: Array, z: Array, grid: Raster, reach: float) -> Array:
    """Heights at the cells of grid within reach of a record, nan elsewhere; the nearest one outside the hull.

    Records are first averaged in squares of half a cell.
    """
    from scipy.interpolate import LinearNDInterpolator
    from scipy.spatial import QhullError, cKDTree

    key = np.floor(xy / (0.5 * grid.cell)).astype(np.int64)
    _, member = np.unique(key, axis=0, return_inverse=True)
    number = np.bincount(member)
    mean = np.stack([np.bincount(member, weights=v) / number for v in (*xy.T, z)], axis=1)
    x, y = np.meshgrid(*grid.centres())
    origin = mean[:, :2].mean(axis=0)
    cells = np.stack([x.ravel(), y.ravel()], axis=1)
    distance, nearest = cKDTree(mean[:, :2]).query(cells, distance_upper_bound=reach)
    close = np.flatnonzero(np.isfinite(distance))
    heights = np.full(len(close), np.nan)
    with contextlib.suppress(QhullError):  # all records on one line
        heights[:] = LinearNDInterpolator(mean[:, :2] - origin, mean[:, 2])(cells[close] - origin)
    values = np.full(len(cells), np.nan)
    values[close] = np.where(np.isfinite(heights), heights, mean[nearest[close], 2])
    return values.reshape(x.shape)
