"""Same scenario and seed: same digest, whatever the threads and however often it is saved and resumed."""

import json
import pickle

import pytest

import swath
from swath.core.schedule import NS
from swath.record.digest import Digest
from swath.runtime import loop
from swath.runtime.assembly import assemble
from swath.runtime.loop import drive
from swath.runtime.worlds import Worlds
from tests.proof.proof import CHEAP, KERNELS, judged
from tests.whole.small import small

SHORT = "run.distance_m=2.5"


def digest_of(*sets):
    digest = Digest()
    drive(assemble(small(SHORT, *sets)), [digest])
    return digest.hex


@pytest.fixture(scope="module")
def reference():
    return digest_of()


def test_one_and_two_threads_and_twice_in_a_row(reference, monkeypatch):
    for threads in ("1", "2"):
        monkeypatch.setenv("SWATH_THREADS", threads)
        assert digest_of() == reference


def test_another_seed_is_another_run(reference):
    assert digest_of("seed=4") != reference


def test_what_a_component_draws_does_not_depend_on_the_others(reference):
    """Turning the noise of one sensor off must not change the draws of another."""

    def odometry(*sets):
        seen = []
        drive(
            assemble(small("run.max_duration_s=0.2", *sets)),
            [lambda slot, t, out: seen.append(out) if slot == "combine.odometry" else None],
        )
        return [s["odometry"].yaw_rate for s in seen]

    assert odometry() == odometry("combine.lidar.noise=none")


@pytest.mark.parametrize("middle_s", [0.0, 0.735])
def test_saved_in_the_middle_and_resumed_elsewhere(reference, middle_s):
    digest = Digest()
    world = assemble(small(SHORT))
    drive(world, [digest], until_s=middle_s)
    state = pickle.dumps({"world": world.save(), "digest": digest.save()})
    drive(world, [digest], resume=True)  # the first world goes on; what was saved must not notice
    assert digest.hex == reference

    saved, fresh, second = pickle.loads(state), assemble(small(SHORT)), Digest()
    fresh.load(saved["world"])
    second.load(saved["digest"])
    drive(fresh, [second], resume=True)
    assert second.hex == reference


def test_the_level_empirical_is_as_repeatable(monkeypatch):
    sets = ("combine.lidar.level=empirical", "run.max_duration_s=1.2")
    found = set()
    for threads in ("1", "2"):
        monkeypatch.setenv("SWATH_THREADS", threads)
        found.add(digest_of(*sets))
    assert len(found) == 1


@pytest.mark.parametrize(
    ("sets", "many"),
    [
        ({**KERNELS, "run.distance_m": 13, "run.max_duration_s": 8}, 0),
        ({**CHEAP, "run.max_duration_s": 0.6}, 16),
    ],
    ids=["judged", "as shipped"],
)
def test_looks_saves_and_company_change_nothing(sets, many, monkeypatch):
    """Observers look every so often; a run is saved between two looks and resumed, or is one of many."""

    def world(seed=5):
        return assemble(swath.load_scenario("straight", sets=sets, seed=seed))

    summaries, digests = set(), set()
    for look, count in ((0.1, many), (0.25, 0), (1.0, 0)):
        for name in ("BEAT", "LONG_BEAT"):
            monkeypatch.setattr(loop, name, round(look * NS))
        for seeds in ([5], [6, 5] * (count // 2)):
            ended = Worlds([world(seed) for seed in seeds]).drive() if seeds else ()
            found = [summary for k, summary in ended if seeds[k] == 5]
            summaries |= {json.dumps(judged(summary)) for summary in found}
            digests |= {summary["digest"] for summary in found}
        first, second, parted, again = world(), world(), Digest(), Digest()
        drive(first, [parted], until_s=0.37)
        second.load(first.save())
        again.load(parted.save())
        for resumed, digest in ((first, parted), (second, again)):
            drive(resumed, [digest], resume=True)
            digests.add(digest.hex)
    assert len(summaries) == len(digests) == 1
