"""Camera level `error`: a camera by its data sheet: lens, shutter, blur, exposure and EMVA 1288 noise.

Light becomes photons: a surface across the sun that sends the share c of its light has the radiance c E / pi,
its image the irradiance c E tau cos(a)^falloff / (4 N^2) (lens of f-number N, transmission tau; Hecht,
Optics, 5.7), a from the axis. E is the sunlight in a band of 100 nm of each colour, in twilight that of the
sky (`shading.Daylight`). The picture is linear up to saturation, white-balanced for a sun at 45 deg, then
sRGB.

Each row is exposed for the exposure time that ends at its readout, the last row at the time of the sample;
the samples of a pixel are spread over the exposure, so that what moves is blurred in as many steps.

An image sensor by the linear model of EMVA Standard 1288, Release 4.0 Linear.

    photons that hit a pixel in the exposure:  mu_p = A t E lambda / (h c)                  (eq. 3)
    electrons:  mu_e = eta mu_p + mu_I t, Poisson, at most the full well                    (eq. 5, 14)
    digital number:  y = K (mu_e + N(0, sigma_d)) + black level, rounded and clipped        (eq. 8, 10)

Of each pixel the efficiency is off by a share (PRNU) and the dark signal by some electrons (DSNU), both
normal and drawn once; a gain multiplies K.

Colour filters: rows red green, green blue. The two colours that a pixel has not measured are means of its
neighbours that have (bilinear interpolation); at the border of those that are there.
"""

from dataclasses import dataclass
from math import log2
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from annotated_types import Ge, Gt, Le
from numpy.typing import NDArray

from swath.core.component import Outputs
from swath.core.errors import InputError
from swath.core.frames import Pose
from swath.core.lens import Lens
from swath.core.portable import power, product
from swath.core.random import Stream
from swath.core.registry import OWN_LAW, Checked, Level
from swath.core.schedule import NS
from swath.core.units import PERCENT
from swath.field.site_setup import SiteSetup
from swath.sensing import BRIGHTEST, CAMERA
from swath.sensing.camera.camera_sheet import CameraSheet, load_camera
from swath.sensing.camera.pinhole import Pinhole
from swath.sensing.camera.rays import Channel, SceneCamera, SceneParams, Sight, diffraction_mtf
from swath.sensing.camera.shading import FULL, WAVELENGTHS, encode
from swath.sensing.mount import poses_at
from swath.signals import F64, MachineState


def filters(height: int, width: int) -> NDArray[np.int64]:
    """Colour of each pixel, 0 red, 1 green, 2 blue, (height, width)."""
    rows, columns = np.indices((height, width)) % 2
    return rows + columns


def filtered(light: F64) -> F64:
    """What each pixel's filter lets through of light (height, width, 3), (height, width)."""
    colour = filters(*light.shape[:2])
    return np.take_along_axis(light, colour[..., None], axis=2)[..., 0]


def interpolated(values: F64) -> F64:
    """A picture (height, width, 3) of what pixels behind filters measured, (height, width)."""
    colour = filters(*values.shape)
    found = []
    for k in range(3):
        own = colour == k
        total, weight = _around(np.where(own, values, 0.0)), _around(own.astype(np.float64))
        found.append(np.where(own, values, total / weight))
    return np.stack(found, axis=-1)


def _around(values: F64) -> F64:
    """Sum of the eight neighbours, those at the sides twice, with 0 beyond the border."""
    wide = np.pad(values, 1)
    rows = wide[:-2] + 2.0 * wide[1:-1] + wide[2:]
    return np.asarray(rows[:, :-2] + 2.0 * rows[:, 1:-1] + rows[:, 2:])


BAND = 100.0  # width of a band of colour [nm]
PLANCK, LIGHT_SPEED = 6.62607015e-34, 299_792_458.0


def photon_rate(irradiance: F64 | float, pixel: float, wavelength: F64 | float) -> F64:
    """Photons per second on a pixel of side [m] at an irradiance [W/m2] of one wavelength [m]."""
    return np.asarray(irradiance) * (pixel * pixel * wavelength / (PLANCK * LIGHT_SPEED))


@dataclass(frozen=True)
class Pattern:
    """The fixed pattern of the pixels (height, width): response over the mean, dark signal [electrons]."""

    response: F64
    dark: F64


