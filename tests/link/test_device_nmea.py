"""A slot as a GNSS receiver: pynmea2, AgOpenGPS's own reading; TCP, UDP, pseudo terminal; back again."""

import math
import os
import socket
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swath.core.errors import InputError, SwathError
from swath.core.foreign_code import allow_code
from swath.field.maps.projection import origin_at
from swath.link.device import nmea, output
from swath.link.device.output import convergence
from swath.signals import Fix
from tests.fake_clock import FakeClock
from tests.link.device_rig import device, drawn_fix
from tests.link.independent_agopengps import position_of
from tests.waiting import PATIENCE_S, until

BEGUN = nmea.utc_of("2026-07-15T23:59:58Z")
ALL = ("GGA", "VTG", "RMC", "GST", "HDT", "THS", "PANDA", "PAOGI")
MM = 1e-3 / 6_371_000.0  # of the ground, as an angle [rad]


@pytest.mark.parametrize("seed", range(8))
def test_pynmea2_reads_what_the_fix_says(seed):
    pynmea2 = pytest.importorskip("pynmea2")
    rng = np.random.default_rng(seed)
    place = rng.uniform(-np.pi, np.pi), rng.uniform(-1.4, 1.4)
    fix = drawn_fix(
        round(rng.uniform(0, 1e10)), rng, heading=rng.uniform(-3, 3), quality=int(rng.integers(1, 5)),
        longitude=place[0], latitude=place[1],
    )  # fmt: skip
    told = {}
    for line in nmea.sentences(fix, ALL[:5], BEGUN, 0.01).decode("ascii").splitlines():
        one = pynmea2.parse(line, check=True)
        told[one.sentence_type] = one
    gga, rmc, vtg, gst = told["GGA"], told["RMC"], told["VTG"], told["GST"]
    for one in (gga, rmc):
        assert abs(math.radians(one.latitude) - fix.latitude) < 0.2 * MM
        assert abs(math.radians(one.longitude) - fix.longitude) < 0.2 * MM
    at = BEGUN.timestamp() + fix.t * 1e-9
    assert abs(rmc.datetime.timestamp() - at) <= 0.0051
    assert gga.gps_qual == {1: 1, 2: 2, 3: 5, 4: 4}[fix.quality]
    assert abs(gga.altitude + float(gga.geo_sep) - fix.height) <= 0.0006
    assert (int(gga.num_sats), float(gga.horizontal_dil)) == (14, 0.7)
    assert abs(vtg.spd_over_grnd_kmph / 3.6 - fix.speed) < 1e-4
    assert abs(rmc.spd_over_grnd * 1852 / 3600 - fix.speed) < 1e-4
    bearing = math.degrees(math.pi / 2 - fix.course + 0.01) % 360
    assert abs((vtg.true_track - bearing + 180) % 360 - 180) < 1e-3
    assert (
        abs((float(told["HDT"].heading) - math.degrees(math.pi / 2 - fix.heading + 0.01) + 180) % 360 - 180)
        < 1e-3
    )
    assert abs(float(gst.std_dev_latitude) - 0.012) < 1e-4


def test_agopengps_reads_panda_and_paogi():
    rng = np.random.default_rng(9)
    fix = drawn_fix(5_000_000_000, rng)
    told = position_of(nmea.sentences(fix, ("PANDA", "PAOGI"), BEGUN, 0.0))  # one: it has no heading
    assert (told.kind, told.heading) == ("PANDA", None)  # no IMU
    assert abs(told.latitude - math.degrees(fix.latitude)) < 1e-9
    assert abs(told.speed_kmh / 3.6 - fix.speed) < 1e-4
    fix = drawn_fix(5_000_000_000, rng, heading=0.0)
    told = position_of(nmea.sentences(fix, ("PAOGI",), BEGUN, 0.0))
    assert (told.heading, told.quality, told.satellites, told.age) == (90.0, 4, 14, 1.0)
    assert (told.roll, told.pitch) == (0.0, 0.0)  # it knows neither
    fix = drawn_fix(5_000_000_000, rng, heading=0.0, roll=math.radians(4.0), pitch=math.radians(-3.0))
    told = position_of(nmea.sentences(fix, ("PAOGI",), BEGUN, 0.0))
    assert (told.roll, told.pitch) == (4.0, 3.0)  # right side down, nose up


