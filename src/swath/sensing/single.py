"""A scan with one ray per beam: from the poses of the sensor to what it reports.

`aim` turns the beams and draws their random numbers, a caster of `rays/` fills the desk, `report` makes a
scan of it. The rules are those of `noise.py` and `echo.py`, in native code for 16 beams at once.
"""

from typing import Any

import numpy as np

from swath.core.component import Outputs
from swath.core.random import Stream
from swath.rays.device import start_warp
from swath.rays.heights import HeightCaster
from swath.rays.single.buffers import Desk
from swath.sensing.echo import least_energy
from swath.sensing.scanner import Scanner
from swath.sensing.weather import Weather, disturb
from swath.signals import F32, F64

ANY = -1
NOTHING = -1
FREE = 1  # kind of a puff in free air: anything that is not nothing


class SingleRays:
    """The beams of a scanner on a desk.

    judged: only echoes from this kind of surface must bring enough light back; blind: a kind without echo
    by_signal: noise grows as the signal falls, where the data sheet says so
    scored: the caster wants the random numbers of the desk, noise or not
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
        self.desk = Desk(len(scanner.azimuth))
        self._judged, self._blind = judged, blind
        self._is_drawn = int(scored or scanner.noise.is_on)
        sheet = scanner.sheet
        self._sigma = np.ascontiguousarray(sheet.noise, np.float32)
        rows = sheet.signal_noise if by_signal else sheet.signal_noise[:0]
        self._by_signal = np.ascontiguousarray(np.log(rows), np.float32)
        room = len(self.desk.distance)
        self._words, self._rotations = np.zeros(3, np.uint64), np.zeros((room, 3, 3))
        self._forward = np.zeros((room, 3))
        self._ranges, self._intensity = np.zeros((room, 1), np.float32), np.zeros((room, 1), np.float32)
        self._points = np.zeros((room, 1, 3))
        self._aim: Any = None
        self._report: Any = None
        self._whole_scan: Any = None

    def reset(self, stream: Stream) -> None:
        """Random numbers from this stream from now on; call it after the scanner's."""
        self._stream = stream
        self._words[:2] = stream.key
        self._forward[: self.desk.count] = self.scanner.axes[:, :, 0]
        self._report = self._whole_scan = None  # they know the bias of the instance

    def aim(self, t: int, origins: F64, rotations: F64) -> None:
        """Fill origins, directions and random numbers of the sweep that ends at t [ns].

        origins: (beam_count, 3), rotations: (beam_count, 3, 3) of the sensor in the world
        """
        self.place(t, origins, rotations)
        if self._aim is None:
            self._aim = self._prepare_aim()
        if self.desk.count:
            self._aim.launch()

    def place(self, t: int, origins: F64, rotations: F64) -> None:
        """What `aim` starts from, all before its launch."""
        desk, count = self.desk, self.desk.count
        desk.origins[:count] = origins
        self._rotations[:count] = rotations
        self._words[2] = t
        if self.scanner.has_angle_noise:
            self._forward[:count] = self.scanner.axes_at(t)[:, :, 0]

    def scan_heights(self, caster: HeightCaster) -> None:
        """Aim, march and report in one launch, without solids; after `place` and the caster's `tell`."""
        if self._whole_scan is None:
            self._whole_scan = self._prepare_scan(caster)
        if self.desk.count:
            self._whole_scan.launch()
        caster.check(self.desk)

    def disturb(self, weather: Weather, t: int) -> None:
        """What floats in the air, of the sweep that ends at t [ns]; nothing in clear air."""
        if weather.is_clear:
            return
        desk, nearest, n = self.desk, self.scanner.sheet.range_min, self.desk.count
        met = (desk.kind[:n] > 0) & (desk.distance[:n] >= nearest)
        distance = np.where(met, desk.distance[:n], np.nan).astype(np.float64)
        albedo = (desk.cosine[:n] * desk.reflectance[:n]).astype(np.float64)
        air = self._stream.child("weather").at(t)
        distance, albedo = (
            a[:, 0] for a in disturb(weather, distance[:, None], albedo[:, None], nearest, air)
        )
        desk.distance[:n], desk.reflectance[:n], desk.cosine[:n] = distance, albedo, 1.0
        desk.kind[:n] = np.where(np.isnan(distance), 0, np.maximum(desk.kind[:n], FREE))

    def report(self, t: int, origins: F64) -> Outputs:
        """The outputs of the sweep that ends at t [ns] from what is on the desk."""
        if self._report is None:
            self._report = self._prepare_report()
        if self.desk.count:
            self._report.launch()
        return self.outputs(t, origins)

    def outputs(self, t: int, origins: F64) -> Outputs:
        """What the last launch reported."""
        n = self.desk.count
        ranges: F32 = self._ranges[:n].copy()
        return self.scanner.outputs_of(
            t, ranges, self._intensity[:n].copy(), self._points[:n].copy(), origins
        )

    def _prepare_aim(self) -> Any:
        wp = start_warp()
        from swath.sensing.native.kernel import aim

        origins, directions, normal, fault = self.desk.shared("origins", "directions", "normal", "fault")
        words, rotations, forward = self._placed()
        inputs = [words, origins, rotations, forward, self.desk.count, self._is_drawn]
        inputs += [directions, normal, fault]
        return wp.launch(aim, dim=self.desk.pack_count, inputs=inputs, device="cpu", record_cmd=True)

    def _prepare_report(self) -> Any:
        wp = start_warp()
        from swath.sensing.native.kernel import report

        desk = self.desk
        rays = desk.shared("origins", "directions", "distance", "cosine", "reflectance", "kind", "normal")
        inputs = [self._electronics(), *rays, desk.count, *self._reported()]
        return wp.launch(report, dim=desk.pack_count, inputs=inputs, device="cpu", record_cmd=True)

    def _prepare_scan(self, caster: HeightCaster) -> Any:
        wp = start_warp()
        from swath.sensing.native.replay import scan_heights

        desk = self.desk
        rays = desk.shared("origins", "directions", "normal", "distance", "kind")
        rays += desk.shared("cell", "cosine", "reflectance", "fault")
        inputs = [*self._placed(), self._is_drawn, *caster.told(), self._electronics(), *rays, desk.count]
        inputs += self._reported()
        return wp.launch(scan_heights, dim=desk.pack_count, inputs=inputs, device="cpu", record_cmd=True)

    def _placed(self) -> list[Any]:
        wp = start_warp()
        return [
            _share(self._words, wp.uint64),
            _share(self._rotations.reshape(-1), wp.float64),
            _share(self._forward, wp.vec3d),
        ]

    def _reported(self) -> list[Any]:
        wp = start_warp()
        out = [_share(a.ravel(), wp.float32) for a in (self._ranges, self._intensity)]
        return [*out, _share(self._points.reshape(-1, 3), wp.vec3d)]

    def _electronics(self) -> Any:
        wp = start_warp()
        from swath.sensing.native.kernel import Electronics

        sheet, noise, e = self.scanner.sheet, self.scanner.noise, Electronics()
        e.range_min, e.least_energy = sheet.range_min, least_energy(sheet.range_10)
        e.judged, e.blind, e.is_noisy = self._judged, self._blind, int(noise.is_on)
        e.bias, e.resolution, e.at_reach = noise.bias, sheet.resolution, sheet.signal_at_reach
        e.sigma = _share(self._sigma.ravel(), wp.float32)
        e.by_signal = _share(self._by_signal.ravel(), wp.float32)
        return e


def _share(array: Any, kind: Any) -> Any:
    """A numpy array as Warp's, the same memory."""
    return start_warp().array(array, dtype=kind, device="cpu", copy=False)
