"""The likelihood-ratio detector against a closed-form canopy with a known edge."""

import re
from dataclasses import replace
from functools import partial
from importlib.resources import files

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swath.control.edge.block_tracks import spacing_of
from swath.control.edge.canopy_classes import (
    CELL,
    CLASSES,
    DUST,
    HALF,
    HEADROOM,
    LAYER,
    LAYERS,
    LOWEST,
    PLACES,
    ROOM,
)
from swath.control.edge.likelihood_ratio import LikelihoodRatio, Params
from swath.core.frames import Pose
from swath.core.random import Stream
from swath.core.rows import row_of
from swath.signals import CropEdge, Odometry, Scan
from tests.control.block_rig import Rig
from tests.control.canopy_scans import Canopy, answers
from tests.control.closed_loop import Course, setup_of
from tests.control.edge_drive import PERIOD, SPEED, along
from tests.control.edge_rows import Reports, reports_of, see, straight
from tests.control.synthetic_edge import Scanner, Stand, mounting
from tests.control.test_edge_hostile import check, odometry, scans, stamped


def detector(side="left", usual=0.0, mounted=None, **params):
    setup = replace(setup_of(side, 0.04, mounted or mounting(side)), crop_height=usual)
    made = LikelihoodRatio(Params(slip_percent=0.0, **params), setup)
    made.reset(Stream(1, "edge"))
    return made


drive = partial(along, detector)


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_straight_edge(side):
    edges, error = drive(side=side)
    assert all(e.is_found for e in edges[75:])
    assert np.sqrt(np.mean(error[75:] ** 2)) < 0.06  # upright stems: the learned overhang begins with a guess
    assert edges[-1].confidence > 0.9
    assert edges[-1].seen_to > edges[-1].reference_x + 2.0
    assert not edges[-1].is_held


@pytest.mark.parametrize("density", [60.0, 100.0])
def test_thin_stands_are_found(density):
    edges, error = drive(stand={"density": density})
    assert all(e.is_found for e in edges[100:])
    assert np.abs(error[100:]).max() < 0.12


@pytest.mark.parametrize("radius", [15.0, -15.0])
def test_tight_bends(radius):
    edges, error = drive(Course(radius, 8.0, y=6.0), metres=26.0)
    assert all(e.is_found for e in edges[100:])
    assert np.abs(error[100:]).max() < 0.2


@pytest.mark.parametrize(("tip", "where"), [(0.15, 6.0), (0.85, 100.0), (0.85, -100.0)])
def test_no_edge_in_stubble_or_in_crop_alone(tip, where):
    far = lambda x, y: np.full_like(x, where)  # noqa: E731
    assert not any(e.is_found for e in drive(stand={"tip": tip}, inside=far, metres=8.0)[0])


def test_a_notch_is_not_followed():
    notch = lambda x, y: 6.0 - y - np.where((x > 18.0) & (x < 21.0), 1.0, 0.0)  # noqa: E731
    edges, error = drive(inside=notch, metres=22.0)
    assert all(e.is_found for e in edges[75:])
    assert np.abs(error[75:]).max() < 0.15


def test_a_gap_is_held_and_the_end_of_the_crop_is_told():
    edges, _ = drive(stand={"gaps": ((16.0, 22.0),)}, metres=24.0)
    assert all(e.is_found for e in edges[75:])
    assert min(e.confidence for e in edges[75:]) < 0.5
    edges, _ = drive(stand={"gaps": ((16.0, 99.0),)}, metres=24.0)
    assert not edges[-1].is_found
    last = max(k for k, e in enumerate(edges) if e.is_found)
    assert 14.5 < last * SPEED * 0.04 + edges[last].reference_x < 23.0


def test_the_far_wall_of_a_long_hole_is_not_the_edge():
    """2.2 m further in, within reach of the search at the start."""
    hole = lambda x, y: 6.0 - y - np.where(x > 16.0, 2.2, 0.0)  # noqa: E731
    edges, error = drive(inside=hole, metres=26.0)
    assert edges[75].is_found
    assert not edges[-1].is_found
    assert np.nanmax(np.abs(error[75:])) < 0.3


