"""The ground under measured crop: where the wheels stood, or the lowest echoes."""

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from swath.core.frames import rotation_matrices
from swath.signals import F64
from swath.tools.height_map.gather import Samples
from swath.tools.height_map.poses import PoseTrack

BLOCK = 16  # nodes along a block that is worked on at once
AT_ONCE = 1 << 20  # nodes of windows that are copied at once


@dataclass(frozen=True)
class Params:
    """What counts as ground: estimates, tried on stands of known ground (tests/tools/test_replay_build.py).

    step_m: distance between poses that count
    smooth_m: standard deviation of the weights along the path
    low_share: share of the heights in a patch that lie below what is taken for the ground
    fewest: number of echoes below which a patch is not used
    plant_m: a patch whose low echoes are this much above the lowest within `nearby` patches shows no ground
    below_m: low echoes further below the ground of the poses are more than noise and soft ground
    lowest_m: an echo below this is no echo
    """

    step_m: float = 0.25
    smooth_m: float = 2.0
    low_share: float = 0.05
    fewest: int = 12
    plant_m: float = 0.3
    nearby: int = 3
    below_m: float = 0.2
    lowest_m: float = -1.0


USUAL = Params()


def ground_of_poses(track: PoseTrack, x: F64, y: F64, params: Params = USUAL) -> F64:
    """Height [m] of the planes that the machine stood on at world points x, y, (ny, nx).

    It is a weighted mean along the path with gaussian weights, nearest poses most. A pose's plane is its x-y
    plane, so the roll of the machine carries the slope sideways.
    """
    place, normal = _planes(track, params.step_m)
    height = np.zeros(x.shape)
    for j in range(0, x.shape[0], BLOCK):
        for i in range(0, x.shape[1], BLOCK):
            part = np.s_[j : j + BLOCK, i : i + BLOCK]
            px, py = x[part].ravel(), y[part].ravel()
            far = np.hypot(place[:, 0] - px.mean(), place[:, 1] - py.mean())
            size = np.hypot(np.ptp(px), np.ptp(py))
            near = far <= far.min() + size + 3.0 * params.smooth_m
            height[part] = _blend(place[near], normal[near], px, py, params.smooth_m).reshape(x[part].shape)
    return height


def _planes(track: PoseTrack, step: float) -> tuple[F64, F64]:
    """Points (n, 3) and slopes (n, 2) of the ground every `step` [m] of way."""
    distance = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(track.position[:, :2], axis=0).T))])
    index = np.unique(
        np.searchsorted(distance, np.arange(0.0, distance[-1] + step, step)).clip(max=len(distance) - 1)
    )
    up = rotation_matrices(*track.angle[index].T)[:, :, 2]
    steep = np.abs(up[:, 2]) < 0.5
    slope = np.where(steep[:, None], 0.0, -up[:, :2] / np.where(steep, 1.0, up[:, 2])[:, None])
    return track.position[index], slope


def _blend(place: F64, slope: F64, x: F64, y: F64, smooth: float) -> F64:
    dx, dy = x[:, None] - place[:, 0], y[:, None] - place[:, 1]
    square = dx**2 + dy**2
    weight = np.exp(-0.5 * (square - square.min(axis=1, keepdims=True)) / smooth**2)
    level = place[:, 2] + slope[:, 0] * dx + slope[:, 1] * dy
    return np.asarray((weight * level).sum(axis=1) / weight.sum(axis=1))


def low_echoes(samples: Samples, shape: tuple[int, ...], node_cells: int, params: Params = USUAL) -> F64:
    """Height of the lowest echoes at lattice nodes above the ground that heights count from [m].

    In each patch of node_cells x node_cells cells it is the low share of the heights. Patches where that is
    well above the lowest around are crop without gaps; they take the value of the nearest that show ground.
    All 0
    where no patch shows any. shape: shape of the lattice
    """
    ny, nx = shape
    r, c = np.divmod(samples.key, samples.width)
    patch = (r // node_cells) * nx + c // node_cells
    order = np.lexsort((samples.height, patch))
    patch, height = patch[order], samples.height[order] * 1e-3
    flat = np.full(ny * nx, np.nan)
    if len(patch):
        first = np.flatnonzero(np.diff(patch, prepend=-1))
        count = np.diff(first, append=len(patch))
        enough = count >= params.fewest
        flat[patch[first[enough]]] = height[first[enough] + (params.low_share * count[enough]).astype(int)]
    low = flat.reshape(ny, nx)
    with np.errstate(invalid="ignore"):
        low[low > _windows(low, params.nearby, np.nanmin) + params.plant_m] = np.nan
    if np.isnan(low).all():
        return np.zeros(shape)
    smooth = around(grown(low))
    nodes = np.pad(smooth, ((1, 0), (1, 0)), mode="edge")  # patch middles to nodes
    return np.asarray(0.25 * (nodes[:-1, :-1] + nodes[1:, :-1] + nodes[:-1, 1:] + nodes[1:, 1:]))


def grown(field: F64) -> F64:
    """Fill each unknown node outwards from the known ones, with the mean of those beside it."""
    padded = np.pad(field, 1, constant_values=np.nan)
    flat, inside = padded.ravel(), np.pad(np.ones(field.shape, bool), 1).ravel()
    beside = (np.array([[-1], [0], [1]]) * padded.shape[1] + [-1, 0, 1]).ravel()
    known = np.flatnonzero(~np.isnan(flat))
    while len(known):
        near = np.unique(known[:, None] + beside)
        near = near[inside[near] & np.isnan(flat[near])]
        flat[near] = np.nanmean(flat[near[:, None] + beside], axis=1)
        known = near
    return padded[1:-1, 1:-1]


def around(field: F64) -> F64:
    """Mean of the 3 x 3 nodes around each, nan left out."""
    return _windows(field, 1, np.nanmean)


def _windows(field: F64, reach: int, combine: Callable[..., Any]) -> F64:
    """What `combine` gives for the nodes within `reach` on all sides of each, nan where none is known."""
    padded = np.pad(field, reach, constant_values=np.nan)
    windows = np.lib.stride_tricks.sliding_window_view(padded, (2 * reach + 1, 2 * reach + 1))
    found = np.empty(field.shape)
    rows = max(1, AT_ONCE // windows[0].size)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # of windows without any number
        for j in range(0, len(field), rows):
            found[j : j + rows] = combine(windows[j : j + rows], axis=(2, 3))
    return found
