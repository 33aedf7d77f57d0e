"""MF4, BLF and ASC: a run goes there and comes back, others read it, and what is not said is not guessed."""

from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from swath import api
from swath.commands.main import main
from swath.core.errors import InputError
from swath.documents.j1939 import dbc_file
from swath.field_io.logs.channels import FRAGMENT, open_channels, si_unit
from swath.field_io.logs.log import read_log
from swath.field_io.logs.machine_log import read_machine_log
from swath.field_io.logs.steer_log import read_steer_log
from swath.record.read.files import open_log
from swath.tools.run_log.write import recorded
from tests.field.made_log import COLUMNS, MadeLog
from tests.link.test_log_bags import NS, play, player

asammdf = pytest.importorskip("asammdf")
can = pytest.importorskip("can")
cantools = pytest.importorskip("cantools")

KINDS = ("mf4", "blf", "asc")
STATE = "combine.motion.state."


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run") / "run"
    sets = {"combine.lidar.level": "profile", "run.distance_m": 2}
    api.run("straight", folder, sets=sets, report=False)
    return folder


@pytest.fixture(scope="module")
def files(run, tmp_path_factory):
    made = {}
    for kind in KINDS:
        made[kind] = tmp_path_factory.mktemp(kind) / f"run.{kind}"
        assert main(["run-log", str(run), "--out", str(made[kind])]) == 0
    return made


@pytest.fixture(scope="module")
def truth(run):
    return {name: (o.t, unit, v) for o in recorded(run) for name, (unit, v) in o.channels.items()}


@pytest.mark.parametrize("kind", KINDS)
def test_a_run_comes_back(files, truth, kind):
    log = open_channels(files[kind])
    found = {}
    for name, t, values in log.blocks(log.units):
        found.setdefault(name, []).append((t, values))
    assert len(found) == len(truth) > 40
    for name, (t, unit, values) in truth.items():
        own = name if kind == "mf4" else name.replace(".", "_")
        times, numbers = (np.concatenate(part) for part in zip(*found[own], strict=True))
        np.testing.assert_array_equal(times, np.round(t * 1e6) * 1000)
        np.testing.assert_array_equal(numbers, values)
        assert log.units[own] == unit


def test_others_read_it(files, truth):
    with asammdf.MDF(files["mf4"]) as mdf:
        for name, (t, unit, values) in truth.items():
            signal = mdf.get(name)
            np.testing.assert_array_equal(signal.samples, values)
            np.testing.assert_array_equal(signal.timestamps, t)
            assert signal.unit == unit
    speed = truth["combine.motion.state.speed"][2]
    for kind in ("blf", "asc"):
        database = cantools.database.load_file(files[kind].with_suffix(".dbc"))
        with can.LogReader(files[kind]) as reader:
            read = [database.decode_message(m.arbitration_id, m.data, force_extended_id=True) for m in reader]
        name = "combine_motion_state_speed"
        np.testing.assert_array_equal([m[name] for m in read if name in m], speed)


@pytest.mark.parametrize("kind", KINDS)
def test_a_slot_plays_it(files, truth, kind):
    names = [n for n in truth if n.startswith(STATE)]
    topics = {f"state.{n.removeprefix(STATE)}": n if kind == "mf4" else n.replace(".", "_") for n in names}
    played = {t: o["state"] for t, o in play(player(files[kind], "motion", topics), 1.0) if o}
    t, _, speed = truth["combine.motion.state.speed"]
    yaw = truth["combine.motion.state.pose.yaw"][2]
    at = [k for k in range(len(t)) if round(t[k] * NS) in played and t[k] < 0.9]
    assert len(at) > 40
    for k in at:
        sample = played[round(t[k] * NS)]
        assert sample.speed == speed[k]
        assert sample.pose.euler()[2] == pytest.approx(yaw[k], abs=1e-12)


def mf4(path, *groups):
    """groups: (t, {name: (values, unit)})"""
    with asammdf.MDF(version="4.10") as mdf:
        for t, channels in groups:
            mdf.append([asammdf.Signal(np.asarray(v), t, name=n, unit=u) for n, (v, u) in channels.items()])
        mdf.save(path, overwrite=True)
    return path


