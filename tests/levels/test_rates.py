"""Rates of slots: each goes at exactly its own, whatever the others have, and is told as it was typed."""

from fractions import Fraction

import numpy as np
import pytest

import swath.compiled
from swath.commands.new import TEMPLATES
from swath.core.graph import Lockstep
from swath.documents.data_sheets import read_sheet, sheet_names
from swath.record.digest import Digest
from swath.record.read.feed import exact_samples, exact_topic
from swath.record.read.files import open_log
from swath.runtime.assembly import assemble
from swath.runtime.job import run_job
from swath.scenario.scenario import load_scenario
from swath.sensing.lidar_sheet import load_lidar

NS = 1_000_000_000
SCANNERS = [name for name in sheet_names("sensors") if read_sheet("sensors", name).value("kind") == "lidar"]
ROWS = [(name, rate) for name in SCANNERS for rate in load_lidar(name).rates_hz]
QUICK = ("combine.lidar.level=profile", "combine.header.level=profile", "combine.edge.level=otsu")
ODD = (15, 29.97, 7, 0.3333333, 60, 300, 33.3, 1024)
WHOLE = (5, 12.5, 20, 25, 50, 100, 200, 62.5)


def begun(*sets):
    world = assemble(load_scenario(str(TEMPLATES["scenario"].path), sets=[f"combine.{s}" for s in sets]))
    world.graph.reset()
    return world


@pytest.mark.parametrize(("name", "rate"), ROWS)
def test_the_template_takes_each_scanner_at_each_of_its_rates(name, rate):
    world = begun(f"lidar.sensor={name}", f"lidar.rate_hz={rate}")
    world.graph.run(2 * round(1e9 / rate))
    assert world.graph.latest("combine.lidar", "scan").t > 0
    assert not any("not a rate" in note for note in world.leader.notes)


def test_a_rate_is_told_in_the_number_that_was_typed():
    [other] = [note for note in begun("lidar.rate_hz=30").leader.notes if "rate_hz" in note]
    assert other.startswith(
        "combine.lidar.rate_hz: 30 Hz is not a rate of the SICK LMS5xx HR, which has 25, "
    )
    assert not [note for note in begun("motion.rate_hz=300").leader.notes if "rate_hz" in note]


def test_a_sector_wider_than_the_view_is_cut_and_told():
    [note] = [n for n in begun("lidar.sensor=sick-ld-mrs").leader.notes if "sector_deg" in n]
    assert "sector_deg [-60, 60]" in note
    assert note.endswith("[-50, 35] is used")


class Times:
    """When each slot sent, and the times that its samples say."""

    def __init__(self):
        self.sent = {}

    def __call__(self, slot, t, outputs):
        self.sent.setdefault(slot, []).append(t)
        stamps = {s.t for s in outputs.values()}
        assert stamps <= {t} or slot.endswith(("edge", "lidar")), (slot, t, stamps)


def drawn(seed):
    """Rates and offsets for the slots of a quick world, some exact in 0.1 ms and some not."""
    draw = np.random.default_rng(seed)
    rates = {}
    for slot in ("motion", "header", "process", "lidar", "edge", "steer", "speed", "steering", "imu"):
        rate = float(draw.choice(ODD if draw.uniform() < 0.6 else WHOLE))
        if slot == "process":
            rate = rates["header"][0]
        rates[slot] = rate, round(int(draw.integers(2)) * draw.uniform(0.0, 900 / rate), 4)
    sets = [f"combine.{slot}.rate_hz={rate}" for slot, (rate, _) in rates.items()]
    sets += [f"combine.{slot}.offset_ms={offset}" for slot, (_, offset) in rates.items()]
    latched = f"combine.{draw.choice(['edge', 'steer'])}.latch=true"
    return rates, [*QUICK, *sets, *([latched] if seed % 3 == 2 else [])], draw


