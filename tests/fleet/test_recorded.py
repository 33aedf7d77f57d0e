"""A recorded day: the rest of it from its first hour, and what a log must hold for that."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from benchmarks.recorded_day import TURN_SPEED, check_one_machine, main, predict, read_day

from swath.control.turns import limits_of
from swath.core.errors import InputError
from tests.shared_data import DATA

LOG = DATA / "wheat_combine_logs_msu" / "si" / "farmerB_sec1west_2014_winterwheat.csv.gz"
LIMITS = limits_of(3.9, 6.4, math.radians(15.0), TURN_SPEED)


@pytest.mark.skipif(not LOG.exists(), reason="needs the Montana yield logs: SWATH_DATA")
def test_the_first_day_of_2014_is_predicted_from_its_first_hour():
    day = read_day(LOG, LIMITS)
    made = predict(day, 3600.0)
    assert made.total_recorded == pytest.approx(8.20 * 3600.0, abs=36.0)
    assert made.cutting == pytest.approx(made.cutting_recorded, rel=0.10)
    assert made.turning == pytest.approx(made.turning_recorded, rel=0.10)
    assert made.total == pytest.approx(made.total_recorded, rel=0.10)


def log_of(tmp_path, *, gap_in_turns=0.0):
    """A log of passes of 200 m, 8 m apart, with turns of 20 s; a record a second.

    gap_in_turns: share of a turn's records that is left out
    """
    rows, t, x0, y0 = ["time,lat,lon,flow,width,speed"], 0, 46.0, 11.0

    def add(x, y, flow):
        rows.append(f"{t},{x0 + y / 111_200:.8f},{y0 + x / 77_300:.8f},{flow},8,2")

    for n in range(12):
        there = n % 2 == 0
        for i in range(101):
            add(2.0 * i if there else 200.0 - 2.0 * i, 8.0 * n, 8.0)
            t += 1
        for i in range(1, 20):
            a = math.pi * i / 20
            if i > (1.0 - gap_in_turns) * 20:
                t += 1
                continue
            far = 12.0 * math.sin(a)
            add(200.0 + far if there else -far, 8.0 * n + 4.0 - 4.0 * math.cos(a), 0.0)
            t += 1
    file = tmp_path / "log.csv"
    file.write_text("\n".join(rows) + "\n")
    return file


def test_turns_are_predicted_where_the_log_goes_on_in_them(tmp_path):
    made = predict(read_day(log_of(tmp_path), LIMITS), 600.0)
    assert made.turning == pytest.approx(made.turning_recorded, rel=0.05)


def test_a_log_that_stops_in_turns_says_so_and_predicts_the_passes_alone(tmp_path):
    day = read_day(log_of(tmp_path, gap_in_turns=1.0), LIMITS)
    made = predict(day, 600.0)
    assert "does not go on in turns" in day.unseen
    assert math.isnan(made.turning)
    assert made.cutting == pytest.approx(made.cutting_recorded, rel=0.02)


@pytest.mark.parametrize(("gap", "told"), [(0.0, False), (1.0, True)])
def test_what_is_predicted_is_printed_and_why_what_is_not(capsys, tmp_path, gap, told):
    main([str(log_of(tmp_path, gap_in_turns=gap)), "--known-h", "0.17"])
    said = capsys.readouterr().out
    assert "12 passes" in said
    assert ("time between passes is not predicted" in " ".join(said.split())) == told


def test_records_of_two_machines_as_one_are_refused():
    """Places that lie in two lines 300 m apart by turns, a second from one to the next."""
    t = np.arange(400.0)
    place = np.column_stack([2.0 * t, np.where(t % 2 > 0, 300.0, 0.0)])
    with pytest.raises(InputError, match="records of one machine, places jump 399 times, by 300 m"):
        check_one_machine(SimpleNamespace(time=t, position=place))
