"""One scan of a scenario's first machine after some driving, as files; how its heights settle."""

import dataclasses
import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from swath.core.errors import InputError
from swath.core.random import Stream
from swath.judge.evaluators.edge_detection import EdgeDetection
from swath.report.scan_sampler import ScanSampler
from swath.runtime.assembly import assemble
from swath.runtime.evaluation import make_evaluation
from swath.runtime.loop import drive
from swath.runtime.world import World
from swath.scenario.scenario import Scenario
from swath.signals import F64, Image, MachineState, Scan, ScanTruth
from swath.tools.scan.converge import Settling


def scan_job(
    scenario: Scenario,
    out: Path,
    *,
    at_s: float = 0.0,
    formats: Sequence[str] | None = None,
    camera: bool = False,
) -> list[Path]:
    """One scan of a scenario's first machine after `at_s` of driving, as files `scan.*` in the folder `out`.

    formats: of tools/scan/files.py, None = picture, csv, npz and ply
    camera: what its camera sees then, too: scan.camera.png and scan.camera.npz
    """
    from swath.tools.scan.camera_picture import write_picture
    from swath.tools.scan.files import USUAL_FORMATS, check_formats, write_scan

    formats = USUAL_FORMATS if formats is None else formats
    check_formats(formats)
    world, sampler = _drive_to_scan(scenario, at_s, *(("camera",) if camera else ()))
    leader = world.leader
    scan = world.graph.latest(f"{leader.name}.lidar", "scan")
    truth = world.graph.latest(f"{leader.name}.lidar", "truth")
    assert isinstance(scan, Scan)
    if not isinstance(truth, ScanTruth):  # of a real scan from a log nobody knows it
        truth = _no_truth(scan)
    parts = Path(tempfile.mkdtemp(prefix="swath-scan-"))
    try:
        files = write_scan(
            parts,
            scan,
            truth,
            sampler.pick("lidar", 1)[-1],
            mounting=leader.mountings["lidar"],
            machine=leader.recorded(),
            stand=world.field,
            edge=_edge_line(world),
            formats=formats,
        )
        if camera:
            image = world.graph.latest(f"{leader.name}.camera", "image")
            assert isinstance(image, Image)
            files += write_picture(parts, image)
        out.mkdir(parents=True, exist_ok=True)
        return [Path(shutil.move(f, out / f.name)) for f in files]
    finally:
        shutil.rmtree(parts, ignore_errors=True)


def _no_truth(scan: Scan) -> ScanTruth:
    beams, echoes = scan.ranges.shape
    return ScanTruth(scan.t, np.full((beams, echoes, 3), np.nan), np.full((beams, 3), np.nan))


def converge_job(scenario: Scenario, out: Path, *, at_s: float = 0.0) -> tuple[list[dict[str, Any]], str]:
    """How the heights of a scan settle with the number of sub-rays, here, with the next seed, and with plants
    of the other detail.

    Writes scan.converge.png and scan.converge.csv into `out`; returns the rows of the table and a sentence.
    """
    from swath.tools.scan.converge import judge, table
    from swath.tools.scan.converge_plot import sentence, write_converge

    runs = [_settling(dataclasses.replace(scenario, seed=scenario.seed + k), at_s) for k in range(2)]
    verdict = judge(*runs)
    other = _other_detail(scenario)
    if other is not None:
        runs.append(_settling(other, at_s))
    out.mkdir(parents=True, exist_ok=True)
    write_converge(out, runs, verdict)
    return table(runs), sentence(verdict, runs)


def _other_detail(scenario: Scenario) -> Scenario | None:
    """The scenario with `reduced` plants, or with full ones when it has those; None where a stand has no
    such choice.
    """
    stand = scenario.field.stand
    detail = None if stand is None else getattr(stand.params, "detail", None)
    if stand is None or detail is None:
        return None
    params = dataclasses.replace(stand.params, detail="full" if detail == "reduced" else "reduced")
    changed = dataclasses.replace(scenario.field, stand=dataclasses.replace(stand, params=params))
    return dataclasses.replace(scenario, field=changed)


def _settling(scenario: Scenario, at_s: float) -> Settling:
    """The scans of one seed: the field as it is after `at_s`, with ever more sub-rays, without noise."""
    from swath.sensing.lidar.plants import PlantsLidar
    from swath.tools.scan.converge import settle

    world, _ = _drive_to_scan(scenario, at_s)
    leader = world.leader
    lidar = leader.parts["lidar"]
    if not isinstance(lidar, PlantsLidar):
        raise InputError(f"{leader.name}.lidar.level", type(lidar).__name__, "expected plants for --converge")
    stream = Stream(scenario.seed, f"{leader.name}.lidar.converge")

    def look(count: int, sweep: int, origins: F64, rotations: F64) -> F64:
        if count not in copies:
            quiet = dataclasses.replace(lidar.params, sub_rays=count, noise="none")
            copies[count] = PlantsLidar(quiet, lidar.setup)
            copies[count].reset(stream)
        truth = copies[count].scan_from(sweep, origins, rotations)["truth"]
        assert isinstance(truth, ScanTruth)
        return truth.points

    copies: dict[int, PlantsLidar] = {}
    state = world.graph.latest(f"{leader.name}.motion", "state")
    assert isinstance(state, MachineState)
    pose = state.pose @ lidar.mounting
    detail = getattr(world.field.stand, "detail", "full")
    return settle(look, world.field, pose, seed=scenario.seed, beams=len(lidar.azimuth), detail=detail)


def _drive_to_scan(scenario: Scenario, at_s: float, *more: str) -> tuple[World, ScanSampler]:
    """The world of a scenario once its first machine has driven `at_s` and scanned.

    more: further slots that it must have, and that have taken a step then
    """
    slots = next(iter(scenario.machines.values())).slots
    for name in ("lidar", *more):
        if name not in slots:
            raise InputError(name, "off", f"expected a scenario whose first machine has a {name}")
    world = assemble(scenario)
    leader = world.leader
    evaluation = make_evaluation(world)
    detection = evaluation.find(leader.name, EdgeDetection)
    assert detection is not None
    sampler = ScanSampler(leader.recorded(), lambda: detection.true_offset)
    waits = [2.0 / slots["lidar"].common.rate_hz, *(1.0 / slots[name].common.rate_hz for name in more)]
    try:
        drive(world, [evaluation, sampler], until_s=max(at_s, *waits))
    finally:
        world.close()
    return world, sampler


def _edge_line(world: World) -> F64:
    """The initial edge as points (500, 2) in the world [m]."""
    edge = world.field.first_edge
    return np.asarray(edge.point_at(np.linspace(0.0, edge.length, 500)))