@pytest.mark.parametrize(
    ("made", "least", "most"),
    [
        ({}, 0.5, 1.0),
        ({"usual": 0.85}, 0.3, 0.7),
        ({"usual": 0.85, "height_percent": 5.0}, 0.1, 0.55),
        ({"usual": 0.85, "upright_m": 0.5, "lean_deg": 3.0}, 0.5, 1.0),
    ],
)
def test_a_stand_that_may_lean_out_is_not_sure(made, least, most):
    """As the driver says how high it stands, how sure that is, and how far it leans."""
    edges, _ = drive(stand={"tip": 0.6}, metres=10.0, **made)
    assert least < edges[-1].confidence < most


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("tilt", [0.0, -0.3, -0.42])
def test_a_header_that_cuts_less_shows_a_stand_that_leans_out(tilt, side):
    """As high as one that stands; how wide the header cuts is biased and noisy."""
    stand = {"tilt": tilt, "lean": 0.1}
    alone, off = drive(stand=stand, side=side, usual=0.85)
    edges, error = drive(stand=stand, side=side, usual=0.85, cut=(0.04, 0.1))
    worst = np.abs(error[175:]).max()
    assert worst < (0.08 if tilt == 0.0 else 0.6 * np.abs(off[175:]).max())
    assert all(abs(e) < 2.5 * edge.offset_sd for e, edge in zip(error[200:], edges[200:], strict=True))
    if tilt == 0.0:
        assert edges[-1].confidence > alone[-1].confidence
    else:
        assert not any(
            e.confidence > 0.5 and abs(o) > 0.3 for e, o in zip(edges[200:], error[200:], strict=True)
        )


@pytest.mark.parametrize("tilt", [0.23, 0.6])
def test_the_feet_of_a_stand_that_leans_in_are_found(tilt):
    """Its middle height is 10 to 25 cm further in than its feet."""
    edges, error = drive(stand={"tilt": tilt, "lean": 0.1}, metres=20.0)
    assert np.abs(error[150:]).max() < 0.11
    assert all(abs(e) < 2.5 * edge.offset_sd for e, edge in zip(error[150:], edges[150:], strict=True))


def test_what_compiled_code_reports_has_the_fields_of_the_signal_in_their_order():
    code = files("swath.control.edge").joinpath("report.cpp").read_text(encoding="utf-8")
    own = re.findall(
        r"^  (D|bool) (.*);$", code.partition("struct Edge {")[2].partition("};")[0], re.MULTILINE
    )
    told = [(name, kind) for kind, names in own for name in names.split(", ")]
    row = row_of(CropEdge, 1).memory.dtype
    kinds = {np.dtype(float): "D", np.dtype(bool): "bool"}
    assert told == [(name, kinds[row[name]]) for name in row.names]


def test_what_may_lie_aside_turns_no_track():
    """Lodged tops, 0.3 m off all along: not an edge that goes inward."""
    track = Rig().begin(0.0, 0.0, 0.0)
    for _ in range(20):
        track("advance", 0.4)
        track("accept", 0.0, 0.02**2, True)
    for lodged in range(1, 20):
        track("advance", 0.4)
        track("accept", 0.3 - track.arc["u"], lodged * 0.8**2, False)
    assert abs(track.arc["angle"]) < 0.02
    assert abs(track.arc["u"]) < 0.15


@pytest.mark.parametrize(("then", "level"), [(1.7, 0.1), (-1.7, -1.7)])
def test_puffs_are_no_ground_but_a_hollow_is(then, level):
    """Echoes far above or below the machine's ground plane, after stubble of 10 cm: beams 40 deg down."""
    canopy = Canopy(Pose(np.array([0.0, 0.0, 3.0]), np.eye(3)))
    azimuth, down = np.linspace(-1.1, -0.2, 40), np.full(40, -np.radians(40.0))
    for t, height in enumerate((0.1, 0.1, then, then)):
        far = np.full((40, 1), (3.0 - height) / np.sin(np.radians(40.0)), np.float32)
        scan = Scan(t + 1, np.zeros(40), azimuth, down, far, np.ones((40, 1), np.float32))
        canopy.take(scan)
    assert canopy.row["level"] == pytest.approx(level, abs=0.03)


