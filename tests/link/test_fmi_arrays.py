"""Scans into and out of FMUs: arrays of both versions, beams without an echo, wrong lengths."""

import numpy as np
import pytest

from swath.core.errors import SwathError
from swath.report.report import ReportWriter
from swath.runtime.assembly import assemble
from swath.runtime.job import run_job
from swath.runtime.loop import drive
from swath.scenario.scenario import parse_scenario
from tests.link.fmu_scenario import TEXT
from tests.link.made_fmus import engine_fmu, needs_cc, store_fmu

pytest.importorskip("fmpy")
pytestmark = [needs_cc, pytest.mark.usefixtures("code_allowed")]
LIDAR = "{sub_rays: 1, noise: none, sector_deg: [-1, 1], step_deg: 1.0}"
EDGE = """
    edge:
      level: fmu
      file: {file}
      inputs: {{ranges: scan.ranges}}
      outputs: {{edge.offset_sd: digits}}
      constants:
        edge.offset: nan
        edge.heading: 0
        edge.curvature: 0
        edge.reference_x: 8
        edge.confidence: 0.5
        edge.crop_height: nan
        edge.stubble_height: nan
"""


def text(lidar, edge):
    plain = TEXT.replace("    lidar: off\n    edge: truth\n", "")
    return plain + f"    lidar: {lidar}\n{edge}\n"


def test_an_edge_detector_gets_the_ranges_of_every_scan(tmp_path):
    file = store_fmu(tmp_path)
    world = assemble(parse_scenario(text(LIDAR, EDGE.format(file=file))))
    seen = []
    world.graph.observers = [world.place_bodies]
    world.graph.reset()
    for k in range(1, 6):
        world.graph.run(k * 40_000_000)
        scan = world.graph.latest("combine.lidar", "scan")
        edge = world.graph.latest("combine.edge", "edge")
        expected = scan.ranges[:, 0].astype(float) @ np.array([1.0, 10.0, 100.0])
        assert edge.offset_sd == pytest.approx(expected, rel=1e-12)
        assert edge.t == k * 40_000_000
        assert np.isnan(edge.crop_height)
        seen.append(edge.offset_sd)
    world.close()
    assert len(set(seen)) > 1


def test_a_beam_without_an_echo_is_nan_in_and_out(tmp_path):
    up = LIDAR.replace("sub_rays", "mount: {pitch_deg: -60}, sub_rays")
    world = assemble(parse_scenario(text(up, EDGE.format(file=store_fmu(tmp_path)))))
    drive(world, until_s=0.1)
    assert np.isnan(world.graph.latest("combine.lidar", "scan").ranges).all()
    assert np.isnan(world.graph.latest("combine.edge", "edge").offset_sd)
    world.close()


def test_a_scan_of_another_length_is_refused(tmp_path):
    more = LIDAR.replace("[-1, 1]", "[-2, 2]")
    world = assemble(parse_scenario(text(more, EDGE.format(file=store_fmu(tmp_path)))))
    message = r"combine\.edge: store\.fmu .*: scan\.ranges has 5 numbers, but ranges of the FMU takes 3"
    with pytest.raises(SwathError, match=message):
        drive(world, until_s=0.1)
    world.close()


def test_a_scanner_that_is_an_fmu(tmp_path):
    keys = f"""
      level: fmu
      file: {engine_fmu(tmp_path)}
      parameters: {{length: 4, x: [1.0, 2.0, 3.0, 4.5]}}
      outputs: {{scan.ranges: y}}
      constants:
        scan.beam_t: [-0.01, -0.005, -0.002, 0]
        scan.azimuth: [-0.1, 0, 0.1, 0.2]
        scan.elevation: [0, 0, 0, 0]
        scan.intensity: [1, 1, 1, 1]
"""
    made = parse_scenario(text(keys, "    edge: truth"), sets=["run.distance_m=0.5"])
    run_job(made, tmp_path / "run", hooks=[ReportWriter()])
    world = assemble(made)
    drive(world, until_s=0.1)
    scan = world.graph.latest("combine.lidar", "scan")
    assert scan.ranges.shape == (4, 1)
    assert scan.ranges[:, 0].tolist() == [2.0, 4.0, 6.0, 9.0]
    assert (tmp_path / "run" / "report.html").is_file()
    world.close()