ACT = """X1*1.0+0*sin(*(eval('[open("{}","a").write("x"),0.5][1]') for i in (1,)))"""


def straight():
    return {"a": 2.0, "b": 0.0}


def of_range(inside, rest):
    return {"lower_0": 0.0, "upper_0": 9.0, "text_0": inside, "default_addr": rest}


def of_value(value, then, rest):
    return {"val_0": value, "text_0": then, "default_addr": rest}


NESTINGS = {
    "formula": lambda formula: formula,
    "range": lambda formula: of_range(formula, straight()),
    "range's rest": lambda formula: {**of_range(straight(), formula), "lower_0": 8.0},
    "value": lambda formula: of_value(1.0, formula, straight()),
    "value's rest": lambda formula: of_value(7.0, straight(), formula),
    "deeper": lambda formula: of_value(1.0, of_range(formula, straight()), straight()),
}


def with_formula(path, nesting, text):
    def signal(name, conversion=None):
        about = {"conversion": conversion} if conversion else {}
        return asammdf.Signal(np.array([1.0, 2.0, 3.0]), np.arange(3.0), name=name, unit="m/s", **about)

    with asammdf.MDF(version="4.10") as mdf:
        mdf.append([signal("plain"), signal("made", NESTINGS[nesting]({"formula": text}))])
        mdf.save(path, overwrite=True)
    return path


@pytest.mark.parametrize("nesting", NESTINGS)
def test_a_formula_that_is_no_arithmetic_does_nothing(tmp_path, nesting):
    acted = tmp_path / "ACTED"
    log = open_channels(with_formula(tmp_path / "a.mf4", nesting, ACT.format(acted)))
    assert list(log.units) == ["plain"]
    assert [note for note in log.notes if note.startswith("unused: made is left out: its conversion")]
    for _ in log.blocks({"plain", "made"}):
        pass
    assert not acted.exists()


@pytest.mark.parametrize("nesting", NESTINGS)
def test_arithmetic_of_a_file_is_computed(tmp_path, nesting):
    log = open_channels(with_formula(tmp_path / "a.mf4", nesting, "2*X1 + exp(X1) - x1/2"))
    ((_, _, values),) = log.blocks({"made"})
    x = np.array([1.0, 2.0, 3.0])
    formula = 2 * x + np.exp(x) - x / 2
    is_made = (x == 1) | (nesting not in ("value", "deeper"))
    np.testing.assert_allclose(values, np.where(is_made, formula, 2 * x), rtol=1e-14)


def test_nothing_of_a_file_reaches_what_makes_code(tmp_path, monkeypatch):
    """Should the look through conversions ever miss one."""
    monkeypatch.setattr("swath.field_io.logs.channels._without_arithmetic", lambda mdf: set())
    acted = tmp_path / "ACTED"
    for nesting in NESTINGS:
        log = open_channels(with_formula(tmp_path / "a.mf4", nesting, ACT.format(acted)))
        with suppress(ValueError):
            list(log.blocks({"made"}))
    assert not acted.exists()


def test_units_are_turned_or_refused(tmp_path):
    t = np.arange(0.0, 2.0, 0.02)
    channels = {"v": (7.2 + 0 * t, "km/h"), "w": (5.0 + 0 * t, "deg/s"), "bare": (1.0 + 0 * t, "")}
    path = mf4(tmp_path / "a.mf4", (t, channels))
    rest = {"odometry.steer_angle": 0.0}
    topics = {"odometry.speed": "v", "odometry.yaw_rate": "w"}
    part = player(path, "odometry", topics, constants=rest, scale={"odometry.yaw_rate": -1.0})
    sample = play(part, 1.0)[10][1]["odometry"]
    assert sample.speed == pytest.approx(2.0)
    assert sample.yaw_rate == pytest.approx(-np.radians(5.0))
    for name, said in (("w", "rad/s"), ("bare", "no unit")):
        with pytest.raises(
            InputError, match=rf"topics = {name} in {said}: expected a channel in m/s.*a\.mf4"
        ):
            player(path, "odometry", {**topics, "odometry.speed": name}, constants=rest)
    scaled = player(
        path, "odometry", {**topics, "odometry.speed": "bare"}, constants=rest, scale={"odometry.speed": 3}
    )
    assert play(scaled, 1.0)[10][1]["odometry"].speed == 3.0
    with pytest.raises(
        InputError, match=r"unit of 'speed \[furlong\]' = furlong: expected one of m/s.*b\.mf4"
    ):
        read_machine_log(mf4(tmp_path / "b.mf4", (t, {"speed": (t, "furlong"), "flow": (t, "kg/s")})))


