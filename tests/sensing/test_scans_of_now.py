"""A scanner that goes on sees what one made now sees, whatever was done to the field between two scans."""

import dataclasses

import numpy as np
import pytest

from swath.core.frames import Pose
from swath.core.random import Stream
from swath.field.solid.solids import merge
from swath.kernels import start_warp
from swath.runtime.assembly import assemble
from swath.scenario.scenario import parse_scenario
from swath.sensing.lidar import empirical
from tests.sensing.test_camera import box
from tests.sensing.test_sight import KEYS, TEXT

YAW = 0.7  # of the scanner, which looks down by 25 deg


def ahead(rng, spread=1.0):
    """A place where its beams get to."""
    far, aside = rng.uniform(4.5, 7.0), rng.uniform(-0.15, 0.15)
    return spread * far * np.array([np.cos(YAW + aside), np.sin(YAW + aside)])


def square(rng, spread=1.0):
    return ahead(rng, spread) + np.array([[-3.0, -2.0], [3.0, -2.0], [3.0, 2.0], [-3.0, 2.0]])


def thing(rng):
    return box((*ahead(rng), 1.0), rng.uniform(0.8, 2.0, 3), rng.uniform(0.0, 3.0))


def tops(scene):
    """Highest things in pages, by the rule of `page_top` in kernel/scene.py, and as a scene has them."""
    pages, half = scene.field.pages, np.float32(0.5 * scene.field.library.tile_size)
    height, along, aside = np.moveaxis(pages.tile_plane, -1, 0)
    crop = np.float32(1.0 + scene.top_room) * pages.tile_top
    every = height + half * (np.abs(along) + np.abs(aside)) + np.maximum(crop, pages.tile_bump)
    return every.reshape(len(every), -1).max(axis=1), scene.refresh(start_warp()).page_top.numpy()


def set_obstacle(setup, rng):
    """The scenario's own obstacles are changed in place."""
    solids = merge(thing(rng))
    setup.bodies.set_obstacles({"0": solids})
    for field in dataclasses.fields(solids):
        setattr(setup.obstacles, field.name, getattr(solids, field.name))


def go_far(setup, rng):
    setup.field.store.limit = 1
    setup.field.ensure(*rng.uniform(300.0, 500.0, 2), 5.0)


def add_body(setup, rng):
    setup.bodies.remove("cart")
    setup.bodies.add("cart", thing(rng), Pose.identity(), is_machine=False)


def move_body(setup, rng):
    if "cart" in setup.bodies:
        setup.bodies.place("cart", Pose.from_euler((*rng.uniform(-2.0, 2.0, 2), 0.0), 0.0, 0.0, 1.0))


def restore(setup, _rng):
    setup.field.load(setup.field.save())


CHANGES = {
    "cut": lambda setup, rng: setup.field.cut(square(rng), rng.uniform(0.05, 0.3)),
    "cut much": lambda setup, rng: [setup.field.cut(square(rng, spread), 0.1) for spread in range(1, 9)],
    "straw": lambda setup, rng: setup.field.deposit_straw(square(rng), rng.uniform(10.0, 60.0)),
    "room": lambda setup, _rng: [setup.field.prepare() for _ in range(3)],
    "room for codes": lambda setup, _rng: setup.field.store._grow_cut(),
    "start": lambda setup, _rng: setup.field.reset(),
    "far": go_far,
    "restored": restore,
    "obstacle": set_obstacle,
    "body": add_body,
    "moved": move_body,
    "gone": lambda setup, _rng: setup.bodies.remove("cart"),
}


@pytest.mark.parametrize("keys", KEYS)
def test_a_scan_is_of_the_field_as_it_is_now(keys):
    rng = np.random.default_rng(3)
    setup = assemble(parse_scenario(TEXT)).leader.parts["lidar"].setup
    setup = dataclasses.replace(setup, obstacles=dataclasses.replace(setup.obstacles))

    def made():
        lidar = empirical.EmpiricalLidar(empirical.Params(**KEYS[keys]), setup)
        lidar.reset(Stream(5, "lidar"))
        return lidar

    old, at, before, seen = made(), np.zeros(2), b"", set()
    for count, name in enumerate((*CHANGES, *rng.choice(list(CHANGES), 60))):
        CHANGES[name](setup, rng)
        moves = count % 7 == 6
        if moves:
            at = rng.uniform(-1.0, 1.0, 2)
        over = *at, float(setup.field.ground_height(*at)) + 3.5
        pose = Pose.from_euler(over, 0.0, np.radians(25.0), YAW)
        place = [np.repeat(a[None], len(old.azimuth), 0) for a in (pose.position, pose.rotation)]
        first, again = (lidar.scan_from(10**9, *place) for lidar in (old, made()))
        for output, field in (("scan", "ranges"), ("scan", "intensity"), ("truth", "points")):
            arrays = (getattr(outputs[output], field) for outputs in (first, again))
            np.testing.assert_array_equal(*arrays, err_msg=f"{name}, {count}")
        np.testing.assert_array_equal(*tops(old.scene))
        if not moves and first["truth"].points.tobytes() != before:
            seen.add(name)
        before = first["truth"].points.tobytes()
    assert seen >= {"cut", "straw", "start", "obstacle", "body", "moved", "gone"}
    assert old.ray_count == (count + 1) * len(old.azimuth)
