"""What a paced run puts off: samples wait a little, and come out as if they had not."""

from swath.core.schedule import NS
from swath.record.recorder import Recorder
from tests.fake_run import ArcEdge, GridField, drive, machine


def record(folder, seconds, *also, defer=True, tap=None):
    """The recorder of a run, closed. also: observers before it"""
    folder.mkdir()
    with Recorder(folder, [machine()]) as recorder:
        if tap is not None:
            recorder.file.taps.append(tap)
        if defer:
            recorder.defer()
        drive([*(make(recorder) for make in also), recorder], GridField(ArcEdge(40.0)), seconds=seconds)
    return recorder


def test_what_is_deferred_waits_to_be_written_but_not_long(tmp_path):
    count = []

    def look(recorder):
        return lambda slot, t, _: count.append((t, recorder.file.count))

    late = record(tmp_path / "late", 0.3, look)
    assert all(n == 0 for t, n in count if t < NS // 20)
    assert 0 < count[-1][1] < 0.9 * late.file.count
    record(tmp_path / "once", 0.3, defer=False)
    assert (tmp_path / "late" / "run.mcap").read_bytes() == (tmp_path / "once" / "run.mcap").read_bytes()


def test_taps_hear_the_same_later_in_the_same_order_but_at_most_20_ms(tmp_path):
    now, late, once = [0], [], []

    def look(recorder):
        return lambda slot, t, _: now.__setitem__(0, t)

    def hear(topic, t, data, *_):
        late.append((now[0], topic, t, bytes(data)))

    record(tmp_path / "late", 0.5, look, tap=hear)
    record(tmp_path / "once", 0.5, defer=False, tap=lambda topic, t, data, *_: once.append((topic, t, data)))
    assert [heard[1:] for heard in late] == once
    waited = [when - t for when, _, t, _ in late if when < NS // 2]
    assert 0 < max(waited) <= NS // 50
    assert sum(w > 0 for w in waited) > 0.8 * len(waited)


def test_all_that_waits_is_written_where_that_is_asked_for(tmp_path):
    heard, counts = [], []

    def look(recorder):
        def ask(slot, t, outputs):
            recorder.write_waiting()
            counts.append((len(heard), recorder.write_next()))

        return ask

    record(tmp_path / "run", 0.1, look, tap=lambda *message: heard.append(message))
    assert counts[1][0] > 0
    assert not any(left for _, left in counts)