@pytest.mark.parametrize(("comes_again", "height"), [(0.03, 0.83), (0.4, 2.0)])
def test_dust_is_no_tall_crop(comes_again, height):
    """More echoes at 1.9 m than from tops of the crop: puffs, of which few come again, or crop."""
    rig, sides = Rig(), np.zeros((4, CLASSES))
    low, crop, high = (round((z - LOWEST) / LAYER) for z in (0.1, 0.8, 1.9))
    sides[0, [crop, high]], sides[1, low] = (300.0, 900.0), 300.0
    sides[2, [crop, high]], sides[3, low] = (200.0, comes_again * 900.0), 200.0
    rig("begin", sides)
    assert rig("heights")[0] == pytest.approx(height, abs=0.15)


def rows_seen(rows, seed, spread=0.06, turned=0.0, **block):
    """The feet where 8 m of tops over rows [m], or anywhere, were seen.

    turned: the edge since, away from them [rad]; block: other numbers of its row
    """
    rig, rng = Rig(0.75), np.random.default_rng(seed)
    for turns in [*(20 * [0.0] if rows is not None else []), *(1 * [turned] if turned else [])]:
        tops = [row + spread * rng.standard_normal(10) for row in rows] or rng.uniform(0.0, 2.25, (3, 10))
        places = ((np.concatenate(list(tops)) + HALF) / CELL).astype(int)
        rig.block.counts[:] = 0.0
        np.add.at(rig.block.counts, (places, round((0.75 - LOWEST) / LAYER)), 1.0)
        rig("look_for_rows", 0.0, 0.4, 0.75, turns)
    (overhang, along), feet = rig("overhang", 0.75)[:2], rig.row["feet"]
    seen = {"height": 0.75, "crop": 0.8, "stopped": 1.0, "dust": 0.0, "overhang": overhang}
    seen |= {"cosine": feet["cosine"], "sine": feet["sine"], "noise": feet["noise"], "along": along}
    return see(reports_of(rows=0.75, view=3.0), straight(), **seen | block).copy()


ROWS = (0.14, 0.89, 1.64)


@pytest.mark.parametrize("seed", range(5))
def test_where_rows_stand_is_seen_by_their_period(seed):
    """The canopy begins 0.14 m out of rows 0.75 m apart: the edge is half a spacing out of the last one."""
    feet = rows_seen(ROWS, seed)
    assert feet["rows"] > 0.99
    assert feet["shift"] == pytest.approx(0.14 - 0.375, abs=0.03)
    assert 0.03 < feet["shift_sd"] < 0.05
    further = rows_seen(ROWS, seed, overhang=0.6)  # half a spacing out of the row nearest to the place
    assert further["shift"] == pytest.approx(feet["shift"] + 0.75, abs=0.01)
    assert spacing_of(0.125) == 0.0


def test_an_edge_that_turns_away_from_rows_is_not_told_by_them():
    """How sure falls to none where it leaves its row within the way that is summed."""
    clear = [rows_seen(ROWS, 3, turned=sign * turn)["rows"] for turn in (0.0, 0.05, 0.2) for sign in (1, -1)]
    assert clear[0] > 0.99
    assert 0.3 < clear[2] < 0.6
    assert clear[4] == 0.0
    assert clear[::2] == clear[1::2]


def test_tops_that_stand_anywhere_show_no_rows_and_the_edge_is_not_known():
    """Nor do rows seen from beside them, whose flanks hide their middles, show it so well."""
    seen = [rows_seen((), seed)["rows"] for seed in range(20)]
    assert np.median(seen) < 0.3
    assert rows_seen(None, 0)["shift_sd"] > 0.2
    above, beside = (rows_seen(ROWS, 1, crop=top)["shift_sd"] for top in (0.8, 2.8))
    assert beside > 1.5 * above


