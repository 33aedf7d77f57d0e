"""Runs in step with a clock: results stay, unless a cheaper level takes over, which is reported."""

import json

import pytest

from swath.commands.main import main
from swath.core.errors import InputError
from swath.record.digest import Digest
from swath.runtime.assembly import assemble
from swath.runtime.loop import drive
from swath.runtime.pacing import make_pacer, paced
from tests.fake_clock import FakeClock
from tests.whole.small import small

MS = 1_000_000
CHEAP = "realtime.degrade=[{slot: combine.lidar, level: empirical}, {slot: combine.edge, level: truth}]"


def digest_of(*sets, clock=None):
    world, digest = assemble(small("run.max_duration_s=1.5", "combine.lidar.sub_rays=1", *sets)), Digest()
    pacer = make_pacer(world, clock=clock)
    with paced(world.graph, pacer):
        drive(world, [digest])
    return digest.hex, pacer, world


def test_the_clock_changes_no_result_unless_a_level_is_exchanged():
    plain, none, _ = digest_of()
    assert none is None
    swift, pacer, world = digest_of("realtime.pace=real_time", clock=FakeClock())
    assert swift == plain
    assert pacer.report()["max_late_ms"] == 0.0
    assert not world.field.prepare()  # all was made in the time left

    slow = FakeClock()
    slow.work = 8 * MS
    slipped, pacer, world = digest_of("realtime.pace=real_time", "realtime.grace_s=0", clock=slow)
    assert slipped == plain
    assert pacer.overruns.total() > 10
    assert pacer not in world.graph.before_tick

    dear = FakeClock()
    dear.work = 8 * MS
    sets = ["realtime.on_overrun=degrade", "realtime.grace_s=0", CHEAP]
    changed, pacer, world = digest_of(*sets, clock=dear)
    assert changed != plain
    done = pacer.report()["degraded"]
    assert [(d["slot"], d["from"], d["to"]) for d in done] == [
        ("combine.lidar", "plants", "empirical"),
        ("combine.edge", "likelihood_ratio", "truth"),
    ]
    leader = world.leader
    assert type(leader.parts["lidar"]).__name__ == "EmpiricalLidar"
    assert type(leader.retired[0]).__name__ == "PlantsLidar"
    before = leader.retired[0].ray_count
    assert leader.ray_count == before + leader.parts["lidar"].ray_count > before > 0
    assert world.graph.latest("combine.lidar", "scan").t > done[0]["t_s"] * 1e9
    assert digest_of(*sets, clock=_like(dear))[0] == changed


def _like(clock):
    again = FakeClock()
    again.work = clock.work
    return again


@pytest.mark.parametrize(
    ("setting", "said"),
    [
        ("realtime.on_overrun=degrade", r"realtime.on_overrun = degrade: expected a list"),
        ("realtime.degrade=[{slot: combine.motion, level: kinematic}]", r"degrade.0.slot = combine.motion"),
        ("realtime.degrade=[{slot: cart.lidar, level: empirical}]", r"degrade.0.slot = cart.lidar"),
        ("realtime.degrade=[{slot: combine.lidar}]", r"degrade.0.level: expected a level"),
        ("realtime.degrade=[{slot: combine.lidar, level: emprical}]", r"did you mean 'empirical'"),
        ("realtime.degrade=[{slot: combine.lidar, level: empirical, sub_rays: 3}]", r"sub_rays: unknown key"),
        ("realtime.factor=0", r"realtime.factor = 0: expected"),
        ("realtime.speed=1", r"realtime.speed: unknown key"),
    ],
)
def test_bad_sections_are_refused(setting, said):
    with pytest.raises(InputError, match=said):
        small(setting)


def test_the_section_is_written_only_where_it_is_and_reads_back():
    from swath.scenario.scenario import parse_scenario

    assert "realtime" not in small().plain()
    scenario = small(CHEAP, "realtime.pace=free")
    assert not scenario.is_paced
    kept = dict(scenario.realtime.cheaper)["combine.lidar"].params
    assert kept.sector_deg == (-40, 40)
    assert parse_scenario(scenario.resolved()) == scenario


def test_a_paced_run_reports_itself(tmp_path, capsys):
    file = tmp_path / "s.yaml"
    file.write_text(small("run.max_duration_s=1").resolved())
    sets = ["--set", "realtime.factor=50", "--set", "combine.lidar=off", "--set", "combine.edge=truth"]
    assert (
        main(
            [
                "run",
                str(file),
                "--real-time",
                "--no-report",
                "--no-replay",
                "--out",
                str(tmp_path / "out"),
                *sets,
            ]
        )
        == 0
    )
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["realtime"]["ticks"] == 200
    assert summary["realtime"]["factor"] == 50.0
    assert "note    real time: latest tick" in capsys.readouterr().out


def test_outputs_write_their_blocks_in_different_ticks(tmp_path):
    """Samples of half a second share a block; a tick that wrote those of all outputs would be late."""
    from collections import Counter

    from mcap.reader import make_reader

    from swath.record.samples import SUFFIX
    from swath.runtime.job import run_job

    run_job(small("run.max_duration_s=3", "combine.lidar=off", "combine.edge=truth"), tmp_path / "run")
    with (tmp_path / "run" / "run.mcap").open("rb") as file:
        found = [(c.topic, m.log_time) for _, c, m in make_reader(file).iter_messages()]
    blocks = [(topic, t) for topic, t in found if topic.endswith(SUFFIX) and t < found[-1][1] - 50_000_000]
    outputs = len({topic for topic, _ in blocks})
    together = Counter(t // 20_000_000 for _, t in blocks)
    assert outputs >= 6
    assert max(together.values()) <= outputs // 2


def test_garbage_collection_leaves_out_what_was_assembled_and_goes_in_small_parts():
    import gc

    world, usual = assemble(small("realtime.pace=real_time")), gc.get_threshold()
    gc.set_threshold(500_000, 20, 100)
    try:
        before, pacer = gc.get_freeze_count(), make_pacer(world, clock=FakeClock())
        with paced(world.graph, pacer):
            begun = gc.get_freeze_count()
            assert begun > before + 10_000
            assert gc.get_threshold()[0] < 10_000
            loaded = [[] for _ in range(5000)]
            drive(world, until_s=1.1)
            assert gc.get_freeze_count() >= begun + len(loaded)  # the grace is over
        assert gc.get_freeze_count() == 0
        assert gc.get_threshold() == (500_000, 20, 100)
    finally:
        gc.set_threshold(*usual)


def test_a_paced_run_records_between_its_ticks_what_any_other_records(tmp_path):
    """Messages and samples, in the same order; also where there is no time left between two ticks."""
    from mcap.reader import make_reader

    from swath.runtime.job import run_job

    def recorded(name, *sets):
        run_job(small("run.max_duration_s=1.2", "combine.lidar.sub_rays=1", *sets), tmp_path / name)
        with (tmp_path / name / "run.mcap").open("rb") as file:
            return [(c.topic, m.log_time, m.data) for _, c, m in make_reader(file).iter_messages()]

    plain = recorded("free")
    assert {topic for topic, _, _ in plain} >= {"/clock", "/combine/lidar/scan", "/combine/lidar/scan_exact"}
    for factor in (2, 50):
        paced_run = recorded(f"x{factor}", "realtime.pace=real_time", f"realtime.factor={factor}")
        assert paced_run == plain
    tables = [(tmp_path / name / "tracks.parquet").read_bytes() for name in ("free", "x2", "x50")]
    assert tables[0] == tables[1] == tables[2]
