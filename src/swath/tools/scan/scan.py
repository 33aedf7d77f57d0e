"""One scan of a scenario after some driving, as files."""

import shutil
import tempfile
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from swath.core.errors import InputError
from swath.core.whole_file import write_whole
from swath.judge.evaluators.edge_detection import EdgeDetection
from swath.report.scan_sampler import ScanSampler
from swath.runtime.assembly import assemble
from swath.runtime.evaluation import make_evaluation
from swath.runtime.loop import drive
from swath.runtime.world import Machine, World
from swath.scenario.scenario import Scenario
from swath.scenario.slots import kind_of
from swath.signals import F64, Image, Scan, ScanTruth, Signal


@dataclass(frozen=True)
class DrivenWorld:
    """A world after some driving. machine: the one that scans; lidar, camera: its slots, "" = none
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


def scan_job(
    scenario: Scenario,
    out: Path,
    *,
    at_s: float = 0.0,
    formats: Sequence[str] | None = None,
    camera: bool = False,
    tell: Callable[[str], None] | None = None,
) -> list[Path]:
    """One scan of a scenario after `at_s` of driving, as files `scan.*` in the folder `out`.

    The scanner is the first lidar of the first machine that has one.
    formats: of tools/scan/files.py, None = picture, csv, npz and ply
    camera: also the image of that machine's first camera: scan.camera.png and scan.camera.npz
    tell: given each note of the machine, such as a rate that the sensor does not have
    """
    from swath.tools.scan.camera_picture import write_picture
    from swath.tools.scan.files import USUAL_FORMATS, check_formats, write_scan

    formats = USUAL_FORMATS if formats is None else formats
    check_formats(formats)
    driven = drive_to_scan(scenario, at_s, camera=camera)
    machine = driven.machine
    if tell is not None:
        for note in machine.notes:
            tell(note)
    parts = Path(tempfile.mkdtemp(prefix="swath-scan-"))
    files: list[Path] = []
    try:
        if driven.lidar:
            scan, truth = driven.latest(driven.lidar, "scan"), driven.latest(driven.lidar, "truth")
            assert isinstance(scan, Scan)
            files += write_scan(
                parts,
                scan,
                truth if isinstance(truth, ScanTruth) else _no_truth(scan),  # a scan from a log has none
                driven.sampler.pick(driven.lidar, 1)[-1],
                mounting=machine.mountings[driven.lidar],
                machine=machine.recorded(),
                stand=driven.world.field,
                edge=_edge_line(driven.world),
                formats=formats,
            )
        if camera:
            image = driven.latest(driven.camera, "image")
            assert isinstance(image, Image)
            files += write_picture(parts, image)
        out.mkdir(parents=True, exist_ok=True)
        return [write_whole(out / f.name, f.read_bytes()) for f in files]
    finally:
        shutil.rmtree(parts, ignore_errors=True)


def _no_truth(scan: Scan) -> ScanTruth:
    beams, echoes = scan.ranges.shape
    return ScanTruth(scan.t, np.full((beams, echoes, 3), np.nan), np.full((beams, 3), np.nan))


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
    sampler = ScanSampler(machine.recorded(), lambda: detection.true_offset if detection else float("nan"))
    waits = [turns / slots[slot].common.rate_hz for slot, turns in ((lidar, 2.0), (seen, 1.0)) if slot]
    try:
        drive(world, [evaluation, sampler], until_s=max(at_s, *waits))
    finally:
        world.close()
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


def _edge_line(world: World) -> F64:
    """The initial edge as points (500, 2) in the world [m]."""
    edge = world.field.first_edge
    return np.asarray(edge.point_at(np.linspace(0.0, edge.length, 500)))