def test_a_puff_above_the_crop_is_worth_nothing():
    rig, rng = Rig(), np.random.default_rng(1)
    crop, stubble = np.zeros(CLASSES), np.zeros(CLASSES)
    np.add.at(crop, ((0.75 + 0.05 * rng.standard_normal(300) - LOWEST) / LAYER).astype(int), 1.0)
    np.add.at(stubble, ((0.1 + 0.05 * rng.standard_normal(300) - LOWEST) / LAYER).astype(int), 1.0)
    stubble[30:DUST] += 10.0
    stubble[DUST] += 100.0
    rig("begin", [crop, stubble, crop, stubble])
    worth = rig("ratios", 0.0, told=CLASSES)
    assert not worth[30 : DUST + 1].any()
    assert worth[int((0.75 - LOWEST) / LAYER)] > 2.0


@pytest.mark.parametrize(("height", "is_mat"), [(0.02, False), (0.05, False), (0.14, True), (0.2, True)])
def test_crop_that_lies_flat_is_no_hole(height, is_mat):
    rig, rng = Rig(), np.random.default_rng(1)

    def layers(middle):
        counts = np.zeros(CLASSES)
        np.add.at(counts, ((middle + 0.04 * rng.standard_normal(300) - LOWEST) / LAYER).astype(int), 1.0)
        return counts

    rig("begin", 2 * [layers(0.75), layers(0.0)])
    assert rig("has_mat", layers(height))[0] == is_mat
    assert not rig("has_mat", 0.01 * layers(height))[0]


def test_an_edge_is_told_from_three_blocks_on():
    edges, error = drive(metres=4.0)
    first = next(k for k, e in enumerate(edges) if e.is_found)
    assert 1.2 <= first * SPEED * 0.04 < 2.2
    assert np.abs(error[first:]).max() < 0.2


def test_told_deviations_hold():
    covered = []
    for seed in range(3):
        edges, error = drive(stand={"density": 150.0}, seed=seed, metres=16.0)
        sd = np.array([e.offset_sd for e in edges])
        covered.append(np.abs(error[60:]) < 1.96 * sd[60:])
    assert np.mean(covered) > 0.9


def test_a_machine_that_stands_learns_nothing_and_a_slow_one_sees():
    edges, _ = drive(speed=1e-9, metres=6e-9)
    assert not edges[-1].is_found
    edges, error = drive(speed=0.6, metres=9.0)
    assert abs(error[-1]) < 0.08


def test_left_and_right_are_mirror_images():
    both = [drive(side=side, metres=6.0, seed=3)[0] for side in ("left", "right")]
    assert both[0][-1].is_found
    scanner, flip = Scanner(Stand(lambda x, y: 6.0 - y), mounting("left")), slice(None, None, -1)
    a, b, rng = detector("left"), detector("right"), np.random.default_rng(5)
    for k in range(80):
        scan = scanner.scan((k + 1) * PERIOD, (0.08 * k, 0.1, 0.002 * k), rng)
        ranges, times = scan.ranges[flip], scan.beam_t[flip]
        other = replace(scan, beam_t=times, azimuth=-scan.azimuth[flip], ranges=ranges)
        x = a.step(k * PERIOD, PERIOD, {"scan": scan, "odometry": Odometry(0, 2.0, 0.05, 0.0)})["edge"]
        y = b.step(k * PERIOD, PERIOD, {"scan": other, "odometry": Odometry(0, 2.0, -0.05, 0.0)})["edge"]
        pair = [np.array([e.offset, e.heading, e.curvature]) for e in (x, y)]
        assert np.allclose(pair[0], -pair[1], atol=1e-9, equal_nan=True)


