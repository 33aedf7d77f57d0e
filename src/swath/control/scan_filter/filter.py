"""What all levels of the scan filter share: a scan comes in, the same scan without some echoes goes out."""

from abc import ABC, abstractmethod
from dataclasses import replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.random import Stream
from swath.signals import F64, Scan
from swath.signals.setup import ControlSetup

Mask = NDArray[np.bool_]
SCAN = Port("scan", Scan, unit="m", shape=(None,))
NAN32 = np.float32("nan")


class ScanFilter(KeepsState, ABC):
    """A level gives `unwanted`.

    A beam whose first echo goes says nothing of what is behind it, which is not the same as "no echo": its
    direction is nan, which leaves it out everywhere. Of other beams the later echoes go.
    mounting: of the scanner, for who takes the filtered scan
    """

    kept: ClassVar[tuple[str, ...]] = ("_seen",)
    inputs: tuple[Port, ...] = (SCAN,)
    outputs = (SCAN,)

    def __init__(self, setup: ControlSetup) -> None:
        own = {port: pose for port, pose in setup.mountings.items() if port == "scan"}
        self.mounting = replace(setup, mountings=own).mounting
        self._seen = -1

    def reset(self, stream: Stream) -> Outputs:
        """Nothing seen."""
        self._seen = -1
        return {}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """The newest scan, once."""
        self.follow(t + dt, dt, inputs)
        scan: Scan | None = inputs["scan"]
        if scan is None or scan.t == self._seen:
            return {}
        self._seen = scan.t
        points = self.mounting.apply(scan.points().reshape(-1, 3))
        is_out = self.unwanted(points).reshape(scan.ranges.shape)
        if not is_out.any():
            return {"scan": scan}
        is_out |= is_out[:, :1]
        ranges, intensity = np.where(is_out, NAN32, scan.ranges), np.where(is_out, NAN32, scan.intensity)
        azimuth = np.where(is_out[:, 0], np.nan, scan.azimuth)
        return {"scan": replace(scan, azimuth=azimuth, ranges=ranges, intensity=intensity)}

    @abstractmethod
    def unwanted(self, points: F64) -> Mask:
        """Which echoes go. points: in the machine frame, shape (echo_count, 3) [m], nan = no echo."""

    def follow(self, now: int, dt: int, inputs: Inputs) -> None:
        """A step of dt [ns] up to now [ns] passed, with a scan or without one."""
