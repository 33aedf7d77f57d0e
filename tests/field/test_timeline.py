"""Sources, parts and times of a log that say one thing twice: what counts, what is told, what is refused."""

import numpy as np
import pytest

pytest.importorskip("scipy")

from swath.core.errors import InputError
from swath.documents.reasons import doubts
from swath.field_io.delay import estimate_delays
from swath.field_io.logs.log import first_loss, read_log
from swath.field_io.logs.sources import choose
from tests.field.drawn_logs import draw
from tests.field.unit_logs import Harvest, table


def columns(h):
    places = h.places(("lat", "lon"))
    return {
        **places,
        "time_s": h.t,
        "width_m": 9.0 * h.one,
        "grain_flow_kg_s": h.flow,
        "moisture_pct": 14.0 * h.one,
    }


def grown(log):
    """Yield in the mean [kg/m2]."""
    return float(np.mean((log.flow / (log.width * log.speed))[log.speed > 0.5]))


def thinned(c):
    return {k: v[::5] for k, v in c.items()}


def restarted(c):
    half = len(c["time_s"]) // 2
    return {**c, "time_s": np.r_[c["time_s"][:half], c["time_s"][half:] - c["time_s"][half]]}


@pytest.mark.parametrize(
    ("change", "key"),
    [
        (lambda c: {**c, "duration_s": 1.0 + 0.0 * c["time_s"]}, ""),
        (thinned, "timeline"),
        (restarted, "timeline"),
    ],
)
def test_two_witnesses_of_time_win_and_the_third_is_named(tmp_path, change, key):
    h = Harvest()
    whole = columns(h)
    made = change({**whole, "duration_s": h.one} if change is thinned else whole)
    log = read_log(table(tmp_path / "log.csv", made))
    plain = read_log(table(tmp_path / "plain.csv", whole))
    assert grown(log) == pytest.approx(grown(plain), rel=0.02)
    assert doubts(log.notes) == [key] * bool(key)


def test_equal_sources_count_once_and_others_are_refused_with_both(tmp_path):
    h = Harvest()
    for factor, key in ((1.0, "copies"), (1.5, "")):
        path = table(tmp_path / "log.csv", {**columns(h), "swath_m": 9.0 * factor * h.one})
        if key:
            assert any(note.startswith(f"{key}: header_width") for note in read_log(path).notes)
        else:
            with pytest.raises(InputError, match=r"sources = .*header_width: .column: .*or header_width"):
                read_log(path)


def test_the_more_complete_source_counts():
    full, part = np.ones(200), np.where(np.arange(200) < 50, 2.0, np.nan)
    made = choose("width", {"a": part, "b": full}, str)
    assert (made.name, made.notes[0].partition(":")[0]) == ("b", "sources")


def test_a_loss_is_told_of_the_first_stage_that_takes_most():
    assert first_loss({"copied": 10, "no_width": 80, "no_pass": 10}, 100)[0] == "no_width"


@pytest.mark.parametrize("seed", [1008, 1013])
def test_a_work_state_does_not_take_the_flow_of_the_turns(seed, tmp_path):
    made = draw(seed, has_work_state=True)
    for delay in estimate_delays(read_log(made.write(tmp_path / "log.csv"))):
        assert abs(delay.seconds - made.delays[delay.machine]) < 0.6 or not np.isfinite(delay.seconds)