def test_a_saved_detector_goes_on_as_if_nothing_had_happened():
    scanner, rng = Scanner(Stand(lambda x, y: 6.0 - y), mounting("left")), np.random.default_rng(1)
    seen = [scanner.scan((k + 1) * PERIOD, (0.08 * k, 0.1, 0.0), rng) for k in range(90)]
    still = Odometry(0, 2.0, 0.0, 0.0)

    def run(level, start, stop):
        inputs = [{"scan": s, "odometry": still} for s in seen[start:stop]]
        return [level.step((start + k) * PERIOD, PERIOD, i)["edge"] for k, i in enumerate(inputs)]

    one, other = detector(), detector()
    run(one, 0, 60)
    state = one.save()
    straight = run(one, 60, 90)
    other.load(state)
    again = run(other, 60, 90)
    assert straight[-1].is_found
    assert again == straight


@settings(max_examples=40)
@given(st.lists(st.tuples(scans(), odometry, st.integers(-3, 60)), min_size=1, max_size=8), st.booleans())
def test_any_scans(sequence, is_warm):
    level, rng, t = detector(), np.random.default_rng(0), 0
    scanner = Scanner(Stand(lambda x, y: 6.0 - y), mounting("left"))
    for k in range(40 if is_warm else 0):
        t += PERIOD
        scan = scanner.scan(t, (0.08 * k, 0.1, 0.0), rng)
        check(level.step(t - PERIOD, PERIOD, {"scan": scan, "odometry": Odometry(t, 2.0, 0.0, 0.0)})["edge"])
    for scan, driven, ticks in sequence:
        t += PERIOD
        inputs = {"scan": stamped(scan, max(0, t - ticks * PERIOD)), "odometry": driven}
        check(level.step(t - PERIOD, PERIOD, inputs)["edge"])


def test_an_edge_grows_unsure_with_the_age_of_the_newest_scan():
    scanner, rng = Scanner(Stand(lambda x, y: 6.0 - y), mounting("left")), np.random.default_rng(1)
    level, still = detector(), Odometry(0, 2.0, 0.0, 0.0)
    for k in range(100):
        scan = scanner.scan((k + 1) * PERIOD, (0.08 * k, 0.1, 0.0), rng)
        level.step(k * PERIOD, PERIOD, {"scan": scan, "odometry": still})
    late = [
        level.step(k * PERIOD, PERIOD, {"scan": scan, "odometry": still})["edge"] for k in range(100, 112)
    ]
    sure = [edge.confidence for edge in late]
    assert sure[2] > 0.9
    assert sure[2] > sure[5] > sure[8]
    assert not late[-1].is_found


@pytest.mark.parametrize(("length", "depth"), [(1.2, 0.8), (4.0, 1.2)])
def test_an_edge_across_a_hole_is_not_sure(length, depth):
    """Behind it it is sure again in two of three: what goes on there may as well be bites."""
    begin, end, again = 16.0, 16.0 + length, 0
    hole = lambda x, y: 6.0 - y - np.where((x > begin) & (x < end), depth, 0.0)  # noqa: E731
    for seed in range(3):
        edges, error = drive(inside=hole, metres=20.0, stand={"density": 200.0}, seed=seed)
        at = [SPEED * 0.04 * (k + 1) + edge.reference_x for k, edge in enumerate(edges)]
        across = [e.confidence for e, x in zip(edges, at, strict=True) if begin < x < end]
        beyond = [e.confidence for e, x in zip(edges, at, strict=True) if x > end + 3.0]
        assert np.mean(np.array(across) >= 0.5) < 0.4
        assert np.abs(error[75:]).max() < 0.15
        again += max(beyond) > 0.7
    assert again >= 2


@pytest.mark.parametrize(("depth", "seed"), [(0.5, 1), (0.65, 2)])
def test_a_long_shallow_hole_is_held_across(depth, seed):
    """5.7 m: the edge in it is seen for metres, no farther from the line than that may drift."""
    hole = lambda x, y: 6.0 - y - np.where((x > 18.0) & (x < 23.7), depth, 0.0)  # noqa: E731
    edges, error = drive(inside=hole, metres=26.0, seed=seed)
    assert all(e.is_found for e in edges[75:])
    assert np.abs(error[75:]).max() < 0.15


