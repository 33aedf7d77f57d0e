"""One scan of a scenario after some driving, as files.

scan.png (picture), scan.csv (a line per echo), scan.npz (arrays), point clouds; of a camera its channels side
by side in scan.camera.png, its arrays in .npz.
"""

import io
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from swath.core.errors import InputError
from swath.core.files.output_folder import held
from swath.core.files.place import remove
from swath.core.files.whole_file import new_file, write_whole
from swath.core.number_text import num
from swath.core.schedule import NS
from swath.field.memory_layout import Organ
from swath.judge.evaluators.edge_detection import EdgeDetection
from swath.record.message_factory import RecordedMachine
from swath.report import plots
from swath.report.scan_sampler import KeptScan, ScanSampler
from swath.runtime.assembly import assemble
from swath.runtime.evaluation import make_evaluation
from swath.runtime.folder import SCAN_FILES, SCAN_OF, scan_in, scan_of
from swath.runtime.loop import drive
from swath.runtime.world import Machine, World
from swath.scenario.scenario import Scenario
from swath.scenario.slots import kind_of
from swath.signals import F32, F64, U8, Image, ImageShares, Scan, ScanTruth, Signal
from swath.signals.setup import MachineGeometry
from swath.tools.scan.point_cloud import make_cloud, need_las, write_las, write_ply
from swath.tools.scan.stand3d import COLOURS, GROUND, stand_figure

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


@dataclass(frozen=True)
class DrivenWorld:
    """A world after some driving. machine: the one that scans; lidar, camera: its slots, "" = none.

    sampler: the scans it took
    """

    world: World
    machine: Machine
    lidar: str
    camera: str
    sampler: ScanSampler

    def latest(self, slot: str, output: str) -> Signal | None:
        """The newest sample of an output of the machine."""
        return self.world.graph.latest(f"{self.machine.name}.{slot}", output)


def write_scan(folder: Path, driven: DrivenWorld, formats: Sequence[str]) -> list[Path]:
    """Write the newest scan, a file per format of FORMATS; returns their paths.

    MissingExtra where a format needs more.
    """
    scan, truth = driven.latest(driven.lidar, "scan"), driven.latest(driven.lidar, "truth")
    assert isinstance(scan, Scan)
    if not isinstance(truth, ScanTruth):  # a scan from a log has none
        beams, echoes = scan.ranges.shape
        truth = ScanTruth(scan.t, np.full((beams, echoes, 3), np.nan), np.full((beams, 3), np.nan))
    kept, machine = driven.sampler.pick(driven.lidar, 1)[-1], driven.machine.recorded()
    mounting = driven.machine.mountings[driven.lidar]
    points, field = mounting.apply(scan.points()), driven.world.field
    cloud = make_cloud(scan, truth, kept.pose @ mounting)
    edge = field.first_edge.point_at(np.linspace(0.0, field.first_edge.length, 500))
    write: dict[str, Callable[[Path], Path]] = {
        "png": lambda p: _picture(p, scan, points, kept, machine, stand_figure(field, kept, machine, edge)),
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
    from matplotlib.image import imread

    with plots.styled():
        fig = plots.figure(12.0, 11.0)
        profile, above, view = fig.subplots(3, 1, height_ratios=(1.0, 1.3, 2.4))
        plots.plot_scan(profile, kept, machine.geometry, machine.edge_side)
        profile.set(xlabel="left of the machine's axis [m]", ylabel="height [m]")
        profile.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncol=4, frameon=False)
        _from_above(above, points, scan, machine.geometry, machine.edge_side)
        picture = io.BytesIO()
        drawn.savefig(picture, format="png", dpi=110)
        view.imshow(imread(io.BytesIO(picture.getvalue())))
        view.set_axis_off()
    return plots.write_picture(path, fig, 110)


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
    with new_file(path) as file:
        np.savetxt(file, rows, ["%d", "%d", *["%.6g"] * 11], ",", header=COLUMNS, comments="")
    return path


