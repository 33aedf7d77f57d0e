"""Faults between a part and its readers: values, holds, losses and lateness against counts by hand."""

from dataclasses import replace

import numpy as np
import pytest

from swath.core.component import Port
from swath.core.errors import InputError
from swath.core.fault import Fault, FaultyOutput
from swath.core.random import Stream
from swath.core.schedule import NS
from swath.signals import CropEdge, Scan

NONE = Fault(
    scale={}, bias={}, noise={}, stuck={}, beam_loss=0, dead_beams=0, hold=[], silent=[], loss=0, burst=0,
    latency=0,
)  # fmt: skip
STEP = 40_000_000
EDGE = CropEdge(0, 1.0, 0.1, 0.0, 8.0, 0.9, 0.7, 0.15)


def sent(count=101, port=None, sample=EDGE, **fault):
    """(time [ns], outputs) of every step of a slot with a fault."""
    faulty = FaultyOutput(replace(NONE, **fault), [port or Port("edge", type(sample))])
    faulty.reset(Stream(5, "combine.edge"))
    name = port.name if port else "edge"
    return [(k * STEP, faulty.pass_on(k * STEP, {name: replace(sample, t=k * STEP)})) for k in range(count)]


def test_values_are_wrong_by_what_is_said_in_the_units_of_the_keys():
    wrong = sent(2, scale={"offset": -1.0}, bias={"heading_deg": 2.0, "offset_cm": 5.0},
                 stuck={"confidence": 1.0})[1][1]["edge"]  # fmt: skip
    assert wrong.offset == pytest.approx(-0.95)
    assert wrong.heading == pytest.approx(0.1 + np.radians(2.0))
    assert wrong.confidence == 1.0
    assert (wrong.curvature, wrong.is_held) == (EDGE.curvature, EDGE.is_held)


def test_noise_has_its_standard_deviation_and_no_mean():
    offsets = np.array([out["edge"].offset for _, out in sent(2000, noise={"offset_cm": 3.0})])
    assert np.std(offsets) == pytest.approx(0.03, rel=0.08)  # 5 standard errors
    assert np.mean(offsets) == pytest.approx(1.0, abs=0.0035)


def test_a_late_sample_keeps_its_time_and_leaves_at_the_next_step():
    late = sent(20, latency=0.1)  # 2.5 steps: three
    times = [(t, out["edge"].t) for t, out in late if out]
    assert times[0] == (0, 0)
    assert all(t - of == 3 * STEP for t, of in times[1:])
    assert len(times) == 17


def test_a_held_sample_is_stamped_anew_and_a_silent_slot_sends_nothing():
    faulty = FaultyOutput(replace(NONE, hold=[(0.4, 0.8)], silent=[(1.0, 1.2)]), [Port("edge", CropEdge)])
    faulty.reset(Stream(5, "combine.edge"))
    out = {t: faulty.pass_on(t, {"edge": replace(EDGE, t=t, offset=t / NS)}) for t in range(0, 2 * NS, STEP)}
    held = [t for t, o in out.items() if o and o["edge"].offset != t / NS]
    assert held == list(range(400_000_000, 800_000_000, STEP))
    assert all(out[t]["edge"].t == t and out[t]["edge"].offset == 0.36 for t in held)
    assert [t for t, o in out.items() if not o] == list(range(NS, 1_200_000_000, STEP))


def test_bursts_lose_the_same_share_in_longer_pieces():
    def runs(burst):
        lost = np.array([not out for _, out in sent(10_001, loss=0.2, burst=burst)])
        pieces = np.diff(np.flatnonzero(np.diff(np.r_[0, lost.astype(int), 0])))[::2]
        return lost.mean(), pieces.mean()

    (alone, short), (bursts, long) = runs(0.0), runs(0.4)
    assert alone == pytest.approx(0.2, abs=0.02)
    assert bursts == pytest.approx(0.2, abs=0.06)  # a tenth of the draws
    assert short == pytest.approx(1.25, abs=0.08)  # geometric: 1 / (1 - 0.2)
    assert long == pytest.approx(12.5, rel=0.15)


def test_beams_are_lost_in_ranges_and_intensities_alike():
    count = 1000
    scan = Scan(0, *np.zeros((3, count)), *np.ones((2, count, 1), dtype=np.float32))
    port = Port("scan", Scan, unit="m", shape=(count,))
    scans = [out["scan"] for _, out in sent(3, port, scan, beam_loss=0.3, dead_beams=0.2)[1:]]
    lost = [np.isnan(s.ranges[:, 0]) for s in scans]
    assert all((np.isnan(s.intensity[:, 0]) == gone).all() for s, gone in zip(scans, lost, strict=True))
    assert lost[0].mean() == pytest.approx(1 - 0.8 * 0.7, abs=0.05)
    assert (lost[0] & lost[1]).mean() == pytest.approx(0.2 + 0.8 * 0.09, abs=0.05)
    assert scans[0].ranges.dtype == np.float32


def test_a_saved_fault_goes_on_as_if_nothing_had_been():
    fault = replace(NONE, latency=0.2, loss=0.3, noise={"offset_m": 0.1}, hold=[(1.0, 1.2)])

    def offsets(broken_at):
        faulty, found = FaultyOutput(fault, [Port("edge", CropEdge)]), []
        faulty.reset(Stream(2, "e"))
        for k in range(60):
            if k == broken_at:
                state, faulty = faulty.save(), FaultyOutput(fault, [Port("edge", CropEdge)])
                faulty.reset(Stream(2, "e"))
                faulty.load(state)
            out = faulty.pass_on(k * STEP, {"edge": replace(EDGE, t=k * STEP)})
            found += [(k, sample.t, sample.offset) for sample in out.values()]
        return found

    assert offsets(27) == offsets(None)


@pytest.mark.parametrize(
    ("fault", "key"),
    [({"bias": {"ofset_m": 1.0}}, "fault.bias.ofset_m"), ({"bias": {"offset": 1.0}}, "fault.bias.offset"),
     ({"beam_loss": 0.1}, "fault.beam_loss_percent")],
)  # fmt: skip
def test_a_field_that_is_not_sent_is_refused(fault, key):
    with pytest.raises(InputError, match=key.replace(".", r"\.")) as found:
        sent(1, **fault)
    assert "expected a" in found.value.expected