@pytest.mark.parametrize(("text", "symbol", "factor"), [
    ("km/h", "m/s", 1 / 3.6), ("°", "rad", np.pi / 180), ("1/min", "rad/s", np.pi / 30), ("%", "1", 0.01),
    ("1/km right", "1/m", -1e-3), ("l/h", "m3/s", 1e-3 / 3600), ("kN", "N", 1e3),
])  # fmt: skip
def test_units(text, symbol, factor):
    assert si_unit(text) == (symbol, pytest.approx(factor))


def test_a_field_import_reads_the_same_records(tmp_path):
    made = MadeLog(passes=6)
    csv = tmp_path / "log.csv"
    made.write(csv)
    rows = np.genfromtxt(csv, delimiter=",", names=True, deletechars="")
    channels = {n: (rows[n], "") for n in rows.dtype.names if np.isfinite(rows[n]).all()}
    path, columns = mf4(tmp_path / "log.mf4", (rows["time"], channels)), tmp_path / "columns.yaml"
    columns.write_text(COLUMNS.replace("machine: {column: machine, unit: text}\n", ""))
    a, b = read_log(csv, columns), read_log(path, columns)
    assert len(a) == len(b)
    for name in ("east", "north", "flow", "width"):
        np.testing.assert_allclose(getattr(a, name), getattr(b, name))


def frames(path, sent):
    """sent: (t [s], message, sender, values)"""
    database = cantools.database.load_file(dbc_file())
    with can.Logger(path) as writer:
        for t, name, sender, values in sent:
            message = database.get_message_by_name(name)
            raw = {s.name: 2**s.length - 1 for s in message.signals}
            raw |= {k: round((v - s.offset) / s.scale) for k, v in values.items()
                    for s in [message.get_signal_by_name(k)]}  # fmt: skip
            data = message.encode(raw, scaling=False, strict=False, padding=True)
            identifier = message.frame_id & ~0xFF | sender
            writer(can.Message(1.6e9 + t, identifier, is_extended_id=True, data=data))
    return path


def drive(steps=400):
    """A machine that turns left on the bus, by two senders of its speed."""
    for k in range(steps):
        t = 0.05 * k
        yield t, "WheelBasedSpeedAndDistance", 0xF0, {"WheelBasedSpeed": 2.0}
        yield t + 0.001, "WheelBasedSpeedAndDistance", 0x1C, {}
        yield t + 0.002, "GuidanceSystemCommand", 0x1C, {"CurvatureCommand": -20.0}
        yield t + 0.003, "VehiclePosition", 0x1C, {"Latitude": 52.0 + k * 9e-7, "Longitude": -9.0}


@pytest.mark.parametrize("kind", KINDS)
def test_frames_of_an_isobus(tmp_path, kind):
    path = frames(tmp_path / f"bus.{kind}", drive())
    log = open_channels(path)
    found = {}
    for name, _, values in log.blocks(log.units):
        found.setdefault(name, []).extend(values)
    assert set(found["WheelBasedSpeed@F0"]) == {2.0}
    assert np.isnan(found["WheelBasedSpeed@1C"]).all()  # not available
    topics = open_log(path).topics()
    assert topics["CurvatureCommand"] == "channel 1/m"
    assert topics["position"] == "sensor_msgs/msg/NavSatFix"
    steer = {"command.curvature": "CurvatureCommand"}
    played = play(player(path, "steer", steer, constants={"command.is_engaged": True}), 1.0)
    assert [o["command"] for _, o in played if o][-1].curvature == pytest.approx(
        0.02
    )  # ISO 11783 counts to the right
    states = [o["state"] for _, o in play(player(path, "motion", {"state": "position"}), 10.0) if o]
    assert states[-1].pose.position[1] - states[50].pose.position[1] == pytest.approx(
        2.0 * (states[-1].t - states[50].t) / NS, rel=0.02
    )


