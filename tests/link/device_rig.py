"""Slots served as devices without a run: drawn samples, and a device that is fed with them."""

import socket

import numpy as np

from swath.core.component import Port
from swath.link.device.output import DeviceSetup, make_device
from swath.link.device.wires import Reader
from swath.signals import Fix, Scan

STEP = 40_000_000  # ns


def plane_scan(t, rng, *, count=361, echoes=1, step_deg=0.5):
    """A drawn scan of one plane, a tenth of its beams without an echo."""
    azimuth = np.radians(step_deg) * (np.arange(count) - count // 2)
    ranges = rng.uniform(0.5, 60.0, (count, echoes)).astype(np.float32)
    ranges[rng.uniform(size=(count, echoes)) < 0.1] = np.nan
    ranges = np.sort(ranges, axis=1)
    intensity = np.where(np.isnan(ranges), np.nan, rng.uniform(0.0, 2.0, ranges.shape)).astype(np.float32)
    beam_t = (azimuth - azimuth[-1]) / (2 * np.pi) * STEP * 1e-9
    return Scan(t, beam_t, azimuth, np.zeros(count), ranges, intensity)


def drawn_fix(t, rng, **fields):
    """A drawn fix at N 52, E 10."""
    values = {
        "x": 0.0, "y": 0.0, "z": 0.0, "speed": rng.uniform(0, 5), "course": rng.uniform(-3, 3),
        "horizontal_sd": 0.012, "vertical_sd": 0.02, "speed_sd": 0.02, "quality": 4,
        "longitude": np.radians(10.0 + rng.uniform(-0.01, 0.01)),
        "latitude": np.radians(52.0 + rng.uniform(-0.01, 0.01)), "height": rng.uniform(50, 150),
        "age": 1.0, "satellites": 14, "hdop": 0.7,
    }  # fmt: skip
    return Fix(t, **{**values, **fields})


def device(address, signal, *, origin=None, range_max=40.0, period=0.04, factor=1.0, identity=""):
    """An open device for samples of a type."""
    setup = DeviceSetup("combine.slot", (Port("out", signal),), period, range_max, origin, factor, identity)
    made = make_device(address, setup)
    made.open()
    return made


def heard_by(monkeypatch):
    """Pieces that come in from now on over wires of levels, as they come."""
    pieces, came = [], Reader._came

    def note(reader, data, sender=None):
        came(reader, data, sender)
        pieces.append(data)

    monkeypatch.setattr(Reader, "_came", note)
    return pieces


def free_port(kind=socket.SOCK_STREAM):
    """A port that nobody has."""
    with socket.socket(type=kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]
