"""Pictures of a camera in a report: which are kept, and what is drawn of them."""

from dataclasses import dataclass

import numpy as np
import pytest

from swath.core.frames import Pose
from swath.report.report import MOST, SHOWN, KeptPicture, PictureSampler, pictures_figure
from swath.signals import OBSTACLE_KINDS, MachineState
from swath.signals.image import ImageBoxes, empty_image
from tests.fake_run import machine

pytestmark = pytest.mark.drawn

NS = 1_000_000_000
SIZE = 40, 30


@dataclass(frozen=True)
class Lens:
    width: int = SIZE[0]
    height: int = SIZE[1]
    focal: float = 30.0
    centre_x: float = 19.5
    centre_y: float = 14.5
    coefficients: tuple = ()


def boxes(t, *distances):
    n = len(distances)
    edges = (np.full(n, v) for v in (5.0, 6.0, 15.0, 26.0))
    person = np.full(n, OBSTACLE_KINDS.index("person"), np.uint8)
    return ImageBoxes(t, np.arange(1.0, n + 1), person, *edges, np.full(n, 200.0), np.array(distances))


def driven(steps, away, channels=("colour",)):
    """A metre and a picture a second; away: distance of the thing in each picture, inf = none."""
    states = []
    sampler = PictureSampler(machine(), lambda: states[-1])
    for k in range(steps):
        states.append(MachineState(k * NS, Pose.identity(), 1.0, 0.0, 0.0, 0.0, float(k)))
        image, seen = empty_image(k * NS, Lens(), channels), boxes(k * NS, *filter(np.isfinite, [away(k)]))
        for slot, outputs in (
            ("combine.motion", {"state": states[-1]}),
            ("combine.camera", {"image": image, "boxes": seen}),
            ("tractor.camera", {"image": image}),
        ):
            for looker in sampler.lookers(slot, (*map(type, outputs.values()),)):
                looker.see(slot, k * NS, outputs)
    return sampler.pick()


def test_spread_over_the_run_and_the_one_with_the_nearest_thing():
    picked = driven(200, lambda k: abs(k - 61) + 3.0)
    assert list(picked) == ["camera"]
    at = [p.distance for p in picked["camera"]]
    assert len(at) == SHOWN
    assert 61.0 in at
    assert at == sorted(at)
    assert at[0] < 20.0
    assert at[-1] == 199.0
    without = [p.distance for p in driven(200, lambda k: np.inf)["camera"]]
    assert np.diff(without).max() < 2 * 200 / MOST * 2
    assert 0.0 not in without  # black, before the first exposure


def test_a_camera_that_saw_nothing_yet_shows_nothing():
    assert driven(1, lambda k: np.inf) == {}


def test_temperatures_have_one_scale_in_degrees():
    """Grey 51 of 255 of a picture from 10 to 30 deg C is 14 deg C; the scale spans both pictures."""
    grey = np.full((*SIZE[::-1], 3), 51, np.uint8)
    both = [
        empty_image(NS, Lens(), (), colour=grey, black=273.15 + low, white=273.15 + low + 20.0)
        for low in (10.0, 15.0)
    ]
    fig = pictures_figure([KeptPicture(image, None, 3.0) for image in both])
    first, second = (ax.images[0] for ax in fig.axes[:2])
    np.testing.assert_allclose(first.get_array(), 14.0)
    np.testing.assert_allclose(second.get_array(), 19.0)
    assert first.get_clim() == second.get_clim() == pytest.approx((10.0, 35.0))
    assert fig.axes[-1].get_ylabel() == "apparent temperature [°C]"


@pytest.mark.parametrize("channel", ["colour", "depth"])
def test_boxes_lie_where_the_camera_says(channel):
    image = empty_image(NS, Lens(), (channel,))
    fig = pictures_figure([KeptPicture(image, boxes(NS, 8.25), 3.0)])
    ax = fig.axes[0]
    assert ax.images[0].get_array().shape[:2] == SIZE[::-1]
    (box,) = ax.patches
    assert box.get_bbox().extents.tolist() == [5.0, 6.0, 15.0, 26.0]
    assert ax.texts[0].get_text() == "person, 8.25 m"
    assert ax.get_title(loc="left") == "3 m, 1 s"
