"""CAN over UDP multicast: what comes from elsewhere or is no frame does not count, and nothing leaves."""

import os
import socket

import pytest

from swath.core.errors import SwathError
from swath.link.can import guidance
from swath.link.can.bus import Node, Where
from tests.link.device_rig import free_port

pytest.importorskip("can")
pytest.importorskip("msgpack")
from swath.link.can import udp
from tests.waiting import PATIENCE_S

GROUP = "239.74.163.2"


@pytest.fixture
def port():
    return free_port(socket.SOCK_DGRAM)


@pytest.fixture
def nodes(port):
    made = []

    def make(address, **options):
        try:
            made.append(
                Node(Where("udp_multicast", GROUP, {"port": port, **options}), address, device_class=0)
            )
            made[-1].send(guidance.WHEEL, {})
        except SwathError as error:
            pytest.skip(f"no multicast here: {error}")
        return made[-1]

    yield make
    for node in made:
        node.close()


def sent_and_heard(nodes, monkeypatch, *, is_local, wait_s=PATIENCE_S, **options):
    hearer, speaker = nodes(28, **options), nodes(240)
    while hearer.receive(0.05):
        pass
    monkeypatch.setattr(udp, "is_local", lambda *address: is_local)
    speaker.send(guidance.WHEEL, guidance.speed_values("Wheel", 2.0, 0.0))
    return hearer.receive(wait_s)


def test_a_sender_on_this_machine_is_heard(nodes, monkeypatch):
    heard = sent_and_heard(nodes, monkeypatch, is_local=True)
    assert heard.values["WheelBasedSpeed"] == 2.0


def test_one_from_elsewhere_is_not(nodes, monkeypatch):
    assert sent_and_heard(nodes, monkeypatch, is_local=False, wait_s=0.3) is None


def test_unless_it_is_named(nodes, monkeypatch):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.connect((GROUP, 9))
        peers = f"192.0.2.9, {probe.getsockname()[0]}"
    assert sent_and_heard(nodes, monkeypatch, is_local=False, peers=peers) is not None


def test_what_is_no_frame_is_dropped(nodes, port):
    node = nodes(28)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        for data in (b"", b"\xc1", b"\x80", b"hello" * 100, b"\x85" + bytes(40)):
            stranger.sendto(data, ("127.0.0.1", port))
    assert node.receive(0.2) is None
    other = nodes(240)
    other.send(guidance.WHEEL, {})
    assert node.receive(PATIENCE_S) is not None


@pytest.mark.parametrize(("peers", "hops"), [("", 0), ("192.0.2.7", 1)])
def test_frames_leave_the_machine_only_for_peers(peers, hops, port):
    bus = udp.CheckedUdpBus(GROUP, peers=peers, port=port)
    try:
        with socket.socket(fileno=os.dup(bus.fileno())) as found:
            assert found.getsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL) == hops
    finally:
        bus.shutdown()


def test_which_addresses_are_local():
    assert udp.is_local("127.0.0.1")
    assert not udp.is_local("192.0.2.1")
    assert not udp.is_local("2001:db8::1", 0, 0)
