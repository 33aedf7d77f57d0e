"""The quick ones of the attacks: refused or read within seconds, and nothing acts."""

import signal
from contextlib import contextmanager

import pytest

from swath.core.errors import InputError
from tests.fuzz.attack import ACTED, REFUSED
from tests.fuzz.attacks import ATTACKS, OWN
from tests.fuzz.command_kinds import run

pytestmark = pytest.mark.apart

for extra in ("rasterio", "trimesh", "asammdf", "can", "fmpy", "rosbags"):
    pytest.importorskip(extra)
QUICK = [name for name, attack in ATTACKS.items() if attack.is_quick]


@contextmanager
def within(seconds):
    """Fails where the block takes longer, whoever catches what ends it."""
    late = []

    def ends(number, frame):
        late.append(number)
        raise TimeoutError

    before = signal.signal(signal.SIGALRM, ends)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)
    assert not late


@pytest.mark.draws
@pytest.mark.filterwarnings("ignore")  # of libraries
@pytest.mark.parametrize("name", QUICK)
def test_nothing_acts(tmp_path, name):
    attack, folder = ATTACKS[name], tmp_path / "above" / "here"
    folder.mkdir(parents=True)
    attack.make(folder)
    before = set(tmp_path.rglob("*"))
    with within(60):
        try:
            run(folder, ("\n".join(attack.command) + "\n").encode())
        except InputError:
            assert REFUSED in attack.codes
    new = [p.relative_to(tmp_path / "above").as_posix() for p in set(tmp_path.rglob("*")) - before]
    assert [name for name in new if ACTED in name or not OWN.match(name)] == []


def test_there_are_attacks_of_every_kind():
    tries = [attack.tries for attack in ATTACKS.values()]
    assert len(ATTACKS) > 200
    for aim in (
        "code of the file runs",
        "memory",
        "never end",
        "time",
        "connect",
        "write elsewhere",
        "read a file elsewhere",
    ):
        assert sum(aim in text for text in tries) > 1, aim
