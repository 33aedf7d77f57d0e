"""`swath height-map build` from real bags of ROS 1 and 2, with poses and with positions of a receiver."""

import numpy as np
import pytest

from swath.commands.main import main
from swath.core.errors import InputError
from swath.rays.height_grid import load_height_grid
from swath.tools.height_map.build import Settings, build_height_map, open_source
from swath.tools.height_map.source import Wanted
from tests.bags import KINDS, MOUNT, PLANE, START, write_bag
from tests.rays.height_rays import surface


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bags")
    return {k: write_bag(folder / ("drive.bag" if k == "rosbag1" else k), k) for k in KINDS}


def check(grid):
    """The wall at y = -1.3, 0.8 m high, on both sides of where the scanner looked."""
    x = np.linspace(10.0, 18.0, 33)
    assert np.allclose(surface(grid, x, np.full(33, -1.6), 0.5), 0.8, atol=0.03)
    assert np.allclose(surface(grid, x, np.full(33, -0.6), 0.5), 0.0, atol=0.03)
    assert np.allclose(grid.ground_height(x, 0 * x - 1.0), 0.0, atol=0.01)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("topic", ["/scan", "/points"])
def test_heights_from_a_bag(bags, kind, topic):
    source = open_source(bags[kind], Wanted(scans=topic, poses="/odom"))
    np.testing.assert_allclose(source.mounting.position, MOUNT.position)
    grid = build_height_map(source, Settings(reach_m=6.0))
    assert grid.about["scans"] == 251
    assert grid.about["notes"] == {}
    check(grid)


@pytest.mark.parametrize("kind", KINDS)
def test_heights_along_positions(bags, kind):
    wanted = Wanted(scans="/scan", poses="/gps/fix", to_local=PLANE, antenna=(-1.2, 0.0, 3.9))
    source = open_source(bags[kind], wanted)
    np.testing.assert_allclose(source.track.position[0], [*START, 0.0], atol=1e-4)
    assert source.track.length == pytest.approx(20.0, abs=0.01)
    check(build_height_map(source, Settings(reach_m=6.0)))


def test_on_the_command_line(bags, tmp_path, capsys):
    origin = f"--origin={PLANE.lat},{PLANE.lon},{PLANE.height}"
    args = ["--scans", "/scan", "--poses", "/gps/fix", origin, "--antenna=-1.2,0,3.9", "--reach-m", "6"]
    out = tmp_path / "h.npz"
    assert main(["height-map", "build", str(bags["rosbag1"]), "--out", str(out), *args]) == 0
    check(load_height_grid(out))
    capsys.readouterr()
    for more, text in (
        (["--origin", "1"], "--origin = 1: expected three numbers lat,lon[,height]"),
        (["--antenna", "1,2"], "--antenna = 1,2: expected three numbers x,y,z"),
        ([origin, "--field", str(tmp_path)], "expected --field or --origin, not both"),
        (["--field", str(tmp_path)], "field.yaml"),
    ):
        args = ["--scans", "/scan", "--poses", "/gps/fix", *more]
        assert main(["height-map", "build", str(bags["mcap"]), "--out", str(out), *args]) == 2
        assert text in capsys.readouterr().err


def test_a_receiver_that_stands_or_has_no_fix(tmp_path):
    from tests.bags import Bag, ranges_at

    for name, places, status, text in (
        ("stands", [(0.0, 0.0, 0.0)] * 9, 0, "expected a machine that moves"),
        ("blind", [(0.1 * k, 0.0, 0.0) for k in range(9)], -1, "at least two positions"),
    ):
        bag = Bag(tmp_path / name, "sqlite")
        bag.write("/tf_static", 0.0, bag.mounting())
        for k, place in enumerate(places):
            bag.write("/fix", 0.1 * k, bag.fix(0.1 * k, place, status=status))
            bag.write("/scan", 0.1 * k, bag.laser(0.1 * k, ranges_at(*START)))
        bag.close()
        with pytest.raises(InputError, match=text):
            open_source(tmp_path / name, Wanted())
