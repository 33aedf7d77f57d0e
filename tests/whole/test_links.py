"""Links in folders lead nobody astray: what a command writes is new, what links lead to stays as it was."""

import os
import random

import pytest

from swath.commands.main import make_parser, subcommands
from swath.core.errors import InputError
from swath.core.files import place as places
from swath.core.files.place import move, own_folder, remove, remove_tree, within
from swath.core.files.whole_file import (
    PART,
    new_file,
    open_to_append,
    open_to_keep,
    open_to_write,
    write_whole,
)
from tests.whole.links import LONG, WRITES, Inputs, Place, Written, quietly

OTHERS = {
    "paper",  # starts commands of the lists, each with a folder of its own in --out
    "calibrate engine",  # one file, as `schema`, of a log that is long
}
NOTHING = {
    "scenarios", "docs", "levels", "metrics", "sheets", "field show", "fleet list", "test list",
    "test compare", "test levels", "odd check", "fmu show", "fmu check", "ros2 play", "can box", "can listen",
    "can dbc", "completion",
}  # fmt: skip


def test_every_command_is_looked_at():
    commands = {leaf.prog.removeprefix("swath ") for leaf in subcommands(make_parser()[0])}
    assert commands == {*WRITES, *LONG, *OTHERS, *NOTHING}


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    return Inputs(tmp_path_factory.mktemp("inputs"))


@pytest.mark.draws
@pytest.mark.parametrize("command", WRITES)
def test_links_in_the_places_of_what_is_written(command, inputs, tmp_path):
    """In all places of files a kind that is drawn, or in that of a folder; all: tests/whole/links.py."""
    written, rng = Written(command, tmp_path, inputs), random.Random(command)
    if written.folders and rng.random() < 0.4:
        written.attempt({rng.choice(written.folders): rng.choice(("symbolic", "dangling", "folder"))})
    else:
        written.attempt(written.in_all_files(rng))


@pytest.mark.parametrize("kind", ["symbolic", "hard", "dangling", "fifo"])
def test_a_lock_that_is_none_is_refused(kind, inputs, tmp_path):
    place = Place(tmp_path / "a", "run", inputs)
    lock = place.path / "new" / "run.lock"
    if kind == "fifo":
        os.mkfifo(lock)
    else:
        place.plant(lock, kind)
    assert place.run() == 2
    assert "expected a file" in quietly.said


def test_a_link_is_replaced_and_a_folder_refused(tmp_path):
    victim = tmp_path / "victim"
    victim.write_text("a")
    for name in ("x", f"x{PART}"):
        (tmp_path / name).symlink_to(victim)
    write_whole(tmp_path / "x", "b")
    assert (victim.read_text(), (tmp_path / "x").read_text(), (tmp_path / "x").is_symlink()) == (
        "a",
        "b",
        False,
    )
    (tmp_path / "y").symlink_to(tmp_path / "nowhere")
    with open_to_write(tmp_path / "y") as file:
        file.write(b"c")
    assert not (tmp_path / "nowhere").exists()
    (tmp_path / "l").symlink_to(victim)
    os.link(victim, tmp_path / "h")
    (tmp_path / "d").symlink_to(tmp_path)
    for act, name in ((open_to_append, "l"), (open_to_append, "h"), (own_folder, "d"), (own_folder, "l")):
        with pytest.raises(InputError, match="link"):
            act(tmp_path / name)
    with pytest.raises(InputError):
        open_to_keep(tmp_path / "l", os.O_RDWR)


ACTS = {
    "write": lambda inner: write_whole(inner / "x", "new"),
    "append": lambda inner: open_to_append(inner / "x").close(),
    "make": lambda inner: own_folder(inner / "new"),
    "remove": lambda inner: remove(inner / "thesis.txt"),
    "remove all": lambda inner: remove_tree(inner / "deeper"),
    "move": lambda inner: move(inner / "thesis.txt", inner / "moved"),
    "move here": lambda inner: move(inner.parents[1] / "mine", inner / "moved"),
}


