"""A steering law as a voltage, and a voltage that steers: converters, wires that are cut, both directions."""

import math
import socket

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swath.core.component import Port
from swath.core.errors import InputError, SwathError
from swath.core.foreign_code import allow_code
from swath.core.random import Stream
from swath.link.device import analog
from swath.link.device.output import DeviceSetup, make_device
from swath.link.levels.analog import AnalogSteering, Params
from swath.machine.machine_sheet import load_machine
from swath.signals import Scan, SteerCommand
from tests.link.device_rig import device, free_port, heard_by
from tests.link.test_device_level import setup
from tests.waiting import until

MACHINE = load_machine("lexion-700-class")
STEP = 20_000_000  # ns


@st.composite
def lines(draw):
    low, high = sorted((draw(st.floats(0.3, 2.0)), draw(st.floats(2.2, 4.7))))
    left, right = (high, low) if draw(st.booleans()) else (low, high)
    return analog.Line(left, right, fault_below_v=0.2, fault_above_v=4.8, bits=draw(st.integers(6, 16)))


@given(lines(), st.floats(-1.5, 1.5))
def test_an_angle_comes_back_within_half_a_step(line, share):
    angle = share * MACHINE.max_steer
    volts = line.volts(angle, MACHINE.max_steer)
    step = line.range_v / (2**line.bits - 1)
    per_volt = 2.0 * MACHINE.max_steer / abs(line.left_v - line.right_v)
    meant = max(-MACHINE.max_steer, min(MACHINE.max_steer, angle))
    assert abs(volts / step - round(volts / step)) < 1e-6
    assert abs(line.angle(volts, MACHINE.max_steer) - meant) <= 0.5001 * step * per_volt
    assert (volts - 0.5 * (line.left_v + line.right_v)) * meant * (line.left_v - line.right_v) >= -step * 9


@given(st.floats(0, 48))
def test_a_voltage_steers_inside_the_bands_alone(volts):
    angle = analog.Line().angle(volts, MACHINE.max_steer)
    assert math.isnan(angle) == (not 0.2 <= volts <= 4.8)
    assert math.isnan(angle) or abs(angle) <= MACHINE.max_steer


def test_the_sentence_is_nmea():
    pynmea2 = pytest.importorskip("pynmea2")
    told = pynmea2.parse(analog.written(2.50122).decode(), check=True)
    assert (told.type, told.units, told.id, float(told.value)) == ("U", "V", "STEER", 2.50122)
    assert (
        analog.read(b"$WIXDR,C,21.5,C,AIR,U,3.25,V,2*%02X" % _xor(b"WIXDR,C,21.5,C,AIR,U,3.25,V,2")) == 3.25
    )
    for body in (b"IIXDR,C,21.5,C,AIR", b"IIXDR,U,nan,V,X", b"GNHDT,1,T"):
        with pytest.raises(ValueError, match="no voltage"):
            analog.read(b"$%s*%02X" % (body, _xor(body)))
    with pytest.raises(ValueError, match="no voltage"):
        analog.read(b"$IIXDR,U,2.5,V,STEER")  # without a checksum


def _xor(body):
    check = 0
    for byte in body:
        check ^= byte
    return check


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ("left_v=0.4", "left_v = 0.4: expected 0 < fault_below_v 0.2 <= left_v, right_v 0.4"),
        ("fault_above_v=4", "left_v = 4.6: expected"),
        ("range_v=4.8", "expected 0 < fault_below_v"),
        ("bits=12.5", "bits = 12.5: expected a whole number"),
        ("bits=many", "bits = many: expected a whole number"),
        ("left_v=-1", "left_v = -1: expected >= 0"),
        ("volts=3", "unknown key"),
    ],
)
def test_an_option_that_does_not_fit_is_one_error(options, expected):
    with pytest.raises(InputError, match=expected):
        device(f"analog://?{options}", SteerCommand)


def test_what_does_not_steer_has_no_voltage():
    with pytest.raises(InputError, match="expected in a slot steer"):
        AnalogSteering(Params(), setup("lidar", Scan))