def world_of(sets):
    return assemble(load_scenario("straight", sets=[*sets, "run.max_duration_s=9"]))


def run(world, *beats, end=1.3):
    for until in (*np.cumsum(beats).tolist(), end):
        world.graph.run(round(until * NS))


@pytest.mark.parametrize("seed", range(4))
def test_samples_of_drawn_rates_are_sent_when_they_are_due(seed, monkeypatch):
    """Compiled and in Python, in beats of any length, saved and resumed, and in several worlds."""
    rates, sets, draw = drawn(seed)
    times, digest = Times(), Digest()
    world = world_of(sets)
    world.graph.observers = [times, digest]
    world.reset()
    run(world)
    for slot, (rate, offset) in rates.items():
        at = [round(offset * 1e6) + int(Fraction(n * NS) / Fraction(str(rate)) + Fraction(1, 2))
              for n in range(1, int(1.3 * rate) + 1)]  # fmt: skip
        assert times.sent[f"combine.{slot}"] == [0, *(t for t in at if t <= 1.3 * NS)], slot

    beats = draw.uniform(0.001, 0.2, 6)
    for by_python in (False, True):
        monkeypatch.setattr(swath.compiled, "IS_WALKED_BY_PYTHON", by_python)
        other, seen = world_of(sets), Digest()
        other.graph.observers = [seen]
        other.reset()
        run(other, *beats, end=float(beats.sum()))
        saved, kept = other.save(), seen.save()
        resumed, seen = world_of(sets), Digest()
        resumed.load(saved)
        seen.load(kept)
        resumed.graph.observers = [seen]
        run(resumed)
        assert seen.hex == digest.hex
    monkeypatch.setattr(swath.compiled, "IS_WALKED_BY_PYTHON", False)

    several, seen = [world_of(sets) for _ in range(3)], Digest()
    several[1].graph.observers = [seen]
    lockstep = Lockstep([w.graph for w in several])
    lockstep.reset()
    for until in (0.41, 1.3):
        assert not list(lockstep.advance(round(until * NS)))
    assert not lockstep.errors
    assert seen.hex == digest.hex


def test_a_scanner_of_15_hz_runs_beside_obstacles_and_others():
    """Obstacles go 50 times a second: what is due at one time is what is due there by its own rate."""
    world, times = assemble(load_scenario("person-at-edge", sets=["combine.lidar.rate_hz=15"])), Times()
    world.graph.observers = [times]
    world.reset()
    world.graph.run(NS)
    assert times.sent["combine.lidar"] == [(2 * n * NS + 15) // 30 for n in range(16)]
    (scene,) = [slot for slot in times.sent if slot.endswith("obstacles")]
    assert times.sent[scene] == [*range(0, NS + 1, 20_000_000)]


def test_a_recording_says_when_samples_were_sent(tmp_path):
    """Of a scanner of 15 Hz and steering of 29.97 Hz: exact samples and messages, to the nanosecond."""
    rates = {"lidar": ("scan", 15), "steer": ("command", 29.97), "motion": ("state", 300)}
    sets = [*(f"combine.{slot}.rate_hz={rate}" for slot, (_, rate) in rates.items()), "run.record=exact"]
    sets += [*QUICK, "combine.motion.start_speed_kmh=7", "run.max_duration_s=1"]
    run_job(load_scenario("straight", sets=sets), tmp_path / "out")
    log = open_log(tmp_path / "out" / "run.mcap")
    for slot, (output, rate) in rates.items():
        due = [int(Fraction(n * NS) / Fraction(str(rate)) + Fraction(1, 2)) for n in range(1, 310)]
        due = [0, *(t for t in due if t <= NS)]
        sent = exact_samples(log.messages((exact_topic(f"combine.{slot}", output),)))
        assert [t for t, _ in sent] == due, slot
        told = [t for _, t, _ in log.messages((f"/combine/{slot}/{output}",))]
        assert told
        assert set(told) <= set(due), slot