@pytest.mark.parametrize("has_descriptors", [True, False])
@pytest.mark.parametrize("act", ACTS)
def test_a_folder_below_the_named_one_is_no_link(act, has_descriptors, tmp_path, monkeypatch):
    monkeypatch.setattr(places, "HAS_DESCRIPTORS", has_descriptors)
    home, real = tmp_path / "home", tmp_path / "real"
    (home / "deeper").mkdir(parents=True)
    real.mkdir()
    (real / "mine").write_text("mine")
    (home / "thesis.txt").write_text("years of work")
    (tmp_path / "out").symlink_to(real)  # the user named it: it may be a link
    (real / "a").symlink_to(home.parent)
    (real / "b").mkdir()
    (real / "b" / "c").symlink_to(home)
    before = sorted(home.rglob("*"))
    for inner in ("a/home", "b/c"):
        with within(tmp_path / "out"), pytest.raises(InputError, match="not a link to another one"):
            ACTS[act](tmp_path / "out" / inner)
    assert sorted(home.rglob("*")) == before
    assert (real / "mine").read_text() == "mine"
    with within(tmp_path / "out"):
        assert write_whole(tmp_path / "out" / "d" / "e" / "x", "new").read_text() == "new"
    assert (real / "d" / "e" / "x").is_file()
    with within(tmp_path / "out"), pytest.raises(InputError, match=r"without \.\."):
        write_whole(tmp_path / "out" / "d" / ".." / "x", "new")
    opened = [os.path.realpath(f"/dev/fd/{name}") for name in os.listdir("/dev/fd")]
    assert not [file for file in opened if file.startswith(str(tmp_path))]


def test_a_folder_that_becomes_a_link_while_a_file_is_written(tmp_path):
    (tmp_path / "home").mkdir()
    (tmp_path / "home" / "x").write_text("years of work")
    with within(tmp_path / "out"), new_file(tmp_path / "out" / "a" / "x") as file:
        file.write(b"new")
        (tmp_path / "out" / "a").rename(tmp_path / "out" / "before")
        (tmp_path / "out" / "a").symlink_to(tmp_path / "home")
    assert [f.read_text() for f in (tmp_path / "home").iterdir()] == ["years of work"]
    assert (tmp_path / "out" / "before" / "x").read_text() == "new"


def test_a_pipe_in_the_place_of_a_file_that_is_continued_is_refused_at_once(tmp_path):
    os.mkfifo(tmp_path / "x")
    with pytest.raises(InputError, match="expected a file"):
        open_to_append(tmp_path / "x")


@pytest.mark.parametrize(("mode", "is_used"), [(0o700, True), (0o755, True), (0o777, False), (0o1777, True)])
def test_a_cache_of_kernels_is_one_that_others_cannot_change(tmp_path, mode, is_used):
    from swath.kernels import _is_own, _is_usable

    (tmp_path / "cache").mkdir()
    (tmp_path / "cache").chmod(mode)
    assert _is_own(tmp_path / "cache") == is_used
    assert _is_usable(tmp_path / "cache" / "warp") == is_used


@pytest.mark.parametrize("planted", ["link", "open to all"])
def test_compiled_kernels_lie_where_nobody_else_can_write(planted, tmp_path, monkeypatch):
    import swath.kernels as kernels

    monkeypatch.setattr(kernels.tempfile, "tempdir", str(tmp_path))
    place = tmp_path / f"swath-warp-{os.getuid()}"
    assert kernels._own_temporary() == place
    place.rmdir()
    if planted == "link":
        (tmp_path / "theirs").mkdir()
        place.symlink_to(tmp_path / "theirs")
    else:
        place.mkdir()
        place.chmod(0o777)
    found = kernels._own_temporary()
    assert found != place
    assert found.stat().st_mode & 0o777 == 0o700