@given(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))
def test_paogi_read_again_has_the_same_attitude(roll, pitch):
    fix = drawn_fix(1_000_000_000, np.random.default_rng(1), heading=0.5, roll=roll, pitch=pitch)
    listener = nmea.Listener()
    listener.feed(nmea.sentences(fix, ("PAOGI",), BEGUN, 0.0))
    told = listener.epoch
    assert abs(told.roll - roll) < 1e-5
    assert abs(told.pitch - pitch) < 1e-5
    assert abs(told.heading - (math.pi / 2 - 0.5)) < 1e-5


def test_the_heading_of_an_imu_is_none_of_the_machine():
    """PANDA has it in tenths of a degree, from where the unit was switched on."""
    fix = drawn_fix(0, np.random.default_rng(1))
    body = nmea.sentences(fix, ("PANDA",), BEGUN, 0.0).decode().replace("65535,0", "234,-12")
    listener = nmea.Listener()
    listener.feed(nmea.sentence(body[1 : body.index("*")]))
    assert math.isnan(listener.epoch.heading)


def test_no_fix_is_told_as_none():
    nothing = dict.fromkeys(
        ("speed", "course", "horizontal_sd", "longitude", "latitude", "height", "hdop"), math.nan
    )
    fix = drawn_fix(0, np.random.default_rng(1), quality=0, **nothing)
    lines = nmea.sentences(fix, ALL, BEGUN, 0.0).decode().splitlines()
    assert [line[3:6] for line in lines[:4]] == ["GGA", "VTG", "RMC", "GST"]
    assert lines[0] == "$GNGGA,235958.00,,,,,0,00,99.9,,,,,,*" + lines[0][-2:]
    listener = nmea.Listener()
    listener.feed("\r\n".join([*lines, ""]).encode())
    told = listener.epoch
    assert (told.quality, listener.wrong) == (0, 0)
    assert math.isnan(told.latitude)
    assert math.isnan(told.speed)


@given(
    st.floats(-1.5, 1.5), st.floats(-3.14, 3.14), st.floats(0, 20), st.floats(-3.1, 3.1), st.integers(1, 4)
)
def test_read_again_a_fix_is_the_same(latitude, longitude, speed, course, quality):
    fix = drawn_fix(
        1_000_000_000, np.random.default_rng(1), latitude=latitude, longitude=longitude, speed=speed,
        course=course, heading=course, quality=quality,
    )  # fmt: skip
    listener = nmea.Listener()
    data = nmea.sentences(fix, ALL[:5], BEGUN, 0.0)
    assert listener.feed(data[:37]) + listener.feed(data[37:]) == []
    told = listener.epoch
    assert told.quality == quality
    assert abs(told.latitude - latitude) < 0.2 * MM
    assert abs(told.longitude - longitude) < 0.2 * MM
    assert abs(told.speed - speed) < 1e-4
    assert abs(told.height - fix.height) < 6e-4
    assert abs(math.sin((math.pi / 2 - course - told.heading) / 2)) < 1e-5
    assert told.seconds == 86_399.0
    assert listener.wrong == 0


def test_an_epoch_is_told_with_its_last_sentence_however_the_stream_is_cut():
    """Line by line, as receivers send it over a serial line or in datagrams of their own."""
    listener, told = nmea.Listener(), []
    for n in range(6):
        fix = drawn_fix(n * 100_000_000, np.random.default_rng(n), heading=0.1 * n)
        for name in ("GGA", "RMC", "GST", "HDT") if n == 3 else ("GGA", "RMC", "VTG", "GST", "HDT"):
            line = nmea.sentences(fix, (name,), BEGUN, 0.0)
            told += [(n, name, epoch) for epoch in listener.feed(line[:9]) + listener.feed(line[9:])]
    assert [(n, name) for n, name, _ in told] == [
        (1, "GGA"), (1, "HDT"), (2, "HDT"), (4, "GGA"), (4, "HDT"), (5, "HDT")
    ]  # fmt: skip
    for n, (_, _, epoch) in enumerate(told):
        fix = drawn_fix(n * 100_000_000, np.random.default_rng(n), heading=0.1 * n)
        assert abs(epoch.latitude - fix.latitude) < 0.2 * MM
        assert abs(epoch.speed - fix.speed) < 1e-4  # by RMC where VTG was lost
        assert abs(epoch.horizontal_sd - fix.horizontal_sd) < 1e-4
        assert abs(epoch.heading - (math.pi / 2 - 0.1 * n)) < 1e-5


