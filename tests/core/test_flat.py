"""Samples as flat, named numbers."""

import numpy as np
import pytest

from swath.core.errors import InputError
from swath.core.frames import Pose
from swath.signals import CropFlow, MachineState, Scan, Signal, SteerCommand
from swath.signals.flat import build, flat_fields, read

SIGNALS = [s for s in Signal.__subclasses__() if s.__module__.startswith("swath.")]


@pytest.mark.parametrize("signal", SIGNALS, ids=lambda s: s.__name__)
def test_every_sample_can_be_taken_apart_and_put_together(signal):
    """Arrays are given row by row; every named dimension is 2 long."""
    fields = flat_fields(signal)
    assert fields
    given = {}
    for i, (name, f) in enumerate(fields.items(), 1):
        length = np.prod([d if isinstance(d, int) else 2 for d in f.quantity.shape], dtype=int)
        given[name] = {"real": 0.1 * i, "int": 2, "bool": True, "array": np.arange(length) + i}[f.kind]
    sample = build(signal, 7, given)
    assert sample.t == 7
    for name, value in given.items():
        assert np.allclose(np.ravel(read(sample, name)), value, atol=1e-7), name


def test_arrays_get_the_shape_that_their_dimensions_say():
    lines = {"beam_t": [-0.1, 0.0], "azimuth": [0.0, 0.1], "elevation": [0.0, 0.0]}
    scan = build(Scan, 0, {**lines, "ranges": [1.0, 2.0, 3.0, 4.0], "intensity": [0.1] * 4})
    assert scan.ranges.tolist() == [[1.0, 2.0], [3.0, 4.0]]
    assert scan.intensity.shape == (2, 2)
    empty = build(Scan, 0, {name: [] for name in flat_fields(Scan)})
    assert empty.ranges.shape == (0, 0)
    for ranges in ([1.0, 2.0, 3.0], [1.0, 2.0]):
        with pytest.raises(InputError, match=r"expected numbers for \(beam_count, echo_count\)"):
            build(Scan, 0, {**lines, "ranges": ranges, "intensity": [0.1] * 4})


def test_a_pose_is_six_numbers():
    state = MachineState(0, Pose.from_euler((1, 2, 3), roll=0.1, pitch=-0.2, yaw=3.0), 1.0, 0, 0, 0, 0)
    got = [read(state, f"pose.{part}") for part in ("x", "y", "z", "roll", "pitch", "yaw")]
    assert np.allclose(got, [1, 2, 3, 0.1, -0.2, 3.0], atol=1e-12)
    assert flat_fields(MachineState)["pose.yaw"].unit == "rad"


def test_defaults_may_be_left_out_and_the_rest_not():
    given = dict.fromkeys(("grain", "straw", "area", "stem_count", "header_fill", "dt"), 1.0)
    assert build(CropFlow, 0, given) == CropFlow(0, 1.0, 1.0, 1.0, 1, 1.0, 1.0)
    with pytest.raises(InputError, match="expected a value for curvature"):
        build(SteerCommand, 0, {"is_engaged": True})
    with pytest.raises(InputError, match="expected one of curvature, is_engaged of SteerCommand"):
        build(SteerCommand, 0, {"is_engaged": True, "curvature": 0.0, "torque": 1.0})


def test_single_precision_arrays_stay_so():
    assert build(Scan, 0, {n: [1.0] for n in flat_fields(Scan)}).ranges.dtype == np.float32