class ImageSensor:
    """One sensor of a make, with its own fixed pattern."""

    def __init__(self, sheet: CameraSheet, size: tuple[int, int], *, is_noisy: bool = True) -> None:
        self.sheet, self.is_noisy, self._size = sheet, is_noisy, size
        self._pattern = Pattern(np.ones(size), np.zeros(size))

    def reset(self, stream: Stream) -> None:
        """Draw the fixed pattern of this sensor."""
        if self.is_noisy:
            draw = stream.at(0)
            response = 1.0 + self.sheet.prnu * draw.standard_normal(self._size)
            dark = self.sheet.dsnu * draw.standard_normal(self._size)
            self._pattern = Pattern(np.maximum(response, 0.0), dark)

    def expose(
        self,
        photons: F64,
        exposure: float,
        draw: np.random.Generator,
        *,
        gain: float = 1.0,
        efficiency: F64 | float | None = None,
    ) -> NDArray[np.uint16]:
        """Digital numbers (height, width) of mean photons per pixel in the exposure [s].

        efficiency: of each pixel, none = the sheet's first
        """
        s = self.sheet
        eta = s.efficiency(0) if efficiency is None else efficiency
        mean = eta * photons * self._pattern.response + s.dark_current * exposure
        electrons = mean
        if self.is_noisy:
            electrons = draw.poisson(mean) + s.dark_noise * draw.standard_normal(self._size)
        held = np.minimum(electrons, s.full_well)
        number = s.system_gain * gain * (held + self._pattern.dark) + s.black_level
        return np.clip(np.rint(number), 0, s.digital_max).astype(np.uint16)


STEP_MAX = 4.0  # most that the exposure changes from picture to picture


@dataclass(frozen=True)
class Params(SceneParams):
    """A camera with lens and sensor.

    samples_per_pixel: samples spread over the pixel
    channels: what an image holds
    sensor: name in data/sensors, or the user's own YAML
    binning: side of the squares of pixels whose mean is one pixel of the picture. Of a colour sensor each
        such pixel has all three colours from 2 on; at 1 they are interpolated
    width_px: width of the picture, the middle of the sensor; none = all of it
    height_px: height of the picture, the middle of the sensor; none = all of it
    distortion: `data_sheet` = distortion of the lens as in the data sheet, or `none`
    noise: `data_sheet` = noise as in the data sheet, or `none`
    blur: `data_sheet` = blur as in the data sheet, and by diffraction at its f-number; `none` = all rows and
        samples are at one time, behind a lens without blur
    exposure_ms: fixed exposure time; none = controlled
    target_percent: mean of a picture that the control wants, of the largest digital number
    damping: share of the wanted change of exposure, in stops, that the control makes from picture to picture
        [1]; the first picture is exposed as it would settle
    """

    samples_per_pixel: Literal[1, 4, 9, 16] = 4
    channels: tuple[Channel, ...] = ("colour", "depth", "label")
    sensor: str = "camera-global-3um45"
    binning: Literal[1, 2, 4, 8] = 2
    width_px: Annotated[int, Ge(8), Le(8192)] | None = None
    height_px: Annotated[int, Ge(8), Le(8192)] | None = None
    distortion: Literal["data_sheet", "none"] = "data_sheet"
    noise: Literal["data_sheet", "none"] = "data_sheet"
    blur: Literal["data_sheet", "none"] = "data_sheet"
    exposure_ms: Annotated[float, Gt(0), Le(1e4)] | None = None
    target_percent: Annotated[float, Gt(0), Le(100)] = 30.0
    damping: Annotated[float, Gt(0), Le(1)] = 0.5


