"""Heights over stubble, and the place of the crop edge, at the LiDAR level `empirical` against `plants`.

Stands that the tables were not fitted to: other plants (seeds), densities, rows and cuts between the nodes.
Both levels scan the same field without noise: stubble from 3 m up and all headings at four depressions, one
seed, and the edge from several heights, depressions and headings, six seeds. The edge lies where the height
goes through half the crop's.
"""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))

import numpy as np
from _harness import write_json

UP = 3.0  # height of the scanner [m]
DEPRESSIONS = (8.0, 16.0, 30.0, 50.0)
ROW = {
    "wheat": 0.125,
    "barley": 0.15,
    "rye": 0.125,
    "rape": 0.25,
}  # [m]; the sheets: 0.125, 0.125, 0.125, 0.25
CUT = {
    "wheat": 0.13,
    "barley": 0.18,
    "rye": 0.2,
    "rape": 0.34,
}  # [m]; nodes: 0.06 0.15 0.27, rye 0.1 0.25 0.45, ...
DENSITIES = {
    "wheat": (100, 150, 240, 430, 600),
    "barley": (100, 240, 430, 600),
    "rye": (100, 190, 430, 600),
    "rape": (14, 25, 50),
}
SEEDS = (31, 32, 33, 34, 35, 36)
SENSORS = ("sick-lms511-hr", "sick-lms111")
SCENARIO = """
format: swath scenario 2
name: stubble
run: {distance_m: 4, max_duration_s: 6}
field: {terrain: {level: plane}, stand: {level: uniform}, edge: {shape: straight}}
machines: {combine: {motion: single_track, lidar: {sub_rays: 1, step_deg: 10}}}
"""


@dataclass(frozen=True)
class View:
    """up: height of the scanner [m]; yaw_deg: 90 = along the edge, less: towards the crop."""

    up: float = UP
    depression_deg: float = 16.0
    yaw_deg: float = 90.0


VIEWS = {
    "along it": View(),
    "2.4 m up, 10 deg down": View(2.4, 10.0),
    "4 m up, 30 deg down": View(4.0, 30.0),
    "50 deg to it": View(yaw_deg=40.0),
    "from the crop, 50 deg": View(yaw_deg=140.0),
}


def make_site(crop: str, density: float, seed: int, *, row_m: float, cut_m: float) -> Any:
    """What a sensor is told in a field whose crop stands at x > 0, with stubble at x < 0."""
    from swath.runtime.assembly import assemble
    from swath.scenario.scenario import parse_scenario

    stand = f"{{level: uniform, crop: {crop}, stems_per_m2: {density}, row_spacing_m: {row_m}}}"
    sets = [f"field.stand={stand}", f"field.edge.stubble_height_m={cut_m}", f"seed={seed}"]
    return assemble(parse_scenario(SCENARIO, sets=sets)).leader.parts["lidar"].setup


def both_levels(
    setup: Any, sensor: str, half_deg: float, step_deg: float, table: str | None = None
) -> dict[str, Any]:
    """The two scanners, without noise."""
    from swath.sensing.lidar import empirical, plants

    keys: Any = {"noise": "none", "sensor": sensor, "sector_deg": (-half_deg, half_deg), "step_deg": step_deg}
    return {
        "plants": plants.PlantsLidar(plants.Params(sub_rays=37, **keys), setup),
        "empirical": empirical.EmpiricalLidar(empirical.Params(table=table, **keys), setup),
    }


def heights(lidar: Any, poses: Any, seed: int, up: float = UP) -> np.ndarray:
    """Measured heights over the ground [m], (scans, beams)."""
    from swath.core.random import Stream

    lidar.reset(Stream(seed, "lidar"))
    count, found = len(lidar.azimuth), []
    for k, pose in enumerate(poses):
        out = lidar.scan_from(
            10**9 + k, np.repeat(pose.position[None], count, 0), np.repeat(pose.rotation[None], count, 0)
        )
        down = (pose.rotation @ lidar.scanner.axes)[:, 2, 0]
        found.append(up + out["scan"].ranges[:, 0] * down)
    return np.array(found)


def over_stubble(depression_deg: float, scans: int, seed: int) -> list[Any]:
    """Poses whose middle beam meets the stubble 12 to 20 m beside the edge, from all headings."""
    from swath.core.frames import Pose

    rng, far, made = np.random.default_rng(seed), UP / np.tan(np.radians(depression_deg)), []
    for _ in range(scans):
        yaw, aim = (
            rng.uniform(0.0, 2.0 * np.pi),
            np.array([rng.uniform(-20.0, -12.0), rng.uniform(20.0, 60.0)]),
        )
        if (aim - far * np.array([np.cos(yaw), np.sin(yaw)]))[0] > -3.0:
            yaw = np.pi - yaw
        x, y = aim - far * np.array([np.cos(yaw), np.sin(yaw)])
        made.append(Pose.from_euler((x, y, UP), 0.0, np.radians(depression_deg), yaw))
    return made


