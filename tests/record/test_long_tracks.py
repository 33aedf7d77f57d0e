"""Tracks of a long run: written, read and thinned in memory that does not grow with their length."""

import re
import subprocess
import sys
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from swath.core.blocks import Seen
from swath.judge.evaluator import KeptRows
from swath.record.tracks import PIECE, SHOWN_ROWS, Column, EvenRows, Tracks, read_tracks, track_pieces
from swath.record.tracks import write_tracks as write
from swath.signals import MachineState
from tests.fake_run import ArcEdge, machine

ROOT = Path(__file__).parents[2]
MIB = 1 << 20
GROWS_MIB = 3.0  # what a run four times as long may take more: less than one of its columns


def tracks_of(rows):
    """Of a machine that goes straight on."""
    doubled = Column("later", "m", "twice x_m", later=lambda columns: 2.0 * columns["x_m"])
    tracks, edge = Tracks(machine(edge=ArcEdge()), 1, (doubled,)), ArcEdge()
    poses = [edge.pose(float(s)) for s in range(64)]
    for t in range(rows):
        state = MachineState(t, poses[t % 64], 1.0, 0.0, 0.0, 0.0, float(t))
        tracks.take(Seen.of_one("combine.motion", t, {"state": state}))
    return tracks


def peak_mib(action):
    tracemalloc.start()
    try:
        action()
        return tracemalloc.get_traced_memory()[1] / MIB
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("seed", range(20))
def test_even_rows_are_every_second_fourth_row_and_the_last(seed):
    rng = np.random.default_rng(seed)
    most = None if seed % 10 == 0 else int(rng.integers(2, 60))
    rows, begin = EvenRows(most), 0
    assert rows.columns() == {}
    for count in [int(seed > 5), *rng.integers(0, 40, rng.integers(0, 30))]:
        rows.add({"a": np.arange(begin, begin + count), "b": np.ones((count, 2))})
        begin += count
    assert rows.row_count == begin
    if not begin:
        return
    every = 1
    while most is not None and -(-begin // every) > most:
        every *= 2
    wanted = np.unique([*range(0, begin, every), begin - 1])
    found = rows.columns()
    assert found["a"].tolist() == wanted.tolist()
    assert found["b"].shape == (len(wanted), 2)


def test_pieces_and_single_columns_are_those_of_the_whole_table(tmp_path):
    tracks = tracks_of(PIECE + 1000)
    write(tmp_path / "tracks.parquet", [tracks])
    whole, read = tracks.arrays(), read_tracks(tmp_path / "tracks.parquet")
    pieces = list(track_pieces(tmp_path / "tracks.parquet"))
    assert [len(piece["t_s"]) for piece in pieces] == [PIECE, 1000]
    assert len(whole["t_s"]) == tracks.row_count == PIECE + 1000
    assert set(whole) == set(tracks) == set(read) - {"machine"}
    for name, values in whole.items():
        joined = np.concatenate([piece[name] for piece in pieces])
        for other in (read[name], joined, tracks[name]):
            np.testing.assert_array_equal(other, values)
    shown = tracks.arrays(most=SHOWN_ROWS)
    assert len(shown["t_s"]) == (PIECE + 1000 + 1) // 2 + 1
    np.testing.assert_array_equal(shown["later"], 2.0 * shown["x_m"])
    with pytest.raises(KeyError):
        tracks["none"]


@pytest.mark.skipif(sys.platform != "linux", reason="needs limits of files")
def test_tracks_that_do_not_fit_name_their_file_and_leave_nothing(tmp_path):
    code = (
        "import resource, sys\n"
        "from pathlib import Path\n"
        "from tests.record.test_long_tracks import tracks_of, write\n"
        "tracks = tracks_of(3000)\n"
        "tracks.arrays()  # they lie in a file of their own now\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))\n"
        "try: write(Path(sys.argv[1]), [tracks])\n"
        "except OSError as error: print(error)\n"
    )
    made = [sys.executable, "-c", code, str(tmp_path / "tracks.parquet")]
    told = subprocess.run(made, capture_output=True, text=True, check=True, cwd=ROOT)
    assert re.search(r"File too large: '.*tracks\.parquet", told.stdout), told.stderr
    assert not list(tmp_path.iterdir())


@pytest.mark.draws
@pytest.mark.parametrize("use", ["write", "show", "read"])
def test_four_times_the_rows_take_no_more_memory(tmp_path, use):
    peaks, whole = [], []
    for rows in (2 * PIECE, 8 * PIECE):
        tracks, path = tracks_of(rows), tmp_path / f"{rows}.parquet"
        write(path, [tracks])
        whole.append(peak_mib(tracks.arrays))
        action = {
            "write": lambda path=path, tracks=tracks: write(path, [tracks]),
            "show": lambda tracks=tracks: tracks.arrays(most=SHOWN_ROWS),
            "read": lambda path=path: [len(piece) for piece in track_pieces(path)],
        }[use]
        peaks.append(peak_mib(action))
    assert whole[1] - whole[0] > 10 * GROWS_MIB  # all rows at once do
    assert peaks[1] - peaks[0] < GROWS_MIB


def test_the_series_of_a_page_takes_no_more_memory_of_more_rows():
    peaks = []
    for blocks in (40, 160):
        rows = KeptRows(10)
        for block in range(blocks):
            rows.add((np.arange(10_000.0) + 10_000 * block).tolist())
        peaks.append(peak_mib(lambda rows=rows: rows.table(SHOWN_ROWS)))
        assert rows.table(SHOWN_ROWS)[-1, -1] == 10_000 * blocks - 1
        assert np.array_equal(rows.table().ravel(), np.arange(10_000.0 * blocks))
    assert peaks[1] - peaks[0] < GROWS_MIB