class ErrorCamera(SceneCamera):
    """A camera with lens and sensor.

    sheet: data sheet of the whole sensor
    planes: make numbers of photons, one for all pixels or one per colour
    """

    kept: ClassVar[tuple[str, ...]] = ("_last", "_casts", "_exposure")

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        self._p = params
        self.sheet = load_camera(params.sensor, setup.base)
        binned = self.sheet.binned(params.binning)
        self.size = _size(params, binned)
        self._row_time = self.sheet.readout / max(binned.height - 1, 1)
        lens = self.sheet.optics if params.distortion == "data_sheet" else Lens()
        if params.blur == "data_sheet":
            self.mtf = diffraction_mtf(WAVELENGTHS[1], binned.f_number, binned.pixel)
        super().__init__(params, setup, Pinhole.centred(self.size[1], self.size[0], binned.focal_px, lens))
        self.planes = [
            ImageSensor(self.sheet.mean_of(count), self.size, is_noisy=params.noise == "data_sheet")
            for count in _pixel_counts(self.sheet.mosaic, params.binning)
        ]
        self._rate = self._photon_rates(0)
        self._exposure = 0.0  # of the next picture times its gain, 0 = as the control would settle

    def _photon_rates(self, t: int) -> F64:
        """Photons per second of a pixel of the sensor and unit of light at t [ns], (height, width, 3)."""
        s, day = self.sheet, self.daylight(t)
        axis = self.pinhole.rays()[..., 2]
        self._white = day.white
        image = FULL * BAND * day.unit * day.white * s.transmission / (4.0 * s.f_number**2)
        rates = photon_rate(image, s.pixel, np.array(WAVELENGTHS))
        return np.asarray(power(np.maximum(axis, 0.0), s.falloff)[..., None] * rates)

    def reset(self, stream: Stream) -> Outputs:
        """A black image; the fixed pattern of this sensor is drawn."""
        self._stream, self._exposure = stream, 0.0
        for k, plane in enumerate(self.planes):
            plane.reset(stream.child(f"pattern{k}"))
        return super().reset(stream)

    def picture(self, t: int, known: tuple[MachineState, ...]) -> Outputs:
        """Rows and samples at their own times."""
        if self._p.blur == "none":
            return super().picture(t, known)
        exposure, _ = self._split(self._exposure or self.sheet.exposure_min)
        seen = self.look(t, self.pose_at(t, known), *self._aimed(t, exposure, known))
        return self._exposed(t, seen)

    def picture_from(self, t: int, pose: Pose) -> Outputs:
        """The picture of a camera that stands still."""
        return self._exposed(t, self.sight(t, pose))

    def _aimed(self, t: int, exposure: float, known: tuple[MachineState, ...]) -> tuple[F64, F64, F64]:
        """Origins and directions of all samples (rows, columns, 3) of a machine in these states, and their
        times after t [s], (rows, columns).
        """
        per, (height, width) = self.per_side, self.size
        rolls = self.sheet.shutter == "rolling"
        late = self._row_time * (np.arange(height) - (height - 1)) if rolls else np.zeros(1)
        directions = np.empty_like(self._rays)
        origins, after = np.empty_like(self._rays), np.empty(self._rays.shape[:2])
        for k in range(per * per):
            i, j = divmod(k, per)
            rank = per * i + (
                j if i % 2 == 0 else per - 1 - j
            )  # back and forth: no column is late in the mean
            within = exposure * ((rank + 0.5) / (per * per) - 1.0)
            times = np.float64(t) + (late + within) * NS
            position, turned = poses_at(known, times)
            position = position + product(turned, self.optical.position)
            rotation = product(turned, self.optical.rotation)
            rays = self._rays[i::per, j::per]
            directions[i::per, j::per] = np.einsum(
                "hlk,hwk->hwl", np.broadcast_to(rotation, (height, 3, 3)), rays
            )
            origins[i::per, j::per] = np.broadcast_to(position[:, None], (height, width, 3))
            after[i::per, j::per] = np.broadcast_to((late + within)[:, None], (height, width))
        return origins, directions, after

    @property
    def _fixed(self) -> float:
        return 0.0 if self._p.exposure_ms is None else 1e-3 * self._p.exposure_ms

    def _split(self, wanted: float) -> tuple[float, float]:
        """Exposure time [s] and gain whose product is wanted, as far as the sheet allows."""
        s = self.sheet
        if self._fixed:
            return self._fixed, 1.0
        exposure = min(max(wanted, s.exposure_min), s.exposure_max)
        return exposure, min(max(wanted / exposure, 1.0), s.gain_max)

    def _exposed(self, t: int, seen: Sight) -> Outputs:
        """What the sensor makes of the light, and the exposure of the next picture."""
        light = self.light(seen, t)
        if self.setup.field.weather is not None:
            self._rate = self._photon_rates(t)
        eta, rate = self._detected(np.maximum(light, 0.0) * self._rate)
        if self._exposure == 0.0:
            self._exposure = self._wanted(float((eta * rate).mean()))
        exposure, gain = self._split(self._exposure)
        draw, numbers = self._stream.at(t), []
        for k, plane in enumerate(self.planes):
            photons = rate[..., k] * (exposure * self.sheet.system_gain / plane.sheet.system_gain)
            numbers.append(plane.expose(photons, exposure, draw, gain=gain, efficiency=eta[..., k]))
        raw = np.stack(numbers, axis=-1)
        share = self._share(raw)
        if not self._fixed:
            self._exposure = self._next(exposure * gain, float(share.mean()))
        channels: dict[str, Any] = {"exposure": exposure, "gain": gain}
        if "raw" in self.params.channels:
            channels["raw"] = raw
        if "colour" in self.params.channels:
            channels["colour"] = encode(self._developed(share))
        return self.outputs_of(t, seen, **channels)

    def _detected(self, rates: F64) -> tuple[F64, F64]:
        """Efficiency and photons per second of a pixel of each plane, of rates (height, width, 3)."""
        eta = np.array([self.sheet.efficiency(k) for k in range(3)])
        if len(self.planes) == 3:
            return np.broadcast_to(eta, rates.shape), rates
        if self.sheet.mosaic == "mono":
            return np.full((*self.size, 1), eta[1]), rates.sum(axis=-1, keepdims=True)
        return eta[filters(*self.size)][..., None], filtered(rates)[..., None]

    def _share(self, raw: NDArray[np.uint16]) -> F64:
        """Signal over the largest one (height, width, planes)."""
        top = self.sheet.digital_max - self.sheet.black_level
        return np.asarray(np.maximum(raw - self.sheet.black_level, 0.0) / top)

    def _wanted(self, electrons: float) -> float:
        """Exposure times gain at which the mean of electrons per second meets the target."""
        top = self.sheet.digital_max - self.sheet.black_level
        return float(self._p.target_percent * PERCENT * top / max(self.sheet.system_gain * electrons, 1e-9))

    def _next(self, last: float, mean: float) -> float:
        """Exposure times gain of the next picture."""
        off = self._p.target_percent * PERCENT / max(mean, 1e-4)
        step = float(2.0 ** (self._p.damping * log2(off)))
        return last * min(max(step, 1.0 / STEP_MAX), STEP_MAX)

    def _developed(self, share: F64) -> F64:
        """Linear picture (height, width, 3), white in a sun at 45 deg is grey at any efficiency."""
        if self.sheet.mosaic == "mono":
            return np.repeat(share, 3, axis=-1)
        seen = np.array([self.sheet.efficiency(k) * WAVELENGTHS[k] for k in range(3)]) * self._white
        picture = share if len(self.planes) == 3 else interpolated(share[..., 0])
        return np.asarray(picture * (seen[1] / seen))


