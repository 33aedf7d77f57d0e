"""Light on a level card and on a sphere, against Mitsuba 3 with our sun, sky and level ground as its lamps.

python benchmarks/light_mitsuba.py [--elevations 10 37 57]    needs mitsuba (pip install mitsuba)

Both are Lambertian, of 50 %; the ground is dry soil in sun and sky.
"""

import argparse
from itertools import product
from math import pi

import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from swath.core.units import DEG
from swath.field.memory_layout import Organ
from swath.field.weather import Sun
from swath.sensing.camera.shading import COLOURS, Daylight, linear

Array = NDArray[np.float64]
RHO, SIDE, SAMPLES = 0.5, 48, 1024
AZIMUTH = 200.0


def scene(day: Daylight, shape: str) -> tuple[Array, Array]:
    """Light of the pixels (SIDE, SIDE, 3) of a shape that Mitsuba sees, and its normals, 0 beside it."""
    rows, columns = 256, 512
    polar = (np.arange(rows) + 0.5) * pi / rows
    around = (np.arange(columns) + 0.5) * 2.0 * pi / columns  # as Mitsuba's maps go, y up
    flat = np.sin(polar)[:, None]
    local = np.stack(
        np.broadcast_arrays(flat * np.sin(around), np.cos(polar)[:, None], -flat * np.cos(around)), -1
    )
    up = mi.ScalarTransform4f().rotate([1, 0, 0], 90)
    world = np.stack([local[..., 0], -local[..., 2], local[..., 1]], axis=-1)
    ground = linear(COLOURS[Organ.GROUND]) * (day.sky + day.sun * max(float(day.toward[2]), 0.0))
    sky = np.where(world[..., 2:] > 0.0, day.sky_at(world), ground)
    look = mi.ScalarTransform4f().look_at(origin=[0, -5.0, 5.0], target=[0, 0, 0], up=[0, 0, 1])
    white = {"type": "diffuse", "reflectance": {"type": "rgb", "value": [RHO] * 3}}
    made = mi.load_dict({
        "type": "scene",
        "integrator": {"type": "aov", "aovs": "n:sh_normal", "own": {"type": "direct"}},
        "sensor": {
            "type": "perspective", "fov": 14.0, "to_world": look,
            "film": {"type": "hdrfilm", "width": SIDE, "height": SIDE, "rfilter": {"type": "box"}},
            "sampler": {"type": "independent", "sample_count": SAMPLES},
        },
        "sky": {"type": "envmap", "bitmap": mi.Bitmap(sky.astype(np.float32)), "to_world": up},
        "sun": {
            "type": "directional", "direction": (-day.toward).tolist(),
            "irradiance": {"type": "rgb", "value": (pi * day.sun).tolist()},
        },
        "card": {"type": shape, "bsdf": white},
    })  # fmt: skip
    picture = np.array(mi.render(made))
    return picture[..., :3].astype(float), picture[..., -3:].astype(float)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--elevations", type=float, nargs="+", default=[10.0, 37.0, 57.0])
    mi.set_variant("scalar_rgb")
    print("ours over Mitsuba's, less 1, mean and RMS: the card; of the sphere what looks up, and down")
    for elevation, cloud in product(parser.parse_args().elevations, (0.0, 1.0)):
        day = Daylight(Sun(AZIMUTH * DEG, elevation * DEG), cloud)
        cells = [f"{elevation:4.0f} deg {'overcast' if cloud else 'clear'}"]
        for shape, sides in (("rectangle", [1.0]), ("sphere", [1.0, -1.0])):
            seen, normal = scene(day, shape)
            for side in sides:
                some = (np.linalg.norm(normal, axis=-1) > 0.99) & (side * normal[..., 2] > 0.05)
                cosine = np.maximum(normal[some] @ day.toward, 0.0)
                found = RHO * day.on(normal[some].astype(np.float32), cosine)
                off = found.sum(axis=1) / seen[some].sum(axis=1) - 1.0
                cells.append(f"{shape} {100 * off.mean():6.2f} % {100 * np.sqrt((off**2).mean()):5.2f} %")
        print("   ".join(cells), flush=True)


if __name__ == "__main__":
    main()