def test_which_database_decodes_is_said_or_asked(tmp_path):
    path = frames(tmp_path / "bus.blf", drive(3))
    assert "form: frames decoded by guidance.dbc" in open_channels(path).notes
    (tmp_path / "one.dbc").write_text(dbc_file().read_text())
    assert "form: frames decoded by one.dbc" in open_channels(path).notes
    (tmp_path / "two.dbc").write_text("BO_ 1 Empty: 8 X\n")
    with pytest.raises(InputError, match=r"database = one.dbc, two.dbc: expected one of them named bus.dbc"):
        open_channels(path)
    (tmp_path / "bus.dbc").write_text("nonsense")
    with pytest.raises(InputError, match=r"database = bus.dbc: expected a DBC file"):
        open_channels(path)


def test_a_steering_log_on_the_bus_turns_left(tmp_path):
    t = np.arange(0.0, 30.0, 0.1)
    names = {"speed": (2.0, "m/s"), "steer angle": (0.1, "rad"), "yaw rate": (2.0, "deg/s"),
             "CurvatureCommand": (-20.0, "1/km right")}  # fmt: skip
    channels = {name: (np.full(len(t), value), unit) for name, (value, unit) in names.items()}
    log = read_steer_log(mf4(tmp_path / "s.mf4", (t, channels)))
    np.testing.assert_allclose(log.command, 0.02)
    np.testing.assert_allclose(log.yaw_rate, np.radians(2.0))


@pytest.mark.parametrize("kind", KINDS)
def test_a_damaged_file_is_read_as_far_as_it_goes_or_refused(files, tmp_path, kind):
    whole = files[kind].read_bytes()
    rng = np.random.default_rng(7)
    path = tmp_path / f"run.{kind}"
    path.with_suffix(".dbc").write_bytes(files["blf"].with_suffix(".dbc").read_bytes())
    refused = named = count = 0
    for at in (12, *rng.integers(64, len(whole), 2)):
        path.write_bytes(whole[: int(at)])
        try:
            log = open_channels(path)
        except InputError as error:
            refused += 1
            named += path.name in str(error)
        else:
            count += sum(1 for _ in log.samples(log.units)) > 0
    assert refused == named > 0 or count > 0


def test_blocks_of_a_long_file_are_short(tmp_path):
    t = np.arange(2_000_000) * 1e-3
    path = mf4(tmp_path / "long.mf4", (t, {"a": (t, "m"), "b": (t, "m")}))
    assert path.stat().st_size > 8 * FRAGMENT
    log = open_channels(path)
    assert max(len(times) for _, times, _ in log.blocks(["a", "b"])) * 24 <= FRAGMENT


DBC = """VERSION ""
BU_: A
BO_ {number} Long: {size} A
 SG_ Last : {bit}|16@1+ (0.5,0) [0|30000] "km/h" A
BA_DEF_ "ProtocolType" STRING ;
BA_DEF_DEF_ "ProtocolType" "";
BA_ "ProtocolType" "J1939";
BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","ExtendedCAN","reserved","J1939PG";
BA_DEF_DEF_ "VFrameFormat" "";
BA_ "VFrameFormat" BO_ {number} 3;
"""


