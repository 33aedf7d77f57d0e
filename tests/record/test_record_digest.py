"""The digest: sensitive to every field and to order, blind to everything else, resumable."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from swath.core.frames import Pose
from swath.record.digest import Digest
from swath.signals import CropEdge, MachineState, Scan, Signal
from tests.fake_run import ArcEdge, GridField, drive

EDGE = CropEdge(5, 1.0, 0.1, 0.0, 8.0, 0.5, 0.8, 0.1)
STATE = MachineState(5, Pose.identity(), 2.0, 0.0, 0.0, 0.0, 1.0)


def scan(**changes):
    a = np.linspace(-1, 1, 5)
    ranges = np.array([[1.0], [np.nan], [3.0], [4.0], [5.0]], dtype=np.float32)
    return replace(Scan(7, a, a, 0 * a, ranges, ranges), **changes)


def digest_of(*samples):
    digest = Digest()
    for slot, t, outputs in samples:
        digest(slot, t, outputs)
    return digest.hex


BASE = [
    ("combine.edge", 5, {"edge": EDGE}),
    ("combine.motion", 5, {"state": STATE}),
    ("combine.lidar", 7, {"scan": scan()}),
]


def test_the_same_samples_give_the_same_digest():
    assert digest_of(*BASE) == digest_of(*BASE)
    assert len(digest_of(*BASE)) == 64


@pytest.mark.parametrize(
    "changed",
    [
        [*BASE[1:], BASE[0]],
        BASE[:2],
        [("cart.edge", 5, {"edge": EDGE}), *BASE[1:]],
        [("combine.edge", 6, {"edge": EDGE}), *BASE[1:]],
        [("combine.edge", 5, {"other": EDGE}), *BASE[1:]],
        [("combine.edge", 5, {"edge": replace(EDGE, offset=np.nextafter(1.0, 2.0))}), *BASE[1:]],
        [
            BASE[0],
            ("combine.motion", 5, {"state": replace(STATE, pose=Pose.from_euler([0, 0, 0], yaw=1e-12))}),
            BASE[2],
        ],
        [*BASE[:2], ("combine.lidar", 7, {"scan": scan(ranges=scan().ranges.astype(np.float64))})],
        [*BASE[:2], ("combine.lidar", 7, {"scan": scan(ranges=scan().ranges.reshape(1, 5))})],
    ],
)
def test_any_change_changes_the_digest(changed):
    assert digest_of(*changed) != digest_of(*BASE)


def test_nans_are_one_value_and_memory_layout_does_not_count():
    odd = np.array([[1.0], [np.nan], [3.0], [4.0], [5.0]], dtype=np.float32)
    odd.view(np.uint32)[1] = 0xFFC12345
    wide = np.asfortranarray(np.repeat(odd, 2, axis=1))[:, :1]
    swapped = odd.astype(">f4")
    for ranges in (odd, wide, swapped):
        assert digest_of(*BASE[:2], ("combine.lidar", 7, {"scan": scan(ranges=ranges)})) == digest_of(*BASE)
    assert np.isnan(odd[1, 0])


def test_nans_are_one_value_in_arrays_that_are_looked_at_as_a_whole():
    a = np.linspace(-1, 1, 300)
    ranges = np.stack([a, a], axis=1)
    ranges[7, 1] = ranges[299, 0] = np.nan
    odd = ranges.copy()
    odd.view(np.uint64)[7, 1] = 0xFFF8000000012345
    given = ranges, odd, odd.astype(">f8"), np.asfortranarray(odd), np.repeat(odd, 2, axis=0)[::2]
    found = {digest_of(("combine.lidar", 7, {"scan": Scan(7, a, a, 0 * a, r, a)})) for r in given}
    assert len(found) == 1
    assert odd.view(np.uint64)[7, 1] == 0xFFF8000000012345
    other = Scan(7, a, a, 0 * a, np.where(np.isnan(ranges), 0.0, ranges), a)
    assert digest_of(("combine.lidar", 7, {"scan": other})) not in found


def test_save_in_the_middle_and_go_on():
    whole, first, second = Digest(), Digest(), Digest()
    samples = []
    drive([whole, lambda *s: samples.append(s)], GridField(ArcEdge(40.0)), seconds=1.0)
    for sample in samples[: len(samples) // 2]:
        first(*sample)
    state = first.save()
    first(*samples[0])
    second.load(state)
    for sample in samples[len(samples) // 2 :]:
        second(*sample)
    assert second.hex == whole.hex


def test_a_sample_of_a_user_may_hold_plain_things_but_not_anything():
    @dataclass(frozen=True)
    class Mine(Signal):
        text: str
        pair: tuple
        nothing: None
        count: int

    a = digest_of(("m.x", 0, {"o": Mine(0, "ab", (1, 2.0), None, 3)}))
    assert a != digest_of(("m.x", 0, {"o": Mine(0, "ab", (1, 2), None, 3)}))
    with pytest.raises(TypeError, match="object"):
        digest_of(("m.x", 0, {"o": Mine(0, object(), (), None, 3)}))