@pytest.mark.parametrize(("depth", "density"), [(0.5, 120.0), (0.65, 500.0)])
def test_an_edge_that_steps_into_the_crop_is_followed_there(depth, density):
    """Longer than 7 m it is no hole: until then the line is held, not sure, and the edge is never lost."""
    inward = lambda x, y: 6.0 - y - np.where(x > 18.0, depth, 0.0)  # noqa: E731
    edges, error = drive(inside=inward, metres=28.0, stand={"density": density})
    x = np.array([2.0 * 0.04 * (k + 1) + e.reference_x for k, e in enumerate(edges)])
    off = np.minimum(np.abs(error), np.abs(error + depth))
    assert all(e.is_found and e.seen_to > e.reference_x - 0.5 for e in edges[75:])
    assert off[75:].max() < 0.15
    assert (
        np.abs(error[x > 24.0] + depth).max() < 0.06
    )  # as on a straight one: the learned overhang begins with a guess
    wrong = np.abs(error + depth * (x > 18.0)) > 0.15
    assert max(e.confidence for e, is_wrong in zip(edges[75:], wrong[75:], strict=True) if is_wrong) < 0.5
    assert edges[-1].confidence > 0.5


def test_crop_that_rises_is_seen_from_before_it():
    """From a headland its front is seen first, from the foot up: the edge begins anew until it is whole."""
    track, rng, followed = Rig(), np.random.default_rng(5), []
    for k, top in enumerate([0.2, 0.4, 0.6, 0.8, 0.8, 0.8, 0.8, 0.8]):
        for n in range(5):
            track.add(rays(rng, top), 0.1, (0.1 * (5 * k + n), 0.0, 0.0), near=240)
        followed.append(track.row["followed"])
    assert followed[:4] == [0] * 4
    assert followed[-1] >= 3
    assert track.row["height"] == pytest.approx(0.75, abs=0.1)


def test_crop_that_stands_higher_than_an_unseen_one_is_taken_to_is_no_dust():
    """Maize, or crop on a crest that the stubble ahead lies far below."""
    track, rng = Rig(), np.random.default_rng(6)
    for k in range(30):
        scan = rays(rng, 2.0, 1.45, highest=HEADROOM * track.row["height"] + ROOM)
        track.add(scan, 0.1, (0.1 * k, 0.0, 0.0), near=240)
    assert track.row["followed"] >= 3
    assert track.row["height"] == pytest.approx(1.95, abs=0.1)


def test_puffs_above_the_crop_make_no_tall_crop():
    track, rng, low = Rig(), np.random.default_rng(7), []
    for k in range(12):
        scan = rays(rng, 0.8)
        scan["height"][:20], scan["stands"][:20] = rng.uniform(1.0, 2.5, 20), False
        track.add(scan, 0.1, (0.1 * k, 0.0, 0.0), near=240)
        low.append(track.row["height"])
    assert max(low) < 0.9


def rays(rng, top, bottom=0.1, *, highest=np.inf):
    """240 rays: echoes from `bottom` to a crop's top [m] on one side, those of stubble on the other; what is
    above `highest` counts as dust
    """
    place = rng.uniform(-3.0, 3.0, 240)
    height = np.where(place > 0.0, rng.uniform(bottom, top, 240), rng.uniform(-0.02, 0.05, 240))
    layer = np.clip((height - LOWEST) / LAYER, 0, LAYERS - 1).astype(np.int64)
    layer[height > highest] = DUST
    cells = np.clip((place + HALF) / CELL, 0, PLACES - 1).astype(np.int64) * CLASSES + layer
    return answers(cells, height=height, stands=True, upper=place, lower=place)


@pytest.mark.parametrize("bias", [0.4, -0.4])
def test_a_gyroscope_that_is_off_moves_the_edge_by_little(bias):
    """A turn of 0.4 deg/s that is not driven puts an edge 9 m ahead 18 cm off."""
    scanner, rng = Scanner(Stand(lambda x, y: 6.0 - y), mounting("left")), np.random.default_rng(4)
    level, errors = detector(), []
    off = Odometry(0, SPEED, np.radians(bias), 0.0)
    for k in range(250):
        scan = scanner.scan((k + 1) * PERIOD, (0.08 * (k + 1), 0.1, 0.0), rng)
        edge = level.step(k * PERIOD, PERIOD, {"scan": scan, "odometry": off})["edge"]
        errors.append(edge.offset - 5.9)
    assert np.abs(errors[150:]).max() < 0.07


