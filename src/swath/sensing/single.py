"""A scan with one ray per beam: from the poses of the sensor to what it reports.

`aim` turns the beams and draws their random numbers, a caster of `rays/` fills the buffer, `report` makes a
scan of it. The rules are those of `scanner.py` and `echo.py`, in native code for 16 beams at once.
"""

from typing import Any

import numpy as np

from swath.core import portable
from swath.core.component import Outputs
from swath.core.random import Stream
from swath.field.site_setup import SiteSetup
from swath.kernels import filled
from swath.rays.single.buffers import BeamBuffer
from swath.sensing.echo import AirBefore, Bundle, Receiver
from swath.sensing.labels import OF_ORGAN, Label, changed, tell_own
from swath.sensing.scanner import Scanner
from swath.signals import F32, F64, U8, Mask

ANY = -1
NOTHING = -1
FREE = 1  # kind of a puff in free air: anything that is not nothing


class SingleRays:
    """The beams of a scanner in a buffer.

    judged: kind of surface whose echoes must be strong enough to be detected, ANY = all
    blind: kind that gives no echo, NOTHING = none
    by_signal: noise grows as the signal falls, where the data sheet says so
    scored: the caster wants the random numbers of the beams, noise or not
    rotations: of the sensor at each beam, (room, 3, 3)
    in_air: beams of the newest sweep that end in the air (count,), None = none
    """

    def __init__(
        self,
        scanner: Scanner,
        *,
        judged: int = ANY,
        blind: int = NOTHING,
        by_signal: bool = True,
        scored: bool = True,
    ) -> None:
        self.scanner = scanner
        self.beams = BeamBuffer(len(scanner.azimuth), lines=scanner.line_count, reach=scanner.reach)
        self.beams.apart[: self.beams.count] = scanner.step * np.cos(scanner.elevation)
        self._judged, self._blind = judged, blind
        self._is_drawn = int(scored or scanner.noise.is_on)
        sheet = scanner.sheet
        self._sigma = np.ascontiguousarray(sheet.noise, np.float32)
        rows = sheet.signal_noise if by_signal else sheet.signal_noise[:0]
        self._by_signal = np.ascontiguousarray(portable.log(rows), np.float32)
        room = len(self.beams.distance)
        self._words, self.rotations = np.zeros(3, np.uint64), np.zeros((room, 3, 3))
        self._forward = np.zeros((room, 3))
        self._ranges, self._intensity = np.zeros((room, 1), np.float32), np.zeros((room, 1), np.float32)
        self._points = np.zeros((room, 1, 3))
        self._aim: Any = None
        self._report: Any = None
        self.in_air: Mask | None = None

    def reset(self, stream: Stream) -> None:
        """Random numbers from this stream from now on; call it after the scanner's."""
        self._words[:2] = stream.key
        self._forward[: self.beams.count] = self.scanner.axes[:, :, 0]
        self._report = None  # it knows the bias of the instance

    def lie_in(
        self,
        ranges: F32,
        intensity: F32,
        points: F64,
        origins: F64,
        *,
        words: Any,
        flags: Any,
    ) -> None:
        """From now on in this memory: (room, 1), (room, 1), (room, 1, 3), (room, 3), (3,), (1,)."""
        self._ranges, self._intensity, self._points, self._words = ranges, intensity, points, words
        self.beams.lie_in(origins, flags)

    def aims_as(self, first: "SingleRays") -> None:
        """Keep the beams in the memory of another scanner's where both are the same, and stay so."""
        if self.scanner.noise.angle == 0.0 and np.array_equal(self._forward, first._forward):
            self._forward = first._forward

    def aim(self, t: int, origins: F64, rotations: F64) -> None:
        """Fill origins, directions and random numbers of the sweep that ends at t [ns].

        origins: (beam_count, 3), rotations: (beam_count, 3, 3) of the sensor in the world
        """
        self.place(t, origins, rotations)
        if self._aim is None:
            self._aim = self._prepare_aim()
        if self.beams.count:
            self._aim.launch()

    def place(self, t: int, origins: F64, rotations: F64) -> None:
        """What `aim` starts from, all before its launch."""
        beams, count = self.beams, self.beams.count
        beams.origins[:count] = origins
        self.rotations[:count] = rotations
        self._words[2] = t
        self.swing(t)

    def swing(self, t: int) -> None:
        """Where beams point in the sweep that ends at t [ns], as `place` does it."""
        if self.scanner.noise.angle != 0.0:
            self._forward[: self.beams.count] = self.scanner.axes_at(t)[:, :, 0]

    def disturb(self, air: AirBefore | None) -> None:
        """What the air does to the newest sweep, None = nothing."""
        self.in_air = None
        if air is None:
            return
        beams, n = self.beams, self.beams.count
        met = (beams.kind[:n] > 0) & (beams.distance[:n] >= self.scanner.sheet.range_min)
        distance = np.where(met, beams.distance[:n], np.nan).astype(np.float64)
        albedo = (beams.cosine[:n] * beams.reflectance[:n]).astype(np.float64)
        bundle = Bundle(distance[:, None], np.ones(1), albedo[:, None])
        distance, albedo = (
            a[:, 0] for a in air.between(bundle, Receiver(least_energy=self.scanner.least_energy))
        )
        self.in_air = changed(bundle.distance[:, 0], distance)
        beams.distance[:n], beams.reflectance[:n], beams.cosine[:n] = distance, albedo, 1.0
        beams.kind[:n] = np.where(np.isnan(distance), 0, np.maximum(beams.kind[:n], FREE))

    def report(self, t: int, origins: F64) -> Outputs:
        """The outputs of the sweep that ends at t [ns] from what is in the buffer."""
        if self._report is None:
            self._report = self._prepare_report()
        if self.beams.count:
            self._report.launch()
        n = self.beams.count
        ranges: F32 = self._ranges[:n].copy()
        return self.scanner.outputs_of(
            t, ranges, self._intensity[:n].copy(), self._points[:n].copy(), origins
        )

    def labels(self, setup: SiteSetup, of_kind: U8 = OF_ORGAN) -> U8:
        """Of the newest sweep (beam_count, 1), see `sensing/labels.py`. of_kind: label of what a beam met."""
        beams, n = self.beams, self.beams.count
        found = of_kind[beams.kind[:n]]
        tell_own(found, beams.origins[:n], beams.directions[:n], beams.distance[:n], setup)
        if self.in_air is not None:
            found[self.in_air] = Label.DUST
        return found[:, None]

    def _prepare_aim(self) -> Any:
        from swath.sensing.native.kernel import aim

        return self.beams.record(aim, [self.aiming(), self.beams.struct()])

    def _prepare_report(self) -> Any:
        from swath.sensing.native.kernel import report

        return self.beams.record(report, [self.electronics(), self.beams.struct()])

    def aiming(self) -> Any:
        """`Aiming` of kernel.py."""
        from swath.sensing.native.kernel import Aiming

        sweep, flat = self.scanner.sweep, self.rotations.reshape(-1)
        held = {"words": self._words, "rotations": flat, "forward": self._forward, "is_drawn": self._is_drawn}
        return filled(Aiming, mounting=sweep.mounting, beam_t=sweep.beam_t, **held)

    def electronics(self) -> Any:
        """`Electronics` of kernel.py, after the scanner's reset."""
        from swath.sensing.native.kernel import Electronics

        sheet, noise = self.scanner.sheet, self.scanner.noise
        return filled(
            Electronics,
            range_min=sheet.range_min,
            least_energy=self.scanner.least,
            judged=self._judged,
            blind=self._blind,
            is_noisy=int(noise.is_on),
            bias=noise.bias,
            resolution=sheet.resolution,
            at_reach=sheet.signal_at_reach,
            sigma=self._sigma.ravel(),
            by_signal=self._by_signal.ravel(),
            ranges=self._ranges.ravel(),
            intensity=self._intensity.ravel(),
            points=self._points.reshape(-1, 3),
        )
