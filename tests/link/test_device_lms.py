"""A slot as a SICK LMS: an independent client, the vendor's own example, clients that hang, garbage."""

import socket
from contextlib import ExitStack, suppress

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swath.core.errors import InputError, SwathError
from swath.core.foreign_code import allow_code
from swath.link import foxglove
from swath.link.device import cola, lms
from swath.link.device.address import read_address
from swath.link.device.output import PROTOCOLS
from swath.link.device.wires import BUFFER, MOST_CLIENTS
from swath.link.levels import agopengps
from swath.runtime.served import bound
from swath.signals import Scan
from tests.link.device_rig import STEP, device, plane_scan
from tests.link.independent_lms import Lms, Refused, scan_of
from tests.waiting import PATIENCE_S, until

# Telegram listing 8014631, example of sRN LMDscandata: 21 values from 10 deg on, every 0.5 deg, 50 Hz.
EXAMPLE = (
    b"sRA LMDscandata 1 1 89A27F 0 0 343 347 27477BA9 2747813B 0 0 7 0 0 1388 168 0 1 DIST1 3F800000 "
    b"00000000 186A0 1388 15 8A1 8A5 8AB 8AC 8A6 8AC 8B6 8C8 8C2 8C9 8CB 8C4 8E4 8E1 8EB 8E0 8F5 908 8FC "
    b"907 906 0 0 0 0 0 0"
)


@pytest.fixture
def served():
    """A sensor that has made its first scan, and its scans by number."""
    made, rng = device("lms://127.0.0.1:0", Scan), np.random.default_rng(1)
    scans = {n: plane_scan(n * STEP, rng, echoes=3) for n in range(9)}
    made("combine.slot", 0, {"scan": scans[0]})
    yield made, lambda n: made("combine.slot", n * STEP, {"scan": scans[n]}), scans
    made.close()


def client_of(made, *, binary=True):
    return Lms("127.0.0.1", made.port, is_binary=binary)


def refusal(client, command, *parameters):
    """The error code of a command."""
    client.send(command, *parameters)
    with pytest.raises(Refused) as refused:
        client.receive()
    return refused.value.code


