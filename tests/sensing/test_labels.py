"""What echoes are of: what rays shot at the truth find there."""

from itertools import product

import numpy as np
import pytest

from swath.rays.engine import RayCaster
from swath.runtime.assembly import assemble
from swath.runtime.loop import ticks
from swath.scenario.scenario import load_scenario
from swath.sensing.labels import OF_ORGAN, Label, of_echoes
from tests.sensing.replay_rig import hand_grid

BOX = np.array([[6.0, 6.2, 0.4], [6.5, 7.2, 2.0]])  # of the own machine, in view of its scanner [m]
BEFORE, NEAR = 0.01, 0.002  # rays start so far before an echo, and find what is so near to it [m]
MOVED, LEANS = 0.02, 0.5  # how far a body is off at most, and crop hangs over the edge [m]


def body_file(folder):
    """The box as a mesh."""
    corners = np.array(list(product(*BOX.T)))
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    lines = [f"v {x} {y} {z}" for x, y, z in corners]
    lines += [f"f {' '.join(str(k + 1) for k in quad)}" for quad in quads]
    (folder / "body.obj").write_text("\n".join(lines))
    return folder / "body.obj"


def drawn(seed, folder):
    """Changes of the scenario `straight`: crop, slope, lean, stubble, dust, weeds, a thing, its own body."""
    r = np.random.default_rng(seed)
    crop = ("wheat", "barley", "rye")[seed % 3]
    stand = f"crop: {crop}, stems_per_m2: {r.integers(250, 450)}, lean_deg: {r.uniform(0, 18):.1f}"
    things = f"{{kind: vehicle, x_m: {r.uniform(-6, -3):.2f}, y_m: {r.uniform(9, 10):.2f}}}"
    return (
        f"seed={seed + 1}",
        f"field.terrain.slope_percent={r.uniform(0, 4):.2f}",
        f"field.stand={{level: uniform, {stand}}}",
        f"field.edge={{shape: straight, stubble_height_m: {r.uniform(0.08, 0.25):.2f}}}",
        f"field.obstacles=[{things}]",
        f"combine.body={{file: {body_file(folder)}}}",
        f"combine.lidar.weather.near_returns={r.uniform(0.02, 0.2):.3f}",
        "combine.lidar.weather.near_reach_m=3",
        "combine.motion.start_speed_kmh=7",
        "run.max_duration_s=1.2",
    )


def scans(sets, every=5):
    """World, pose of the machine, echoes, where each began, labels: of every n-th scan of a drive."""
    world = assemble(load_scenario("straight", sets=list(sets)))
    lidar, count = world.leader.parts["lidar"], 0
    for t in ticks(world):
        scan = world.graph.latest("combine.lidar", "scan")
        if t == 0 or scan.t != t:
            continue
        count += 1
        if count % every == 0:
            truth, labels = world.graph.latest("combine.lidar", "truth"), lidar.labels()
            heard = np.isfinite(scan.ranges)
            begin = np.broadcast_to(truth.sensor_position[:, None], truth.points.shape)
            pose = world.graph.latest("combine.motion", "state").pose
            yield world, pose, truth.points[heard], begin[heard], labels[heard]
    world.close()


def is_in_box(pose, points):
    own = pose.inverse().apply(points)
    return ((own > BOX[0] - MOVED) & (own < BOX[1] + MOVED)).all(axis=1)


def check_plants(seed, rays, echo, tmp_path):
    """Labels of level `plants` are what rays at the truth meet."""
    sets = (f"combine.lidar.sub_rays={rays}", f"combine.lidar.echo={echo}", *drawn(seed, tmp_path))
    right, met = [], []
    for world, pose, points, begin, labels in scans(sets):
        lidar = world.leader.parts["lidar"]
        way = points - begin
        way /= np.linalg.norm(way, axis=1)[:, None]
        options = {"range_max": BEFORE + NEAR, "solids": lidar.setup.solids(), "t": world.graph.t}
        hits = RayCaster(world.field).cast(points - BEFORE * way, way, **options)
        is_there = np.abs(hits.distance - BEFORE) < NEAR
        truth = np.where(is_there, OF_ORGAN[hits.organ], Label.DUST)
        truth[(truth == Label.OBSTACLE) & is_in_box(pose, points)] = Label.OWN_MACHINE
        right.append(truth == labels)
        met.append(labels)
    assert np.concatenate(right).mean() > 0.999
    wanted = {Label.CROP, Label.STUBBLE, Label.GROUND, Label.OBSTACLE, Label.OWN_MACHINE, Label.DUST}
    assert wanted <= set(np.concatenate(met).tolist())