def _pixel_counts(mosaic: str, binning: int) -> tuple[int, ...]:
    """Pixels of the sensor in a pixel of each plane of the picture."""
    every = binning * binning
    return (every // 4, every // 2, every // 4) if mosaic == "rggb" and binning > 1 else (every,)


def _size(params: Params, sheet: CameraSheet) -> tuple[int, int]:
    """Height and width of the picture. InputError for more than the sensor has."""
    found = []
    for key, wanted, most in (
        ("height_px", params.height_px, sheet.height),
        ("width_px", params.width_px, sheet.width),
    ):
        if wanted is not None and wanted > most:
            expected = f"expected at most {most}, the pixels of the sensor at binning {params.binning}"
            raise InputError(key, wanted, expected)
        found.append(most if wanted is None else wanted)
    return found[0], found[1]


LEVEL = Level(
    ErrorCamera,
    Params,
    "a camera by its data sheet: lens, shutter, blur, exposure control, EMVA 1288 noise, mosaic",
    cost="5 us of one core per pixel with four samples each: 1.6 s for 640 x 480",
    tolerance="equal to rays within 0.5 px without distortion; K, dark noise and efficiency within 2 %",
    checked=(*CAMERA, Checked("light_lx", 1000.0, BRIGHTEST, "tests/sensing/test_camera_error.py", OWN_LAW)),
)
