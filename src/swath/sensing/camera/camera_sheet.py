"""Data sheets of cameras: `data/sensors/camera-*.yaml`: image sensor by EMVA 1288, lens, shutter."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

from swath.core.lens import Lens, LensModel
from swath.documents.data_sheets import read_sheet
from swath.documents.sheet_fields import Quantity


@dataclass(frozen=True, kw_only=True)
class CameraSheet:
    """mosaic: `rggb`: colour filters in rows red green, green blue; `mono`: none, a grey picture.

    shutter: all rows at once, or one after the other
    lens: whose formulas
    distortion: their coefficients, as OpenCV orders them, empty = none

    width, height: of the image sensor [px]
    pixel: side of a pixel [m]; focal_length [m]; f_number
    transmission: of the lens
    falloff: power of the cosine off the axis that light goes with, 4 = natural
    quantum_efficiency: of red, green and blue light, or of one number for all
    system_gain: K, digital numbers per electron at gain 1
    dark_noise: sigma_d [electrons]; dark_current [electrons/s]; full_well [electrons]
    dsnu: [electrons]; prnu
    black_level: of the digital numbers; bits
    readout: from the first to the last row of the sensor [s]; exposure_min, exposure_max [s]; gain_max
    """

    format: str
    kind: Literal["camera"] = "camera"
    name: str
    note: str = ""
    mosaic: Literal["rggb", "mono"]
    shutter: Literal["global", "rolling"]
    lens: LensModel = "brown_conrady"
    width: Annotated[int, Quantity("", 8, 8192, key="width_px")]
    height: Annotated[int, Quantity("", 8, 8192, key="height_px")]
    pixel: Annotated[float, Quantity("um", 0.3, 50)]
    focal_length: Annotated[float, Quantity("mm", 0.1, 500)]
    f_number: Annotated[float, Quantity("", 0.5, 64)]
    transmission: Annotated[float, Quantity("percent", 1, 100)]
    falloff: Annotated[float, Quantity("", 0, 8)]
    distortion: Annotated[list[float], Quantity("")]
    quantum_efficiency: Annotated[list[float], Quantity("percent")]
    system_gain: Annotated[float, Quantity("", 1e-4, 1e3)]
    dark_noise: Annotated[float, Quantity("", 0, 1e4, key="dark_noise_electrons")]
    dark_current: Annotated[float, Quantity("", 0, 1e6, key="dark_current_electrons_s")]
    full_well: Annotated[float, Quantity("", 100, 1e7, key="full_well_electrons")]
    dsnu: Annotated[float, Quantity("", 0, 1e4, key="dsnu_electrons")]
    prnu: Annotated[float, Quantity("percent", 0, 50)]
    black_level: Annotated[float, Quantity("", 0, 4096)]
    bits: Annotated[int, Quantity("", 6, 16)]
    readout: Annotated[float, Quantity("ms", 0, 1000)]
    exposure_min: Annotated[float, Quantity("ms", 1e-3, 1e4)]
    exposure_max: Annotated[float, Quantity("ms", 1e-3, 1e4)]
    gain_max: Annotated[float, Quantity("", 1, 1000)]

    @property
    def optics(self) -> Lens:
        """The lens. InputError where the number of coefficients does not fit the formulas."""
        return Lens(self.lens, tuple(self.distortion))

    @property
    def focal_px(self) -> float:
        """Focal length over the side of a pixel."""
        return self.focal_length / self.pixel

    @property
    def digital_max(self) -> int:
        """The largest digital number."""
        return int(2**self.bits - 1)

    def efficiency(self, channel: int) -> float:
        """Quantum efficiency of red, green or blue light (0, 1, 2)."""
        every = self.quantum_efficiency
        return every[channel] if len(every) == 3 else every[0]

    def binned(self, side: int) -> "CameraSheet":
        """The geometry of a camera whose pixels are squares of side x side of this one's."""
        return replace(self, width=self.width // side, height=self.height // side, pixel=self.pixel * side)

    def mean_of(self, count: int) -> "CameraSheet":
        """The image sensor whose pixel is the mean of so many of this one, each read by itself.

        Counted are the electrons of all of them.
        """
        root = count**0.5
        return replace(
            self,
            system_gain=self.system_gain / count,
            full_well=self.full_well * count,
            dark_noise=self.dark_noise * root,
            dark_current=self.dark_current * count,
            dsnu=self.dsnu * root,
            prnu=self.prnu / root,
        )


def load_camera(name: str, base: Path | None = None) -> CameraSheet:
    """A bundled camera by name, or the user's own YAML file."""
    sheet = read_sheet("sensors", name, base)
    made = sheet.read(CameraSheet)
    every = made.quantum_efficiency
    if len(every) not in (1, 3) or not all(0.0 < eta <= 1.0 for eta in every):
        expected = "expected one number > 0 and at most 100, or three: red, green, blue"
        raise sheet.error("quantum_efficiency_percent", expected)
    if made.exposure_min > made.exposure_max:
        raise sheet.error("exposure_min_ms", "expected at most exposure_max_ms")
    try:
        made.optics  # noqa: B018  its coefficients are checked when it is made
    except Exception as error:
        raise sheet.error("distortion", str(getattr(error, "expected", error))) from error
    return made