@given(st.binary(max_size=300))
def test_garbage_is_counted_and_what_comes_after_it_is_read(noise):
    listener = nmea.Listener()
    fix = drawn_fix(1_000_000_000, np.random.default_rng(1))
    listener.feed(noise + b"\r\n" + nmea.sentences(fix, ("GGA",), BEGUN, 0.0))
    assert abs(listener.epoch.latitude - fix.latitude) < 0.2 * MM


GGA = "GNGGA,{t},5206.0000,N,01012.0000,E,4,12,0.8,298.4,M,46.6,M,1.0,0000"
RMC = "GNRMC,{t},A,5206.0000,N,01012.0000,E,4.0,90.0,150726,,,N"
VTG = "GNVTG,90.0,T,,M,4.0,N,7.408,K,A"


def heard(body, count=4, checked=True):
    """The newest epoch of some sentences, each of them once more."""
    listener = nmea.Listener()
    for k in range(count):
        for one in body:
            text = one.format(t=f"10000{k}.00")
            listener.feed(nmea.sentence(text) if checked else f"${text}\r\n".encode())
    return listener


@pytest.mark.parametrize(
    ("name", "body", "said"),
    [
        ("whole", GGA, {"quality": 4, "height": 345.0}),
        ("without a height", GGA.replace("298.4", ""), {"height": math.nan, "quality": 4}),
        ("without a separation", GGA.replace("46.6", ""), {"height": math.nan, "quality": 4}),
        ("in feet", GGA.replace("298.4,M", "979.00262,F"), {"height": 345.0}),
        ("without satellites", GGA.replace(",12,", ",00,"), {"quality": 0}),
        ("its end left away", GGA.rpartition(",46.6")[0], {"height": math.nan, "quality": 4}),
    ],
)
def test_what_a_sentence_does_not_say_is_not_known(name, body, said):
    listener = heard([body])
    assert listener.wrong == 0
    for field, value in said.items():
        assert getattr(listener.epoch, field) == pytest.approx(value, abs=1e-3, nan_ok=True)
    is_said = "heights: positions without a height above the ellipsoid" in listener.unknown
    assert is_said == math.isnan(listener.epoch.height)


@pytest.mark.parametrize(
    "body", [RMC.replace(",A,", ",V,", 1), VTG.replace("K,A", "K,N")], ids=["RMC", "VTG"]
)
def test_void_sentences_say_nothing(body):
    assert math.isnan(heard([GGA, body]).epoch.speed)
    assert heard([GGA, RMC if "RMC" in body else VTG]).epoch.speed == pytest.approx(4 * 1852 / 3600, abs=1e-3)


@pytest.mark.parametrize(
    "body",
    [
        GGA.replace("5206.0000", "526.0000"), GGA.replace("5206", "5266"), GGA.replace("01012", "1012"),
        GGA.replace("298.4,M", "298.4,X"), GGA.replace("298.4", "29x.4"), GGA[:44],
    ],
)  # fmt: skip
@pytest.mark.parametrize("checked", [True, False])
def test_a_sentence_counts_whole_or_not_at_all(body, checked):
    """Of a cut one whose checksum is right the rest was left away; then nothing but the time may be used."""
    listener = heard([body], checked=checked)
    if body == GGA[:44] and checked:
        assert math.isnan(listener.epoch.height)
    else:
        assert listener.epoch is None
        assert listener.wrong == 4 - (not checked)


def test_checksums_are_left_away_by_all_lines_or_by_none():
    right, wrong = GGA.format(t="100000.00"), GGA.format(t="100001.00").replace("5206", "5106")
    for first in (True, False):
        listener = nmea.Listener()
        lines = [f"${wrong}\r\n".encode(), nmea.sentence(right)]
        listener.feed(b"".join(lines if first else lines[::-1]))
        assert listener.epoch.latitude == pytest.approx(math.radians(52.1))
        assert listener.wrong == (not first)
    assert heard([GGA], checked=False).epoch.latitude == pytest.approx(math.radians(52.1))