def over_edge(view: View, crop_height: float, scans: int, seed: int) -> list[Any]:
    """Poses from which the middle beam meets half the crop's height above the edge, where crop begins."""
    from swath.core.frames import Pose

    far = (view.up - 0.5 * crop_height) / np.tan(np.radians(view.depression_deg))
    yaw = np.radians(view.yaw_deg)
    y = np.random.default_rng(seed).uniform(20.0, 60.0, scans)
    return [
        Pose.from_euler((-far * np.cos(yaw), float(v), view.up), 0.0, np.radians(view.depression_deg), yaw)
        for v in y
    ]


def edge_place(lidar: Any, view: View, crop_height: float, scans: int, seed: int) -> float:
    """How much of the scan lies on crop, across the edge [m]: grows as the edge moves away from the crop."""
    poses = over_edge(view, crop_height, scans, seed)
    share = np.mean(heights(lidar, poses, seed, view.up) > 0.5 * crop_height, axis=0)
    beam = poses[0].rotation @ lidar.scanner.axes[:, :, 0].T
    across = beam[0] / -beam[2] * (view.up - 0.5 * crop_height)  # where beams are at half the height
    return float(np.sum(share * np.abs(np.gradient(across))))


def compare_stubble(
    crop: str, density: float, sensor: str, seeds: tuple[int, ...], *, table: str | None = None
) -> dict[str, Any]:
    """Mean heights over stubble by depression [m]."""
    seen: dict[tuple[str, float], list[np.ndarray]] = {}
    for seed in seeds:
        setup = make_site(crop, density, seed, row_m=ROW[crop], cut_m=CUT[crop])
        for level, lidar in both_levels(setup, sensor, 15.0, 1.5, table).items():
            for degrees in DEPRESSIONS:
                poses = over_stubble(degrees, 24 if level == "plants" else 60, seed)
                seen.setdefault((level, degrees), []).append(heights(lidar, poses, seed))
    mean = {
        key: float(np.nanmean(np.concatenate(v))) if np.isfinite(v).any() else np.nan
        for key, v in seen.items()
    }
    return {
        "plants_m": [mean["plants", d] for d in DEPRESSIONS],
        "off_m": [mean["empirical", d] - mean["plants", d] for d in DEPRESSIONS],
    }


def compare_edge(
    crop: str, density: float, sensor: str, seeds: tuple[int, ...], *, table: str | None = None
) -> dict[str, tuple[float, float]]:
    """By view: how far the edge lies outside of where `plants` has it, mean over seeds and its error [m]."""
    from swath.field.crop_sheet import load_crop

    full = load_crop(crop).stand.height
    off: dict[str, list[float]] = {}
    for seed in seeds:
        setup = make_site(crop, density, seed, row_m=ROW[crop], cut_m=CUT[crop])
        pair = both_levels(setup, sensor, 9.0, 0.2, table)
        for name, view in VIEWS.items():
            dear, cheap = (
                edge_place(lidar, view, full, 20 if level == "plants" else 50, seed)
                for level, lidar in pair.items()
            )
            off.setdefault(name, []).append(cheap - dear)
    count = max(len(seeds) - 1, 1)
    return {name: (float(np.mean(v)), float(np.std(v) / np.sqrt(count))) for name, v in off.items()}


def compare(
    crop: str, density: float, sensor: str, seeds: tuple[int, ...], *, table: str | None = None
) -> dict[str, Any]:
    """Both, of a stand."""
    row: dict[str, Any] = {"crop": crop, "density": density, "sensor": sensor}
    row |= compare_stubble(crop, density, sensor, seeds[:1], table=table)
    return row | {"edge_m": compare_edge(crop, density, sensor, seeds, table=table)}


def main(
    out_dir: Path | str = "out/bench", *crops: str, seeds: tuple[int, ...] = SEEDS
) -> list[dict[str, Any]]:
    """Measures, prints two lines per stand, writes stubble.json; crops: only these."""
    print("mean height of stubble at `plants`, `empirical` off it, at 8, 16, 30, 50 deg [mm]")
    print("edge off, mean over seeds and its standard error [mm]: " + "; ".join(VIEWS))
    rows = []
    for crop in crops or DENSITIES:
        for density in DENSITIES[crop]:
            for sensor in SENSORS:
                row = compare(crop, density, sensor, seeds)
                rows.append(row)
                cells = zip(row["plants_m"], row["off_m"], strict=True)
                shown = "".join(
                    f"{1e3 * p:5.0f} {1e3 * e:+4.0f} |" if np.isfinite(p) else "        - |" for p, e in cells
                )
                edge = "  ".join(f"{1e3 * e:+4.0f} ({1e3 * sd:.0f})" for e, sd in row["edge_m"].values())
                print(f"{crop:7}{density:4.0f} {sensor[5:]:9}|{shown} edge {edge}", flush=True)
    worst = max(abs(e) for row in rows for e in row["off_m"] if np.isfinite(e))
    print(f"worst over stubble {1e3 * worst:.0f} mm")
    for name in VIEWS:
        edge = max(abs(row["edge_m"][name][0]) for row in rows)
        print(f"worst at the edge, {name}: {1e3 * edge:.0f} mm")
    write_json(Path(out_dir), "stubble", {"rows": rows})
    return rows


if __name__ == "__main__":
    main(*sys.argv[1:])
