"""Fits the spread table of the LiDAR level `empirical`, and tests it on beams it was not fitted to.

Beams that enter a crop through its side differ from those that enter through its top (`side_spread`). The
depth at which a spot is half stopped varies from beam to beam, the more the fewer and thicker the pieces of
plants it meets: their number is a Poisson number. At the top these are ears, below thin stems, so a beam
through the side wall of a stand has its echo at a depth that varies less. Its median stays where half of the
spot is stopped (ln 2 for the median of the spot).
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import product
from statistics import NormalDist
from typing import Any

import numpy as np

from swath.core.random import Stream
from swath.core.units import DEG
from swath.field.crop import Crop
from swath.rays.spread import SHARE_MIN, SideSpread, Spread, SpreadTable, quantile_nodes
from swath.signals import F64
from swath.tools.calibrate.overhang import STEP
from swath.tools.calibrate.stand_scans import LINE, VIEWS, EchoSettings, Place, Returns, SampleStands
from swath.tools.distributions import Agreement, compare

HEIGHT = (0.3, 0.45, 0.6, 0.75, 0.9)  # relative heights at which beams begin in the crop
TOP = 1.05  # from here on beams enter through the top
ABOVE = 1.2  # relative height at which the beams begin that others are compared with
SPOT = (0.02, 0.05, 0.125)  # [m]
DENSITY = (0.3, 0.6, 1.2)  # of the usual one
TELLS = ((True, True, False), (False, True, True))  # densities of which the lower, the upper quarter is used
DEPRESSION = (8.0, 20.0)  # [deg]
QUARTERS = (0.25, 0.5, 0.75)
GROUND = 0.04  # lower returns are the ground's [m]
NARROWEST, WIDEST = 0.3, 1.5  # factors are kept within


FINE, RELATIVE_MAX = 0.02, 1.6  # grid of the silhouette over relative height
VIEW = np.array(VIEWS) * DEG
CLOSEST = 0.15  # beams closer than this share of the spot see the pattern of sub-rays, not the crop
FARTHEST = 0.2  # beams farther apart are not used to fit the correlation [m]
NORMAL = NormalDist()
Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Design:
    """The places that a grid is measured at: every combination of its nodes.

    Nodes lie close enough that straight lines between them miss a distribution by 2 mm on average
    (Wasserstein-1, wheat), the closer the thinner the crop: there a few stems more hide the soil.

    density: density of the stand relative to the sheet's
    height: height of the crop, or of its stubble, relative to the sheet's
    depression_deg: depression of the beam
    spot_mm: diameter of the spot
    lines: scan lines of 24 beams per place
    held_out: number of test places drawn anywhere within the range
    tile_count: independent pieces of 1 m2 of every stand
    """

    density: tuple[float, ...] = (0.12, 0.15, 0.18, 0.22, 0.27, 0.33, 0.4, 0.58, 0.84, 1.26, 2.0)
    height: tuple[float, ...] = (0.6, 1.0, 1.4)
    depression_deg: tuple[float, ...] = (3, 5, 7.5, 10.5, 14, 19, 25, 33, 42, 51, 60, 68, 76, 82)
    spot_mm: tuple[float, ...] = (10.0, 20.0, 40.0, 70.0, 120.0, 200.0)
    lines: int = 80
    held_out: int = 32
    tile_count: int = 48

    @property
    def beam_count(self) -> int:
        """Beams of the fit."""
        cells = len(self.density) * len(self.height) * len(self.depression_deg) * len(self.spot_mm)
        return cells * self.lines * LINE


@dataclass(frozen=True)
class Designs:
    """Designs of both grids of a table. Heights over stubble depend little on the spot."""

    standing: Design = Design()
    stubble: Design = Design(
        (0.12, 0.2, 0.33, 0.55, 0.9, 1.5),
        (0.4, 1.0, 1.8),
        spot_mm=(10.0, 30.0, 90.0, 200.0),
        lines=24,
        held_out=8,
        tile_count=16,
    )

    def with_lines(self, lines: int) -> "Designs":
        """Both designs with so many lines per place."""
        return Designs(replace(self.standing, lines=lines), replace(self.stubble, lines=lines))


_SMALL = Design((0.3, 1.0), (0.8, 1.2), (9.0, 20.0, 45.0), (30.0, 110.0), lines=12, held_out=6, tile_count=8)
SMALL = Designs(_SMALL, replace(_SMALL, height=(0.5, 1.5), held_out=2))
# for scanners with a narrow beam over a crop as it is usually sown: less than half the size of the full one
NARROW = Designs(
    Design(
        (0.12, 0.15, 0.19, 0.24, 0.3, 0.36, 0.42, 0.6, 0.85, 1.2, 1.7),
        (0.7, 1.0, 1.3),
        spot_mm=(10.0, 22.0, 45.0, 90.0),
    ),
    replace(Designs().stubble, spot_mm=(10.0, 30.0, 90.0)),
)


@dataclass(frozen=True)
class HeldOut:
    """A place that the table was not fitted to, and how the table agrees with what was seen there.

    is_cut: whether the place was stubble
    """

    place: Place
    agreement: Agreement
    is_cut: bool = False


@dataclass(frozen=True)
class _Scans:
    """What was measured at a grid of places."""

    grid: Spread
    places: list[Place]
    seen: list[Returns]


@dataclass(frozen=True)
class Fitting:
    """What a table is fitted by: stands, designs and an echo rule.

    silhouette [m2]: of a plant of standing crop, see `SpreadTable`, in steps of FINE
    """

    stands: SampleStands
    designs: Designs
    echo: EchoSettings
    stream: Stream
    silhouette: F64
    progress: Progress | None = None

    @staticmethod
    def of(stands: SampleStands, designs: Designs, echo: EchoSettings, stream: Stream,
           progress: Progress | None) -> "Fitting":  # fmt: skip
        """One by the silhouette of stands."""
        silhouette = stands.silhouette(stream, relative_max=RELATIVE_MAX, fine=FINE)
        return Fitting(stands, designs, echo, stream, silhouette, progress)

    def table(self, standing: Spread, **typical: Any) -> SpreadTable:
        """The table of a grid of standing crop; stubble, sides and overhang are those of the level `plants`.

        Stubble is of crop as high as its sheet says.
        """
        design, own = self.designs.stubble, self.stream.child("stubble")
        cut = SampleStands(self.stands.crop, own.child("fit"), tile_count=design.tile_count, is_cut=True)
        return SpreadTable(
            standing,
            replace(self, stands=cut, stream=own).scans(design).grid,
            side=self.side_spread(self.stream.child("side")),
            silhouette=self.silhouette,
            view=VIEW,
            fine=FINE,
            aside=self.stands.overhang(self.stream.child("overhang")),
            aside_step=STEP,
            **typical,
        )

    def scans(self, design: Design) -> _Scans:
        """What the stands show at the places of a design."""
        stand, is_cut = self.stands.crop.stand, self.stands.is_cut
        height = np.array(design.height) * (stand.stubble_height if is_cut else stand.height)
        axes = (
            np.array(design.density) * stand.density,
            np.round(height, 2) if is_cut else height,  # stubble is cut to the centimetre
            np.array(design.depression_deg) * DEG,
            np.array(design.spot_mm) * 1e-3,
        )
        places = [Place(*(float(v) for v in values)) for values in product(*axes)]
        seen: list[Returns] = []
        for k, place in enumerate(places):
            seen.append(self.stands.scan(place, design.lines, self.echo, self.stream.child(f"place{k}")))
            if self.progress is not None:
                self.progress(k + 1, len(places))
        return _Scans(self.grid(axes, places, seen), places, seen)

    def grid(self, axes: Sequence[F64], places: Sequence[Place], seen: Sequence[Returns]) -> Spread:
        """What was seen at a full grid of places."""
        shape, is_cut = tuple(len(a) for a in axes), self.stands.is_cut
        full = self.stands.crop.stand.height
        area = [_area(self.silhouette, place, place.height / full if is_cut else 0.0) for place in places]
        if not is_cut:  # of crop of another height the same stems are longer or shorter
            area = [a * place.height / full for a, place in zip(area, places, strict=True)]
        density, tall, depression, spot = axes
        cells = table_cells(places, seen, shape, area)
        return Spread(density, tall, depression, spot, is_stubble=is_cut, **cells)

    def side_spread(self, stream: Stream) -> SideSpread:
        """Factors on the spread for beams that enter a stand through its side.

        They compare the distances of the lower and the upper quarter of log depth from its median, over
        depressions and densities: of early echoes in thin stands, where these decide whether a beam gets
        through, of late ones in dense stands.
        """
        crop = self.stands.crop.stand
        begins = (*HEIGHT, ABOVE)
        above = np.zeros((2, len(begins), len(SPOT)))
        inside = np.zeros_like(above)
        median: list[list[float]] = [[] for _ in SPOT]
        for part, tells in zip(DENSITY, zip(*TELLS, strict=True), strict=True):
            for degrees in DEPRESSION:
                for m, spot in enumerate(SPOT):
                    place = Place(part * crop.density, crop.height, degrees * DEG, spot)
                    child = stream.child(f"{part:g} {degrees:g} {spot:g}")
                    quarters = np.array([self._quarters(place, z, child) for z in begins])
                    step = np.diff(quarters, axis=1).T
                    known = np.isfinite(step) & np.isfinite(step[:, -1:]) & np.array(tells)[:, None]
                    above[:, :, m] += np.where(known, step[:, -1:], 0.0)
                    inside[:, :, m] += np.where(known, step, 0.0)
                    median[m] += [float(quarters[-1, 1])] if np.isfinite(quarters[-1, 1]) else []
        factor = np.where(above > 0.0, inside / np.where(above > 0.0, above, 1.0), 1.0)
        middle = [float(np.exp(np.mean(found))) if found else np.log(2.0) for found in median]
        factor = np.clip(factor, NARROWEST, WIDEST)
        return SideSpread(np.array([*HEIGHT, TOP]), np.array(SPOT), factor, np.array(middle))

    def _quarters(self, place: Place, relative: float, stream: Stream) -> F64:
        """Quarters of the log depth at echoes of beams that begin at a relative height, (3,); nan: ground."""
        lines, child = self.designs.standing.lines, stream.child(f"{relative:g}")
        seen = self.stands.scan(place, lines, self.echo, child, begin=relative)
        height = seen.height[~np.isnan(seen.height)]
        if not len(height):
            return np.full(len(QUARTERS), np.nan)
        nearest = int(np.argmin(np.abs(np.log(np.tan(VIEW) / np.tan(place.depression)))))
        at = FINE * np.arange(self.silhouette.shape[1])
        area = np.interp(height / place.height, at, self.silhouette[nearest])
        depth = area - np.interp(relative, at, self.silhouette[nearest])
        depth = np.where(height < GROUND, np.inf, np.maximum(depth, 1e-6))
        found = np.quantile(depth, QUARTERS, method="lower") * place.density / np.tan(place.depression)
        return np.asarray(np.where(np.isfinite(found), np.log(found), np.nan))


def fit_plants(
    crop: Crop, designs: Designs, echo: EchoSettings, seed: int, *, progress: Progress | None = None
) -> tuple[SpreadTable, list[HeldOut]]:
    """Fit a table to the level `plants`; returns it and its agreement with other plants off the grid."""
    stream, design = Stream(seed, "calibrate"), designs.standing
    stands = SampleStands(crop, stream.child("fit"), tile_count=design.tile_count)
    fitting = Fitting.of(stands, designs, echo, stream, progress)
    standing = fitting.scans(design)
    typical = {
        "cosine": _cosine(crop, standing.seen),
        "correlation": fit_correlation(standing.places, standing.seen),
    }
    table = fitting.table(standing.grid, **typical)
    held_out = hold_out(table.standing, crop, design, echo, stream, is_cut=False)
    return table, held_out + hold_out(
        table.stubble, crop, designs.stubble, echo, stream.child("stubble"), is_cut=True
    )


def hold_out(
    grid: Spread, crop: Crop, design: Design, echo: EchoSettings, stream: Stream, *, is_cut: bool
) -> list[HeldOut]:
    """Compare a table with other stands of other plants at places off the grid."""
    count = max(design.tile_count // 2, 2)
    others, found = SampleStands(crop, stream.child("held_out"), tile_count=count, is_cut=is_cut), []
    for k, place in enumerate(_elsewhere(grid.axes, design.held_out, stream.child("places"), is_cut)):
        returns = others.scan(place, 2 * design.lines, echo, stream.child(f"other{k}"))
        found.append(HeldOut(place, compare_place(grid, place, returns, stream.child(f"judge{k}")), is_cut))
    return found


def _area(silhouette: F64, place: Place, top: float) -> float:
    """Projected area of a stem as a place sees it [m2]: all of it, or what lies below a relative height."""
    step = FINE * np.arange(silhouette.shape[1])
    upper = (
        np.zeros(len(silhouette)) if top == 0.0 else np.array([np.interp(top, step, s) for s in silhouette])
    )
    view, seen = np.log(np.tan(VIEW)), silhouette[:, 0] - upper
    return float(np.interp(np.log(np.tan(place.depression)), view, seen))


def compare_place(grid: Spread, place: Place, returns: Returns, stream: Stream) -> Agreement:
    """Heights drawn from a grid of the table against those seen."""
    real = returns.height[~np.isnan(returns.height)]
    share = stream.at().permutation((np.arange(4 * len(real)) + 0.5) / (4 * len(real)))
    return compare(grid.heights(share, place.density, place.height, place.depression, place.spot), real)


def quality(held_out: Sequence[HeldOut]) -> dict[str, dict[str, float]]:
    """Mean, 95th percentile and largest absolute of every number of agreement; the range of std_ratio."""
    found: dict[str, dict[str, float]] = {}
    for name in asdict(held_out[0].agreement):
        values = np.array([getattr(h.agreement, name) for h in held_out])
        if name in ("std_ratio", "intersection"):
            parts = {"least": values.min(), "median": np.median(values), "most": values.max()}
        else:
            size = np.abs(values)
            parts = {"mean": size.mean(), "p95": np.percentile(size, 95.0), "most": size.max()}
        found[name] = {k: round(float(v), 4) for k, v in parts.items()}
    return found


def table_cells(
    places: Sequence[Place], seen: Sequence[Returns], shape: tuple[int, ...], area: Sequence[float]
) -> dict[str, Any]:
    """quantile, ground_share and ground_lift of a full grid.

    area: projected, of a stem at each place [m2]. Where no beam saw the ground, its share is that of a thin
    ray, exp(-n A cot(depression)), or half a beam's if that is less: spots see less ground than thin rays.
    """
    nodes = quantile_nodes()
    quantile, ground, lift = [], [], []
    for place, returns, shade in zip(places, seen, area, strict=True):
        crop = returns.height[~returns.is_ground & ~np.isnan(returns.height)] / place.height
        bare = returns.height[returns.is_ground]
        count = max(len(crop) + len(bare), 1)
        thin = np.exp(-place.density * shade / np.tan(place.depression))
        share = len(bare) / count if len(bare) else min(0.5 / count, thin)
        quantile.append(np.quantile(crop, 1.0 - nodes) if len(crop) else np.zeros(len(nodes)))
        ground.append(np.clip(share, SHARE_MIN, 1.0 - 0.5 / count))
        lift.append(float(bare.mean()) if len(bare) >= 5 else 0.0)
    return {
        "quantile": np.array(quantile).reshape(*shape, len(nodes)),
        "ground_share": np.array(ground).reshape(shape),
        "ground_lift": np.array(lift).reshape(shape),
    }


def _cosine(crop: Crop, seen: Sequence[Returns]) -> float:
    """Mean |cos| of incidence on crop: what came back over the reflectance of stems."""
    albedo = np.concatenate([r.albedo[~r.is_ground & ~np.isnan(r.albedo)] for r in seen])
    return float(np.clip(albedo.mean() / crop.reflectance["stem"], 0.05, 1.0))


def fit_correlation(places: Sequence[Place], seen: Sequence[Returns]) -> tuple[float, float]:
    """(c0, c1) of exp(-gap / (c0 + c1 spot)): correlation of the normal scores of neighbouring beams.

    Least squares over all gaps of all places, weighted by the number of pairs; c0 and c1 to a millimetre and
    a hundredth.
    """
    gaps, spots, values, weights = [], [], [], []
    for place, returns in zip(places, seen, strict=True):
        score = normal_scores(returns.height)
        for gap in np.unique(returns.gap[(returns.gap >= CLOSEST * place.spot) & (returns.gap <= FARTHEST)]):
            pair = returns.gap[:, 1:] == gap
            a, b = score[:, :-1][pair], score[:, 1:][pair]
            ok = np.isfinite(a) & np.isfinite(b)
            if ok.sum() >= 20:
                gaps.append(gap)
                spots.append(place.spot)
                values.append(float(np.mean(a[ok] * b[ok])))
                weights.append(float(ok.sum()))
    if not gaps:
        return 0.02, 0.5
    gap, spot, value, weight = (np.array(v) for v in (gaps, spots, values, weights))
    best = (np.inf, 0.02, 0.5)
    for c0 in np.arange(1, 81) * 1e-3:
        for c1 in np.arange(0, 201) * 0.01:
            error = float(np.sum(weight * (np.exp(-gap / (c0 + c1 * spot)) - value) ** 2))
            best = min(best, (error, float(c0), float(c1)))
    return best[1], best[2]


def normal_scores(values: F64) -> F64:
    """Standard normal scores of the ranks of an array, ties share their mean; nan stays nan."""
    flat = values.ravel()
    ok = np.isfinite(flat)
    scores = np.full(flat.shape, np.nan)
    _, inverse, count = np.unique(flat[ok], return_inverse=True, return_counts=True)
    middle = (np.cumsum(count) - 0.5 * count) / max(int(ok.sum()), 1)
    scores[ok] = np.array([NORMAL.inv_cdf(share) for share in middle.tolist()])[inverse]
    return scores.reshape(values.shape)


def _elsewhere(axes: Sequence[F64], count: int, stream: Stream, is_cut: bool) -> list[Place]:
    """Places within the range of the axes, even in the coordinates in which the table is linear; stubble is
    cut to the centimetre.
    """
    rng = stream.at()
    places = []
    for _ in range(count):
        density, spot = (np.exp(rng.uniform(*np.log(axis[[0, -1]]))) for axis in (axes[0], axes[3]))
        tangent = np.exp(rng.uniform(*np.log(np.tan(axes[2][[0, -1]]))))
        height = rng.uniform(axes[1][0], axes[1][-1])
        height = round(height, 2) if is_cut else height
        places.append(Place(float(density), float(height), float(np.arctan(tangent)), float(spot)))
    return places