def test_a_wrong_checksum_is_no_sentence():
    data = nmea.sentences(drawn_fix(0, np.random.default_rng(1)), ("GGA",), BEGUN, 0.0)
    listener = nmea.Listener()
    listener.feed(data.replace(b"N", b"S", 1))
    assert (listener.wrong, listener.epoch) == (1, None)


def test_north_of_the_grid_is_not_north():
    origin = origin_at(52.0, 10.9)  # 1.9 deg east of the meridian of its zone
    turned = math.degrees(convergence(origin, 0.0, 0.0))
    assert (
        abs(turned - math.degrees(math.atan(math.tan(math.radians(1.9)) * math.sin(math.radians(52.0)))))
        < 1e-3
    )


def served(address):
    with allow_code((), addresses=[address]):
        made = device(address, Fix, origin=origin_at(52.0, 10.0), period=0.1)
    return made, lambda n: made(
        "combine.gnss", n * 100_000_000, {"fix": drawn_fix(n * 100_000_000, np.random.default_rng(n))}
    )


def test_tcp_serves_every_client_the_same():
    made, send = served("nmea+tcp://127.0.0.1:0?sentences=GGA,VTG&utc=2026-08-01T06:00:00Z")
    clients = [socket.create_connection(("127.0.0.1", made.port), PATIENCE_S) for _ in range(2)]
    until(lambda: len(made._wire._clients) == 2, "both are served")
    clients[0].sendall(b"hello")  # what a client says does not matter
    send(1)
    heard = [client.recv(4096) for client in clients]
    assert heard[0] == heard[1]
    assert heard[0].startswith(b"$GNGGA,060000.10,52")
    assert heard[0].count(b"\r\n") == 2
    for client in clients:
        client.close()
    made.close()


def test_udp_and_agopengps_send_to_one_address():
    for protocol, name in (("nmea+udp", b"$GNGGA"), ("agopengps", b"$PANDA")):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as heard:
            heard.bind(("127.0.0.1", 0))
            heard.settimeout(PATIENCE_S)
            made, send = served(f"{protocol}://127.0.0.1:{heard.getsockname()[1]}")
            send(1)
            assert heard.recv(4096).startswith(name)
            made.close()


def test_a_terminal_that_nobody_reads_loses_and_says_so(tmp_path):
    path = tmp_path / "gnss"
    made, send = served(f"nmea+pty://{path}")
    reader = os.open(path, os.O_RDONLY | os.O_NOCTTY)
    send(1)
    assert os.read(reader, 4096).startswith(b"$GNGGA")
    for n in range(2, 100):
        send(n)
    assert made.sent_count < 99
    assert [text for _, text in made.events.list] == [
        "nobody reads the terminal: it is full, what comes is lost until somebody does"
    ]
    assert os.read(reader, 4096).startswith(b"$GN")
    os.close(reader)
    made.close()
    assert not path.is_symlink()


def test_a_terminal_takes_the_place_of_no_file(tmp_path):
    (tmp_path / "mine").write_text("x")
    with pytest.raises(SwathError, match="could not be made: File exists"):
        served(f"nmea+pty://{tmp_path / 'mine'}")
    assert (tmp_path / "mine").read_text() == "x"


@pytest.mark.parametrize(
    ("address", "expected"),
    [
        ("nmea+tcp://?sentences=GGA,XYZ", "expected sentences out of GGA, VTG"),
        ("nmea+tcp://?utc=noon", "expected utc as a date and time"),
        ("lms://", "expected a slot such as lidar"),
    ],
)
def test_an_option_that_is_none_is_one_error(address, expected):
    with pytest.raises(InputError, match=expected):
        device(address, Fix, origin=origin_at(52.0, 10.0))


def test_a_field_nowhere_on_earth_has_no_receiver():
    with pytest.raises(InputError, match="expected a field that lies on Earth"):
        device("nmea+tcp://", Fix)


def test_jitter_is_what_the_intervals_are_off(monkeypatch):
    clock = FakeClock()
    monkeypatch.setattr(output, "time", SimpleNamespace(monotonic_ns=clock.now))
    made, _ = served("nmea+udp://127.0.0.1:9")
    for n in range(1, 4):
        made("combine.gnss", n * 10_000_000_000, {"fix": drawn_fix(n, np.random.default_rng(n))})
        clock.sleep(20_000_000)
    assert made.summary()["jitter_ms"]["p50"] == 9_980.0  # 10 s of the run took 0.02 s
    made.close()
