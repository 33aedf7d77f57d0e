"""One scan as files: scan.png (picture), scan.csv (a line per echo), scan.npz (arrays), point clouds."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from swath.core.errors import InputError
from swath.core.frames import Pose
from swath.record.messages import RecordedMachine
from swath.report import plots
from swath.report.scan_sampler import KeptScan
from swath.report.stand3d import Stand, stand_figure
from swath.signals import F64, Scan, ScanTruth
from swath.signals.setup import MachineGeometry
from swath.tools.scan.point_cloud import make_cloud, need_las, write_las, write_ply

FORMATS = ("png", "csv", "npz", "ply", "las", "laz")
USUAL_FORMATS = FORMATS[:4]
COLUMNS = (
    "beam,echo,time_s,azimuth_rad,elevation_rad,range_m,intensity,x_machine_m,y_machine_m,z_machine_m,"
    "x_true_m,y_true_m,z_true_m"
)


def check_formats(formats: Sequence[str]) -> None:
    """InputError for a name that is none of FORMATS, MissingExtra for one that needs more."""
    for name in formats:
        if name not in FORMATS:
            raise InputError("--format", name, f"expected some of {', '.join(FORMATS)}")
    if {"las", "laz"} & set(formats):
        need_las()


def write_scan(
    folder: Path,
    scan: Scan,
    truth: ScanTruth,
    kept: KeptScan,
    *,
    mounting: Pose,
    machine: RecordedMachine,
    stand: Stand,
    edge: F64,
    formats: Sequence[str] = USUAL_FORMATS,
) -> list[Path]:
    """Write a file per format of FORMATS; returns their paths.

    mounting: pose_machine_sensor; edge: as for the report. MissingExtra where a format needs more.
    """
    points = mounting.apply(scan.points())
    cloud = make_cloud(scan, truth, kept.pose @ mounting)
    write: dict[str, Callable[[Path], Path]] = {
        "png": lambda p: _picture(p, scan, points, kept, machine, stand_figure(stand, kept, machine, edge)),
        "csv": lambda p: _table(p, scan, points, truth),
        "npz": lambda p: _arrays(p, scan, points, truth, kept),
        "ply": lambda p: write_ply(p, cloud),
        "las": lambda p: write_las(p, cloud, machine.origin),
        "laz": lambda p: write_las(p, cloud, machine.origin),
    }
    return [write[name](folder / f"scan.{name}") for name in FORMATS if name in formats]


def _picture(
    path: Path, scan: Scan, points: F64, kept: KeptScan, machine: RecordedMachine, drawn: Any
) -> Path:
    import matplotlib
    from matplotlib.image import imread

    with matplotlib.rc_context(plots.STYLE):
        fig = plots.figure(12.0, 11.0)
        profile, above, view = fig.subplots(3, 1, height_ratios=(1.0, 1.3, 2.4))
        plots.plot_scan(profile, kept, machine.geometry, machine.edge_side)
        profile.set(xlabel="left of the machine's axis [m]", ylabel="height [m]")
        profile.legend(loc="upper left", ncol=4)
        _from_above(above, points, scan, machine.geometry, machine.edge_side)
        picture = path.with_name("stand.png")
        drawn.savefig(picture, dpi=110)
        view.imshow(imread(picture))
        picture.unlink()
        view.set_axis_off()
        fig.savefig(path, dpi=110)
    return path


def _from_above(ax: Any, points: F64, scan: Scan, geometry: MachineGeometry, side: str) -> None:
    xyz = points.reshape(-1, 3)
    seen = np.isfinite(xyz[:, 0])
    dots = ax.scatter(xyz[seen, 1], xyz[seen, 0], c=scan.intensity.ravel()[seen], s=6, cmap="cividis")
    ax.figure.colorbar(dots, ax=ax, label="intensity", pad=0.01)
    end = geometry.header_end(side)
    half = 0.5 * geometry.header_width
    ax.plot([geometry.header_y - half, geometry.header_y + half], [end[0]] * 2, color=plots.INK, lw=3)
    ax.set_aspect("equal")
    ax.invert_xaxis()
    ax.set(xlabel="left of the machine's axis [m]", ylabel="ahead of the axle [m]")
    ax.set_title("echoes from above; the bar is the knife", loc="left", fontsize=9.5)


def _table(path: Path, scan: Scan, points: F64, truth: ScanTruth) -> Path:
    at = beam, _ = np.nonzero(np.isfinite(scan.ranges))
    angles = scan.beam_t[beam], scan.azimuth[beam], scan.elevation[beam]
    rows = np.column_stack([*at, *angles, scan.ranges[at], scan.intensity[at], points[at], truth.points[at]])
    np.savetxt(path, rows, ["%d", "%d", *["%.6g"] * 11], ",", header=COLUMNS, comments="")
    return path


def _arrays(path: Path, scan: Scan, points: F64, truth: ScanTruth, kept: KeptScan) -> Path:
    np.savez_compressed(
        path,
        t_ns=scan.t,
        beam_t_s=scan.beam_t,
        azimuth_rad=scan.azimuth,
        elevation_rad=scan.elevation,
        ranges_m=scan.ranges,
        intensity=scan.intensity,
        points_machine_m=points,
        points_true_m=truth.points,
        edge_true_m=kept.edge_true,
        edge_detected_m=np.nan if kept.edge is None else kept.edge.offset,
    )
    return path
