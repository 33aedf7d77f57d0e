"""Time to cut a strip of 12 m x 0.5 m out of standing wheat, and what a cut does to the speed of rays."""

import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parents[1]))

from _harness import interleave, machine, median, write_json
from ray_scenes import make_beams

from swath.core.random import Stream
from swath.field.crop_sheet import load_crop
from swath.field.edges.edge_defects import BrokenEdge
from swath.field.edges.track import EdgeShape, straight
from swath.field.field import Field, make_field
from swath.field.field_setup import FieldSetup
from swath.field.stand.uniform import Params as StandParams
from swath.field.stand.uniform import Uniform
from swath.field.terrain.plane import Params as PlaneParams
from swath.field.terrain.plane import Plane
from swath.rays.engine import RayCaster

WIDTH, LENGTH = 12.0, 0.5


def make_wheat(density: float = 600.0) -> Field:
    """A flat field, crop to the right of an edge along y = 0."""
    setup = FieldSetup(stream=Stream(1, "field"))
    stand = Uniform(StandParams(stems_per_m2=density), setup)
    edge = BrokenEdge(EdgeShape(straight(0.0, 0.0, 0.0, 500.0), "right"), stubble=15)
    terrain = Plane(PlaneParams(), setup)
    return make_field(terrain, stand, edge, crop=load_crop("wheat"), stream=setup.stream)


def cut_times(field: Field, strips: int = 60) -> list[float]:
    """Wall seconds of each of a row of strips."""
    field.ensure(0.5 * strips * LENGTH, -0.5 * WIDTH, strips * LENGTH)
    field.cut([[-1.0, -1.0], [-0.9, -1.0], [-1.0, -0.9]], 0.15)  # the first one loads the compiled kernel
    times = []
    for k in range(strips):
        x = k * LENGTH
        strip = np.array([[x, -WIDTH], [x + LENGTH, -WIDTH], [x + LENGTH, 0.0], [x, 0.0]])
        started = time.perf_counter()
        field.cut(strip, 0.15)
        times.append(time.perf_counter() - started)
    return times


def ray_ratio(field: Field) -> float:
    """CPU time of rays over half-cut ground against rays over standing crop, interleaved, median."""
    caster = RayCaster(field, threads=1)
    _, down = make_beams(37, 40_000)

    def cast(x: float) -> None:
        caster.cast_bundles((np.broadcast_to([x, -WIDTH, 4.0], down.shape), down), range_max=60.0)

    for x in (10.0, 120.0):
        field.ensure(x, -WIDTH, 60.0)
    times = interleave({"half cut": lambda: cast(10.0), "standing": lambda: cast(120.0)}, rounds=5)
    return median([a / b for a, b in zip(times["half cut"], times["standing"], strict=True)])


def main(out_dir: Path | str = "out/bench") -> dict[str, Any]:
    """Measure, print, write cutting.json."""
    from rich.console import Console

    field = make_wheat()
    times = sorted(cut_times(field))
    data = {
        "machine": machine(),
        "strip_m": [WIDTH, LENGTH],
        "cut_ms_median": 1e3 * median(times),
        "cut_ms_max": 1e3 * times[-1],
        "ray_time_half_cut_over_standing": ray_ratio(field),
    }
    Console().print(
        f"Cutting {WIDTH:g} m x {LENGTH:g} m at 600 stems/m2: {data['cut_ms_median']:.2f} ms (median), "
        f"{data['cut_ms_max']:.2f} ms (longest). Rays over half-cut ground take "
        f"{data['ray_time_half_cut_over_standing']:.2f} of the time over standing crop."
    )
    write_json(Path(out_dir), "cutting", data)
    return data


if __name__ == "__main__":
    main()
