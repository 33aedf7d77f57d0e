"""A sample type that is only declared goes everywhere: recording, playback, FMUs, ROS 2, tracks and docs."""

import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Annotated

import numpy as np
import pytest
from docs.make.signals import messages_table, signals_page
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from numpy.typing import NDArray

from swath.core.component import Port
from swath.core.frozen import frozen
from swath.core.random import Stream
from swath.core.signal import About, Quantity, Signal
from swath.link.fmi.description import Description, Variable
from swath.link.fmi.units import parse_unit
from swath.link.fmi.wiring import make_wiring
from swath.link.levels.fmu import samples_of
from swath.link.levels.log import LogPlayer, Params
from swath.link.ros2.slotnode import numbers_of, sample_of
from swath.record.digest import Digest
from swath.record.recorder import Recorder
from swath.record.tracks import read_tracks
from swath.signals import F64, Mask
from swath.signals.setup import ControlSetup, LinkSetup
from tests.fake_run import GEOMETRY, ArcEdge, GridField, drive, machine
from tests.record.test_exact_samples import same_bits

NS = 1_000_000_000


@frozen
class ProbedMoisture(Signal, about=About("sensor")):
    """Water in the grain."""

    share: Annotated[float, Quantity("", "of the wet mass", nan="no grain", column="moisture_share")]
    water: Annotated[float, Quantity("kg", "in this step", is_amount=True)]
    profile: Annotated[F64, Quantity("m", "over depth", ("layer_count",))]
    counts: Annotated[NDArray[np.int32], Quantity("", "kernels in each layer", ("layer_count",))]
    is_wet: Annotated[Mask, Quantity("", "whether each layer is", ("layer_count",))]
    is_dry: bool = False


SAMPLES = [
    ProbedMoisture(
        k * NS // 10,
        0.1 + k / 7,
        0.3 * k,
        np.arange(3.0) / 7 + k,
        np.arange(3, dtype=np.int32) - k,
        np.arange(3) == k,
        k > 2,
    )
    for k in range(5)
]
PORT = Port("moisture", ProbedMoisture)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("toy")
    outputs = {"probe.moisture": ProbedMoisture, "probe_2.moisture": ProbedMoisture}
    with Recorder(folder, [replace(machine(), outputs=outputs)]) as recorder:
        for sample in SAMPLES:
            recorder("combine.probe", sample.t, {"moisture": sample})
            recorder("combine.probe_2", sample.t, {"moisture": replace(sample, share=9.0)})
        drive([recorder], GridField(ArcEdge()), seconds=0.5)
    return folder


def setup_of(base, inputs=(), outputs=(PORT,)):
    control = ControlSetup(GEOMETRY, {}, "left", 0.1)
    return LinkSetup("combine", "probe", inputs, outputs, control, base)


def test_it_becomes_a_message_of_its_own(folder):
    with (folder / "run.mcap").open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        found = list(reader.iter_decoded_messages(topics=["/combine/probe/moisture"]))
    assert {schema.name for schema, *_ in found} == {"swath_msgs/msg/ProbedMoisture"}
    got = [m for *_, m in found]
    assert [m.share for m in got] == [s.share for s in SAMPLES]
    for name in ("profile", "counts", "is_wet"):
        assert list(getattr(got[1], name)) == getattr(SAMPLES[1], name).tolist()
    assert got[4].header.frame_id == "combine/probe"


def test_it_is_a_column_of_the_tracks_for_each_slot_that_publishes_it(folder):
    tracks = read_tracks(folder / "tracks.parquet")
    np.testing.assert_array_equal(tracks["moisture_share"], SAMPLES[-1].share)
    np.testing.assert_array_equal(tracks["probe_2_moisture_share"], 9.0)


def test_it_is_played_back_bit_for_bit(folder):
    player = LogPlayer(Params(folder=str(folder)), setup_of(folder))
    played = [player.reset(Stream(1, "x"))["moisture"]]
    played += [player.step(k * NS // 10, NS // 10, {})["moisture"] for k in range(4)]
    player.close()
    assert all(same_bits(a, b) for a, b in zip(played, SAMPLES, strict=True))


@pytest.mark.parametrize("field", ["share", "profile", "counts", "is_wet", "is_dry"])
def test_every_field_is_in_the_digest(field):
    """One number of it that differs makes another digest."""
    sample, digests = SAMPLES[1], [Digest(), Digest()]
    value = np.array(getattr(sample, field))
    value.flat[-1] = ~value.flat[-1] if value.dtype == bool else value.flat[-1] + 1
    other = replace(sample, **{field: value if value.ndim else value.item()})
    for digest, sent in zip(digests, (sample, other), strict=True):
        digest("combine.probe", sent.t, {"moisture": sent})
    assert digests[0].hex != digests[1].hex


def fmu_variable(name, causality, unit="1", size=1):
    is_array = size > 1
    return Variable(
        name, "real", "Float64", causality, "continuous", unit, parse_unit(unit), 0.0, (1,), size, is_array
    )


def test_an_fmu_takes_it_and_gives_it():
    ports = (PORT,)
    variables = [fmu_variable("moisture.share", "output", "%"), fmu_variable("moisture.water", "output", "g")]
    variables += [
        fmu_variable("moisture.profile", "output", "mm", 3),
        fmu_variable("moisture.counts", "output", "1", 3),
        fmu_variable("moisture.is_wet", "output", "1", 3),
        fmu_variable("water_flow", "input", "kg/s"),
    ]
    blank = dict.fromkeys(Description.__dataclass_fields__)
    fmu = Description(**{**blank, "file": Path("x.fmu"), "variables": {v.name: v for v in variables}})
    params = SimpleNamespace(inputs={}, outputs={}, constants={}, parameters={}, units={})
    wiring = make_wiring(fmu, setup_of(Path(), inputs=ports), params)
    assert [(i.field.name, i.mode) for i in wiring.inputs] == [("water", "rate")]  # it is an amount
    assert wiring.input_ports[0].history
    given = {"moisture.share": [float("nan")], "moisture.water": [250.0], "moisture.profile": [1.0, 2.0, 3.0]}
    given |= {"moisture.counts": [4.0, 5.0, -6.0], "moisture.is_wet": [0.0, 1.0, 0.0]}
    numbers = [x for out in wiring.outputs for x in given[out.variable.name]]
    made = samples_of(wiring, 7, numbers)["moisture"]  # nan stands for no grain
    assert (made.t, made.water, made.is_dry) == (7, 0.25, False)
    np.testing.assert_allclose(made.profile, [0.001, 0.002, 0.003])
    assert (made.counts.dtype, made.counts.tolist()) == (np.int32, [4, 5, -6])
    assert made.is_wet.tolist() == [False, True, False]


def test_a_ros_2_node_takes_it_and_gives_it():
    numbers = numbers_of("moisture", SAMPLES[3])
    assert same_bits(sample_of(PORT, 0, numbers), SAMPLES[3])


def test_it_is_documented():
    page, table = signals_page([ProbedMoisture]), messages_table([ProbedMoisture])
    assert re.search(
        r"\| `share` \| float \| - \| [^|]* \| of the wet mass \| no grain \| `moisture_share` \|", page
    )
    assert re.search(r"\| `profile` \| \(layer_count\) \| m \| [^|]* \| over depth \|  \|  \|", page)
    assert re.search(r"\| `is_dry` \| bool \| - \| [^|]*\| is dry \|  \|  \|", page)
    assert "| ProbedMoisture | `/machine/slot/output` | swath_msgs/ProbedMoisture | `machine/slot` |" in table