@pytest.mark.parametrize("transport", ["udp", "tcp", "pty"])
def test_one_run_s_law_steers_another_s_machine(transport, tmp_path, monkeypatch):
    where = str(tmp_path / "volts") if transport == "pty" else f"127.0.0.1:{free_port()}"
    address = f"analog+{transport}://{where}"
    with allow_code((), addresses=[address]):
        port = (Port("command", SteerCommand),)
        more = {"wheelbase": MACHINE.wheelbase, "max_steer": MACHINE.max_steer}
        made = make_device(address, DeviceSetup("combine.steer", port, 0.02, math.nan, None, 1.0, **more))
        part = AnalogSteering(Params(address=address), setup("steer", SteerCommand))
    heard = heard_by(monkeypatch)
    made.open()
    assert not part.reset(Stream(0, "x"))["command"].is_engaged
    until(made._is_met, "it is connected")

    def step(n, curvature, is_engaged=True):
        """The machine's command once the box has told its n-th one."""
        made("steer", n * STEP, {"command": SteerCommand(n * STEP, curvature, is_engaged)})
        until(lambda: b"".join(heard).count(b"\n") == n, "the line has come")
        return part.step((n - 1) * STEP, STEP, {})["command"]

    most = 0.5001 * 5.0 / 4095 * MACHINE.max_steer / 2.1 / math.cos(0.5) ** 2 / MACHINE.wheelbase
    sent = np.random.default_rng(1).uniform(-0.1, 0.1, 12).tolist()
    for n, curvature in enumerate(sent, 1):
        command = step(n, curvature)
        assert command.is_engaged
        assert abs(command.curvature - curvature) <= most
    assert not step(len(sent) + 1, 0.0, is_engaged=False).is_engaged  # 0 V
    part.close(), made.close()
    assert "lines" not in "\n".join(part.notes)


@pytest.fixture
def wire(monkeypatch):
    """A machine with drawn words of a line, and what to step with."""

    def make(**keys):
        port = free_port(socket.SOCK_DGRAM)
        part = AnalogSteering(Params(address=f"analog://:{port}", **keys), setup("steer", SteerCommand))
        part.reset(Stream(0, "x"))
        parts.append(part)

        def step(t, *data):
            heard.clear()
            for piece in data:
                box.sendto(piece, ("127.0.0.1", port))
            until(lambda: len(heard) == len(data), "they have come")
            return part.step(t, STEP, {})["command"]

        return part, step

    parts, heard = [], heard_by(monkeypatch)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as box:
        yield make
    for part in parts:
        part.close()


def test_a_cut_wire_a_short_and_silence_release_the_steering(wire):
    part, step = wire()
    left = step(0, analog.written(4.6))
    assert left.is_engaged
    assert left.curvature == pytest.approx(math.tan(MACHINE.max_steer) / MACHINE.wheelbase, rel=1e-3)
    for n, volts in enumerate((0.0, 5.0)):
        assert not step(STEP * (1 + 2 * n), analog.written(volts)).is_engaged
        assert step(
            STEP * (2 + 2 * n), b"noise\r\n", analog.written(2.5)[:9], analog.written(2.5)[9:]
        ).is_engaged
    assert step(STEP * 10).is_engaged
    assert not step(STEP * 24).is_engaged
    notes = "\n".join(part.notes)
    assert "0.00 V, expected 0.2 to 4.8 V; the steering was released" in notes
    assert "no sample for 0.40 s; the steering was released" in notes
    assert "2 lines were no voltage" in notes


def test_where_a_fault_is_to_fail_it_ends_the_run(wire):
    _, step = wire(on_fault="fail")
    assert not step(0, analog.written(0.0)).is_engaged  # it does not steer yet
    assert step(STEP, analog.written(0.25)).curvature < 0.0
    with pytest.raises(SwathError, match=r"combine.steer: 4\.95 V, expected 0\.2 to 4\.8 V, at 0\.06 s"):
        step(2 * STEP, analog.written(4.95))