def check_tables(seed, level, tmp_path):
    """Labels of levels with a table fit what stands where they say that echoes come from."""
    plain = ("field.obstacles", "combine.body", "combine.lidar.weather")
    sets = [s for s in drawn(seed, tmp_path) if level == "empirical" or not s.startswith(plain)]
    scanner = f"combine.lidar={{level: {level}, sector_deg: [-60, 60], rate_hz: 25}}"
    right, met = [], []
    for world, pose, points, begin, labels in scans([scanner, *sets]):
        x, y, z = points.T
        stands = np.array([world.field.standing(x + a, y) for a in (-LEANS, 0.0, LEANS)])
        way = points - begin
        far = np.linalg.norm(way, axis=1)
        options = {"range_max": 40.0, "solids": world.leader.parts["lidar"].setup.solids(), "normals": False}
        hard = RayCaster(world.field).cast_solids(begin, way / far[:, None], **options)
        is_hard, above = np.abs(hard.distance - far) < MOVED, z - world.field.ground_height(x, y)
        may = {
            Label.CROP: stands.any(axis=0) & ~is_hard,
            Label.STUBBLE: ~stands[1] & ~is_hard,
            Label.GROUND: (np.abs(above) < 0.25) & ~is_hard,
            Label.OBSTACLE: is_hard & ~is_in_box(pose, points),
            Label.OWN_MACHINE: is_hard & is_in_box(pose, points),
            Label.DUST: ~is_hard,
        }
        right.append(np.select([labels == label for label in may], list(may.values()), False))
        met.append(labels)
    assert np.concatenate(right).mean() > 0.999
    wanted = {Label.CROP, Label.STUBBLE, Label.GROUND}
    if level == "empirical":
        wanted |= {Label.OBSTACLE, Label.OWN_MACHINE, Label.DUST}
    assert wanted <= set(np.concatenate(met).tolist())


@pytest.mark.parametrize(("seed", "rays", "echo"), [(0, 1, "nearest"), (1, 7, "percentile"), (2, 7, "all")])
def test_labels_of_plants_are_what_rays_at_the_truth_meet(seed, rays, echo, tmp_path):
    check_plants(seed, rays, echo, tmp_path)


@pytest.mark.parametrize("level", ["empirical", "profile"])
def test_labels_of_table_levels_are_of_what_stands_there(level, tmp_path):
    check_tables(0, level, tmp_path)


@pytest.mark.draws
@pytest.mark.parametrize("seed", range(3, 9))
def test_labels_are_true_in_drawn_scenes(seed, tmp_path):
    for rays, echo in ((1, "nearest"), (19, "percentile"), (7, "all"), (7, "leading_edge")):
        check_plants(seed, rays, echo, tmp_path)
    for level in ("empirical", "profile"):
        check_tables(seed, level, tmp_path)


def test_an_echo_between_things_is_of_what_has_most_of_it_or_nobody_knows():
    of_rays = np.array([[Label.CROP, Label.CROP, Label.GROUND], [Label.CROP, Label.GROUND, Label.DUST]])
    share = np.array([[[0.3, 0.4, 0.3], [0.0, 0.0, 1.0]], [[0.5, 0.5, 0.0], [0.0, 0.0, 0.0]]])
    found = of_echoes(of_rays.astype(np.uint8), share)
    assert found.tolist() == [[Label.CROP, Label.GROUND], [Label.UNKNOWN, Label.NONE]]


def test_measured_heights_have_no_names(tmp_path):
    hand_grid(tiles=(24, 24), origin=(-20.0, -20.0, 0.0)).save(tmp_path / "map.npz")
    sets = (
        "run.max_duration_s=1",
        f"combine.lidar={{level: replay, file: {tmp_path / 'map.npz'}}}",
        "field.terrain=plane",
    )
    met = [labels for *_, labels in scans(sets, every=20)]
    assert set(np.concatenate(met).tolist()) == {Label.UNKNOWN}
