"""Light on a level card and on a sphere, against Mitsuba 3 with our sun and sky as its lamps.

python benchmarks/light_mitsuba.py [--elevations 10 37 57]    needs mitsuba (pip install mitsuba)

Both are Lambertian, of 50 %. What the camera takes for light: all of the level sky on every side of a thing.
"""

import argparse
from math import pi

import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from swath.core.units import DEG
from swath.field.weather import Sun
from swath.sensing.camera.shading import Daylight

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
        np.broadcast_arrays(-flat * np.sin(around), np.cos(polar)[:, None], flat * np.cos(around)), -1
    )
    up = mi.ScalarTransform4f().rotate([1, 0, 0], 90)
    world = np.stack([local[..., 0], -local[..., 2], local[..., 1]], axis=-1)
    sky = np.where(world[..., 2:] > 0.0, day.sky_at(world), 0.0)
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
    print("ours over Mitsuba's, less 1: the card, the sphere's upper half (mean, RMS), its part to the sun")
    for elevation in parser.parse_args().elevations:
        day = Daylight(Sun(AZIMUTH * DEG, elevation * DEG), 0.0)
        cells = [f"{elevation:4.0f} deg"]
        for shape in ("rectangle", "sphere"):
            seen, normal = scene(day, shape)
            length = np.linalg.norm(normal, axis=-1)
            upper = (length > 0.99) & (normal[..., 2] > 0.05)
            cosine = np.maximum(normal[upper] @ day.toward, 0.0)
            off = (RHO * day.on(cosine)).sum(axis=1) / seen[upper].sum(axis=1) - 1.0
            cells.append(f"{shape} {100 * off.mean():6.2f} % {100 * np.sqrt((off**2).mean()):6.2f} %")
            if shape == "sphere":
                lit = cosine > 0.3
                cells.append(f"lit {100 * off[lit].mean():6.2f} %" if lit.any() else "lit: out of view")
        print("   ".join(cells), flush=True)


if __name__ == "__main__":
    main()
