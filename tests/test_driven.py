"""Runs that tests share: driven once, read by all, written into by none."""

import shutil

import pytest

from tests.driven import Driven

SMALL = ("run.distance_m=1", "combine.lidar=off", "combine.edge=truth")


def test_it_is_driven_once_and_who_writes_into_it_fails(driven, tmp_path):
    folder = driven("straight", *SMALL)
    assert (folder / "summary.json").exists()
    assert driven("straight", *SMALL) == folder
    other = Driven(tmp_path / "other")
    other.home.mkdir()
    shutil.copytree(folder, other.home / folder.name)  # as another worker has driven it
    held = other("straight", *SMALL)
    assert held == other.home / folder.name
    other.check()
    (held / "summary.json").write_text("{}")
    with pytest.raises(AssertionError, match="is shared"):
        other.check()