def _arrays(path: Path, scan: Scan, points: F64, truth: ScanTruth, kept: KeptScan) -> Path:
    return _save(
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


def _save(path: Path, **arrays: Any) -> Path:
    with new_file(path) as file:
        np.savez_compressed(file, **arrays)
    return path


GAP = 4  # between the channels [px]
OTHERS = {Organ.NONE: "#FFFFFF", Organ.GROUND: GROUND, Organ.STRAW: "#F5E9C8", Organ.SOLID: "#56606B"}


def write_picture(folder: Path, image: Image, shares: ImageShares | None = None) -> list[Path]:
    """Write both files; returns their paths. Colour, depth (near bright) and label, as far as it has them."""
    from matplotlib.image import imsave

    drawn = []
    if image.colour.size:
        drawn.append(image.colour)
    if image.depth.size:
        drawn.append(_depth_colours(image.depth))
    if image.label.size:
        drawn.append(_label_colours(image.label))
    gap = np.full((image.height, GAP, 3), 255, np.uint8)
    row = [part for pixels in drawn for part in (gap, pixels)][1:]
    picture = folder / "scan.camera.png"
    with new_file(picture) as file:
        imsave(file, np.ascontiguousarray(np.concatenate(row, axis=1)), format="png")
    arrays = _save(
        folder / "scan.camera.npz",
        t_ns=image.t,
        focal_px=image.focal,
        centre_px=np.array([image.centre_x, image.centre_y]),
        colour=image.colour,
        depth_m=image.depth,
        label=image.label,
        instance=image.instance,
        raw=image.raw,
        black_white_k=np.array([image.black, image.white]),
        **({} if shares is None else {"share": shares.share, "share_instance": shares.instance}),
        label_names=np.array([organ.name.lower() for organ in Organ]),
    )
    return [picture, arrays]


def _depth_colours(depth: F32) -> U8:
    """Colours by the logarithm of the depth, from nearest to furthest in the picture; white = nothing."""
    import matplotlib

    seen = np.isfinite(depth)
    if not seen.any():
        return np.full((*depth.shape, 3), 255, np.uint8)
    logs = np.log(np.where(seen, depth, np.nanmin(depth)))
    share = (logs.max() - logs) / max(float(np.ptp(logs)), 1e-6)
    shown = matplotlib.colormaps["cividis"](share, bytes=True)[..., :3]
    return np.where(seen[..., None], shown, 255).astype(np.uint8)


def _label_colours(label: U8) -> U8:
    """In the colours of the other pictures of the stand."""
    from matplotlib.colors import to_rgb

    table = np.array([to_rgb({**COLOURS, **OTHERS}[organ]) for organ in Organ])
    return np.round(255.0 * table[label]).astype(np.uint8)


def scan_job(
    scenario: Scenario,
    out: Path,
    *,
    at_s: float = 0.0,
    formats: Sequence[str] | None = None,
    camera: bool = False,
    tell: Callable[[str], None] = lambda note: None,
) -> list[Path]:
    """One scan of a scenario after `at_s` of driving, as files `scan.*` in the folder `out`.

    The scanner is the first lidar of the first machine that has one.
    formats: of tools/scan/scan.py, None = picture, csv, npz and ply
    camera: also the image of that machine's first camera: scan.camera.png and scan.camera.npz
    tell: given each note of the machine, such as a rate that the sensor does not have
    """
    formats = USUAL_FORMATS if formats is None else formats
    check_formats(formats)
    driven = drive_to_scan(scenario, at_s, camera=camera)
    for note in driven.machine.notes:
        tell(note)
    files: list[Path] = []
    with held(out, SCAN_FILES, "scan"):
        if scan_in(out) not in (of := scan_of(scenario, at_s), None):
            for file in out.glob(SCAN_FILES[0]):
                remove(file)
        write_whole(out / SCAN_OF, of + "\n")
        if driven.lidar:
            files += write_scan(out, driven, formats)
        if camera:
            image = driven.latest(driven.camera, "image")
            assert isinstance(image, Image)
            ports = [port.name for port in driven.machine.parts[driven.camera].outputs]
            shares = driven.latest(driven.camera, "shares") if "shares" in ports else None
            files += write_picture(out, image, shares if isinstance(shares, ImageShares) else None)
    return files


def drive_to_scan(scenario: Scenario, at_s: float, *, camera: bool = False) -> DrivenWorld:
    """Drive a scenario for `at_s`, and on until the scanner and, with `camera`, the camera have taken a step.

    InputError where no machine has a lidar (with `camera`: nor a camera), or that machine has no camera.
    """
    name, lidar = seeing_machine(scenario) if camera else scanning_machine(scenario)
    slots = scenario.machines[name].slots
    seen = first_of_kind("camera", slots) if camera else ""
    if seen is None:
        raise InputError(f"{name}.camera", "off", "expected a machine with a camera")
    world = assemble(scenario)
    machine = world.machines[name]
    evaluation = make_evaluation(world)
    detection = evaluation.find(name, EdgeDetection)
    true_offset = lambda: detection.true_offset if detection else float("nan")  # noqa: E731
    state = partial(world.graph.latest, f"{name}.motion", "state")
    sampler = ScanSampler(machine.recorded(), true_offset, state)
    waits = [turns / slots[slot].common.rate_hz for slot, turns in ((lidar, 2.0), (seen, 1.0)) if slot]
    try:
        drive(world, [evaluation, sampler], until_s=max(at_s, *waits))
    finally:
        world.close()
    if round(at_s * NS) > world.graph.t:
        end_s = world.graph.t / NS
        raise InputError("--at-s", at_s, f"expected a time of the run, which ends at {num(end_s)} s")
    return DrivenWorld(world, machine, lidar, seen, sampler)


def scanning_machine(scenario: Scenario) -> tuple[str, str]:
    """The first machine that has a lidar, and its first lidar slot. InputError where none has one."""
    for name, machine in scenario.machines.items():
        if (lidar := first_of_kind("lidar", machine.slots)) is not None:
            return name, lidar
    raise InputError("lidar", "off", "expected a scenario with a machine that has a lidar")


def seeing_machine(scenario: Scenario) -> tuple[str, str]:
    """The first machine that scans and its first lidar slot; else the first with a camera and ""."""
    try:
        return scanning_machine(scenario)
    except InputError:
        for name, machine in scenario.machines.items():
            if first_of_kind("camera", machine.slots) is not None:
                return name, ""
        return next(iter(scenario.machines)), ""


def first_of_kind(name: str, instances: Iterable[str]) -> str | None:
    """The first slot of a kind, in the order given; None without one."""
    kinds = ((slot, kind_of(slot)) for slot in instances)
    return next((slot for slot, kind in kinds if kind is not None and kind.name == name), None)
