"""Same scenario and seed: same digest, whatever the threads and however often it is saved and resumed."""

import pickle

import pytest

from swath.record.digest import Digest
from swath.runtime.assembly import assemble
from swath.runtime.loop import drive
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
    monkeypatch.setenv("SWATH_THREADS", "1")
    reference = digest_of(*sets)
    monkeypatch.setenv("SWATH_THREADS", "2")
    assert digest_of(*sets) == reference
    digest, world = Digest(), assemble(small(SHORT, *sets))
    drive(world, [digest], until_s=0.735)
    state = pickle.loads(pickle.dumps({"world": world.save(), "digest": digest.save()}))
    fresh, second = assemble(small(SHORT, *sets)), Digest()
    fresh.load(state["world"])
    second.load(state["digest"])
    drive(fresh, [second], resume=True)
    assert second.hex == reference