def transported(pgn, source, data, to=255):
    """Frames of a message: SAE J1939-21, begun by an announcement, or by a request to send to one."""
    count, low = -(-len(data) // 7), to << 8 | source
    head = bytes([32 if to == 255 else 16]) + len(data).to_bytes(2, "little") + bytes([count, 255])
    padded = data + b"\xff" * (7 * count - len(data))
    parts = [bytes([n + 1]) + padded[7 * n : 7 * n + 7] for n in range(count)]
    frames = [(7 << 26 | 0xEC0000 | low, head + pgn.to_bytes(3, "little"))]
    return frames + [(7 << 26 | 0xEB0000 | low, part) for part in parts]


@pytest.mark.parametrize("size", [9, 14, 100, 1785])
def test_a_message_of_several_frames_is_put_together(tmp_path, size):
    """Three senders at once, one to a single destination; one message lacks a frame."""
    rng = np.random.default_rng(size)
    path, pgn = tmp_path / "long.blf", 0xFF21
    number = 1 << 31 | 6 << 26 | pgn << 8
    path.with_suffix(".dbc").write_text(DBC.format(number=number, size=size, bit=8 * size - 16))
    speeds = rng.integers(0, 60_000, 4)
    data = [rng.bytes(size - 2) + int(speed).to_bytes(2, "little") for speed in speeds]
    streams = [transported(pgn, source, data[source], 7 if source == 2 else 255) for source in range(4)]
    del streams[3][1]
    order = rng.permutation(np.repeat(np.arange(4), [len(stream) for stream in streams]))
    streams = [iter(stream) for stream in streams]
    with can.Logger(path) as logger:
        for n, source in enumerate(order):
            identifier, part = next(streams[source])
            frame = can.Message(arbitration_id=identifier, data=part, timestamp=0.01 * n, is_extended_id=True)
            logger.on_message_received(frame)
    log = open_channels(path)
    found = {name: values.tolist() for name, _, values in log.blocks(log.units)}
    assert found == {f"Last@{source:02X}": [0.5 * speeds[source]] for source in range(3)}
    assert log.units["Last@00"] == "km/h"
    assert log.notes["lost: messages of several frames that lack one"] == 1


@pytest.mark.parametrize("version", ["2.14", "3.30"])
def test_mdf_before_4_is_refused_by_its_version(tmp_path, version):
    with asammdf.MDF(version=version) as mdf:
        t = np.linspace(0.0, 1.0, 11)
        mdf.append([asammdf.Signal(t, t, name="speed", unit="m/s")])
        path = Path(mdf.save(tmp_path / "old.mdf", overwrite=True))
    with pytest.raises(InputError, match=rf"old\.mdf: expected MDF 4 \(\.mf4\), it is MDF {version} \("):
        read_machine_log(path)


def test_what_is_no_measurement_is_named_by_its_ending(tmp_path):
    for ending in ("mf4", "blf"):
        (tmp_path / f"junk.{ending}").write_text("junk")
        with pytest.raises(InputError, match=f"expected {ending.upper()}, which its first bytes are not"):
            open_log(tmp_path / f"junk.{ending}")
    (tmp_path / "junk.npz").write_text("junk")
    with pytest.raises(InputError, match="by its first bytes it is none"):
        open_log(tmp_path / "junk.npz")
    (tmp_path / "metadata.yaml").write_text("rosbag2_bagfile_information: {}")  # of a run that lost its data
    with pytest.raises(InputError, match="it holds no such file"):
        open_log(tmp_path)


@pytest.mark.parametrize("late", [1e11, 1e300, float("inf"), float("nan"), -1e30])
def test_samples_of_another_century_are_left_out_and_counted(late, tmp_path):
    from asammdf import MDF, Signal

    t = np.array([0.0, 1.0, 2.0, late])
    with MDF(version="4.10") as mdf:
        mdf.append([Signal(np.arange(4.0), t, name="Speed", unit="m/s")])
        mdf.save(tmp_path / "log.mf4")
    log = open_channels(tmp_path / "log.mf4")
    ((_, times, values),) = log.blocks(["Speed"])
    assert times.tolist() == [0, 10**9, 2 * 10**9]
    assert values.tolist() == [0.0, 1.0, 2.0]
    assert log.notes == {"timeline: samples more than 146 years from the first, left out": 1}
    assert (log.begin, log.end) == (0, 2 * 10**9)