@pytest.mark.parametrize("binary", [False, True])
def test_a_client_of_the_vendor_s_description_gets_every_scan(served, binary):
    made, send, scans = served
    with client_of(made, binary=binary) as client:
        client.login()
        client.stream(is_on=True)
        for n in (1, 2):
            send(n)
            told, scan = client.scan(), scans[n]
            dist = told.channels16["DIST1"]
            assert (dist.offset, dist.start, dist.step, len(dist.data)) == (0.0, 0, 5000, 361)
            assert (told.scan_hz, told.scans, told.sent) == (25.0, n - 1, n * STEP // 1000)
            assert abs(told.sent - told.since_start - 20_000) <= 1  # half a turn of 40 ms
            first = np.nan_to_num(scan.ranges[:, 0].astype(float) * 1000)
            np.testing.assert_allclose(np.array(dist.data) * dist.scale, first, atol=0.5)
            rssi = np.array(told.channels16["RSSI1"].data) / lms.RSSI_WHITE
            np.testing.assert_allclose(rssi, np.nan_to_num(scan.intensity[:, 0].astype(float)), atol=1e-4)
        client.stream(is_on=False)


@pytest.mark.parametrize("binary", [False, True])
def test_what_a_client_configures_is_what_it_gets(served, binary):
    made, send, scans = served
    with client_of(made, binary=binary) as client:
        client.login()
        client.output_range((5000, 450_000, 1_350_000))
        client.data_config(rssi_bits=8, every=2)
        client.done("sWN FREchoFilter", ("B", 2))
        assert client.scan_config() == (2500, 5000, 0, 1_800_000)
        client.stream(is_on=True)
        send(1), send(2), send(3)
        told = [client.scan(), client.scan()]
    assert [t.sent for t in told] == [STEP // 1000, 3 * STEP // 1000]
    dist = told[0].channels16["DIST1"]
    assert (dist.start, len(dist.data)) == (450_000, 181)
    last = np.nan_to_num(np.nanmax(np.where(np.isnan(r := scans[1].ranges), -np.inf, r), axis=1).clip(0))
    np.testing.assert_allclose(np.array(dist.data) * dist.scale, last[90:271].astype(float) * 1000, atol=0.5)
    assert max(told[0].channels8["RSSI1"].data) <= 200  # 100 for white, 2 at most here


def test_a_scan_on_request_and_what_is_refused(served):
    made, send, _ = served
    with client_of(made, binary=False) as client:
        client.send("sRN LMDscandata")  # none yet: the first answers it
        assert refusal(client, "sRN Nonsense") == 3
        send(1)
        *_, fields = client.receive()
        assert scan_of("sRA", fields).sent == client.one_scan().sent == STEP // 1000
        sector = ("h", 1), ("i", 5000), ("i", 0), ("i", 0)
        assert refusal(client, "sWN LMPoutputRange", *sector) == 1  # not logged in
        client.done("sMN SetAccessMode", ("B", 3), ("I", 0), result=("B", (0,)))
        for command, code in (("sRN Nonsense", 3), ("sMN Nonsense", 2), ("sXX LMDscandata", 12)):
            assert refusal(client, command) == code
        assert refusal(client, "sEN Nonsense", ("B", 1)) == 15
        assert refusal(client, "sMN SetAccessMode") == 5
        client.login()
        wanted = ("i", 5000), ("h", 1), ("i", 5000), ("i", -450_000), ("i", 2_250_000)
        answer = client.ask("sMN mLMPsetscancfg", *wanted)
        told = [answer.number(name, code) for name, code in (("status", "B"), ("frequency", "I"))]
        assert told == [1, 2500]  # the scenario says 25 Hz
    assert any("the scenario says 25 Hz" in text for _, text in made.events.list)


@pytest.mark.parametrize(
    ("address", "identity", "name"),
    [
        ("lms://127.0.0.1:0", "LMS5xx_FieldEval_PRO", "LMS5xx_FieldEval_PRO"),
        ("lms://127.0.0.1:0", "", "LMS"),
        ("lms://127.0.0.1:0?model=LMS10x_FieldEval", "LMS5xx_FieldEval_PRO", "LMS10x_FieldEval"),
    ],
)
def test_it_tells_the_name_of_its_sheet(address, identity, name):
    made = device(address, Scan, identity=identity)
    made("combine.slot", 0, {"scan": plane_scan(0, np.random.default_rng(5))})
    with client_of(made) as client:
        assert client.identity()[0] == name
    made.close()


def test_another_level_with_other_beams_goes_on(served):
    made, send, _ = served
    with client_of(made) as client:
        client.stream(is_on=True)
        send(1)
        other = plane_scan(2 * STEP, np.random.default_rng(4), count=181)
        made("combine.slot", 2 * STEP, {"scan": other})
        assert [len(client.scan().channels16["DIST1"].data) for _ in range(2)] == [361, 181]
    assert any("181 beams now, 361 before" in text for _, text in made.events.list)


def test_the_vendor_s_example_is_understood():
    told = lms.read_scan(cola.Values(EXAMPLE, binary=False))
    assert told.frequency == 50.0
    assert (told.begun, told.sent, told.counter) == (0x27477BA9, 0x2747813B, 0x347)
    np.testing.assert_allclose(np.degrees(told.start), 10.0 - 90.0)
    np.testing.assert_allclose(np.degrees(told.step), 0.5)
    np.testing.assert_allclose(told.ranges[:3, 0], [2.209, 2.213, 2.219])
    assert told.ranges.shape == (21, 1)
    assert np.isnan(told.intensity).all()


def test_two_clients_in_two_dialects_and_one_more_than_there_is_room_for(served):
    made, send, _ = served
    with ExitStack() as held:
        clients = [held.enter_context(client_of(made, binary=n % 2 == 0)) for n in range(MOST_CLIENTS)]
        for client in clients:
            client.stream(is_on=True)
        with socket.create_connection(("127.0.0.1", made.port), PATIENCE_S) as extra:
            assert extra.recv(10) == b""
        send(1)
        found = [client.scan() for client in clients]
    assert all(f == found[0] for f in found)
    assert any("was refused: there are 8 already" in text for _, text in made.events.list)
    until(lambda: not made._server.has_client(), "all have left")
    with client_of(made) as client:
        assert client.ask("sRN SCdevicestate").number("state", "B") == 1


def test_a_client_that_hangs_is_let_go_and_holds_nobody_up(served):
    made, _, scans = served
    with client_of(made, binary=False) as hung, client_of(made) as client:
        hung.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        hung.stream(is_on=True), client.stream(is_on=True)
        for n in range(1, 2000):
            made("combine.slot", n * STEP, {"scan": scans[1]})
            assert client.scan().scans == (n - 1) & 0xFFFF
            if any("does not read" in text for _, text in made.events.list):
                break
        else:
            pytest.fail("it was never let go")
    assert n * 3000 > BUFFER


@given(st.binary(max_size=400), st.integers(0, 400))
def test_garbage_between_telegrams_loses_none_of_those_behind_it(noise, cut):
    """Whatever comes before: a telegram that is whole, once what was begun has ended, is found."""
    good = cola.telegram("sRN", "DeviceIdent", binary=True)
    splitter = cola.Splitter()
    stream = noise + b"\x03" + bytes(cola.LONGEST + 9) + good
    found = splitter.feed(stream[:cut]) + splitter.feed(stream[cut:])
    assert found[-1] == (b"sRN DeviceIdent", True)


@given(st.binary(max_size=200), st.booleans())
def test_no_telegram_breaks_a_session(content, binary):
    told = []
    scan = plane_scan(STEP, np.random.default_rng(2), count=11)
    session = lms.Session(lms.plane_of(scan, "LMS1xx", 0.04, 40.0), lambda: (scan, 1), told.append)
    for command in (b"", b"sRN ", b"sWN LMDscandatacfg ", b"sMN SetAccessMode ", b"sEN LMDscandata "):
        session.feed(cola.framed(command + content, binary=binary))
    with np.errstate(all="raise"), suppress(cola.Garbage):
        lms.read_scan(cola.Values(b"sRA LMDscandata " + content, binary=binary))


def test_what_cannot_be_a_sensor_is_refused():
    rng = np.random.default_rng(3)
    uneven = plane_scan(0, rng)
    uneven = Scan(0, uneven.beam_t, uneven.azimuth**3, uneven.elevation, uneven.ranges, uneven.intensity)
    made = device("lms://127.0.0.1:0", Scan)
    with pytest.raises(InputError, match="one plane at even angles"):
        made("combine.slot", 0, {"scan": uneven})
    made.close()
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(SwathError, match=f"127.0.0.1:{port}: could not listen: the port is in use"):
            device(f"lms://127.0.0.1:{port}", Scan)


@pytest.mark.parametrize(
    ("address", "expected"),
    [
        ("lms", "expected lms://, velodyne://, nmea://, agopengps://"),
        ("sick://", "expected lms://"),
        ("lms+udp://", "expected lms[+]tcp://"),
        ("lms://127.0.0.1:99999", "expected protocol://host:port"),
        ("lms://?cola=c", "unknown"),
        ("lms://?wait_s=-1", "expected wait_s to be a number from 0 to 3600"),
        ("nmea+pty://", "expected nmea[+]pty://PATH"),
        ("nmea://", "expected a slot such as gnss"),
    ],
)
def test_an_address_that_is_none_is_one_error(address, expected):
    with pytest.raises(InputError, match=expected):
        device(address, Scan)


@pytest.mark.parametrize("host", ["", "0.0.0.0"])
@pytest.mark.parametrize("address", ["lms://{}:0", "nmea+tcp://{}:0", "velodyne://{}:0", "nmea+udp://{}:0"])
def test_it_listens_on_this_machine_alone_unless_an_address_is_named(address, host):
    with allow_code((), addresses=[address.format("0.0.0.0")]):
        where = read_address(address.format(host), PROTOCOLS)
    with bound(where.host, where.port, socket.SOCK_STREAM, "device") as made:
        assert made.getsockname()[0] == (host or "127.0.0.1")


def test_agopengps_and_foxglove_are_heard_on_this_machine_alone_unless_an_address_is_named():
    assert agopengps.Params().listen == "127.0.0.1:8888"
    assert agopengps.Params().reply == "127.0.0.1:9999"
    assert foxglove.ADDRESS == "127.0.0.1:8765"