@pytest.mark.parametrize("stated", [0.1, 0.2, 0.5])
def test_a_line_is_as_sure_as_its_points_scatter_not_as_they_state(stated):
    """stated: standard deviation that the points are said to have, as a share of the one that they have."""
    rng, reports, off = np.random.default_rng(1), reports_of(), []
    ahead = float(reports.detectors["reference"][0])
    x = np.arange(0.0, 16.0, 0.4)
    for _ in range(300):
        sd, place = rng.uniform(0.05, 0.3), rng.uniform(6.0, 12.0)
        course, heading = rng.uniform(-0.1, 0.1, size=2)
        u = np.tan(course) * x + sd * rng.standard_normal(len(x))
        rows = np.column_stack([x, u, np.full(len(x), (stated * sd) ** 2), x / np.cos(course)])
        at = np.array([place - ahead, np.tan(course) * place - ahead * heading, heading])
        see(reports, rows, at, x=x[-1], u=u[-1], angle=course, distance=rows[-1, 3])
        line = reports.lines[0]
        c, s = np.cos(heading), np.sin(heading)
        there = at[:2] + np.array([[c, -s], [s, c]]) @ (line["x"], line["u"])
        beside = there @ (-np.sin(course), np.cos(course))
        off.append((beside / line["offset_sd"], (line["angle"] + heading - course) / line["angle_sd"]))
    rms = np.sqrt(np.mean(np.square(off), axis=0))
    assert (rms > 0.75).all()
    assert (rms < 1.5).all()


def test_the_edge_lies_ahead_as_long_as_all_that_was_seen_of_it_does():
    rng, reports = np.random.default_rng(1), reports_of(hold_m=0.0)
    ahead, found = float(reports.detectors["reference"][0]), []
    for _ in range(100):
        seen = np.cumsum(rng.exponential(2.0, rng.integers(2, 12)))
        points = np.column_stack([seen, np.zeros(len(seen)), np.full(len(seen), 1e-4), seen])
        place = rng.uniform(seen[0] - 5.0, seen[-1] + 5.0)
        front = {"x": seen[-1] + 10.0, "distance": seen[-1] + 10.0}
        is_found = see(reports, points, (place - ahead, 0.0, 0.0), **front)["is_found"]
        assert is_found == (seen > place).all()
        found.append(is_found)
    assert 10 < sum(found) < 90


def test_reports_of_worlds_in_step_are_those_of_each():
    """Also where one of them has no edge, or has lost it."""
    rng, each = np.random.default_rng(3), []
    for k in range(8):
        usual, spacing = float(rng.choice([0.0, 0.9])), float(rng.choice([0.0, 0.75]))
        one = reports_of(usual=usual, rows=spacing)
        made = {"crop": rng.uniform(0.5, 1.0), "height": 0.8, "stopped": rng.uniform(0.7, 1.0)}
        made |= {"noise": spacing, "cosine": rng.uniform(0.0, 3.0), "along": 1.0, "overhang": 0.05}
        made |= {"x": 16.0, "distance": 16.0, "bite": float(rng.choice([0.0, 0.3]))}
        place = rng.uniform(0.0, 12.0), rng.uniform(-3.0, 3.0), 0.1
        see(one, straight(rng.uniform(8.0, 16.0)), place, is_begun=float(k != 2), **made)
        each.append(one)
    both = Reports([one.parts[0] for one in each])
    for k, one in enumerate(each):
        both.rows[k], both.points[k] = one.rows[0], one.points[0]
        one.all_of()
    both.all_of()
    told = [one.edge() for one in each]
    assert 3 < sum(edge.is_found for edge in told) < 8
    assert repr(both.sent["edge"].each()) == repr(told)
