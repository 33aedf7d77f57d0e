"""One node on a CAN bus: sends and receives messages by name, under an address of its own."""

import os
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from importlib.util import find_spec
from ipaddress import ip_address
from typing import Any

from swath.core.errors import InputError, MissingExtra, SwathError
from swath.core.foreign_code import need_named
from swath.documents import j1939
from swath.link.can.codec import Codec, Values

Option = str | int | float | bool
CLAIM = "AddressClaimed"
RAW_PRIORITY = {0xCB00: 3, 0xEC00: 7, 0xEB00: 7}  # process data; transport protocol. Others: 6


@dataclass(frozen=True)
class Where:
    """A bus as python-can names it. options: further keys of its interface, e.g. bitrate, port."""

    interface: str
    channel: str
    options: Mapping[str, Option] = field(default_factory=dict)

    def __str__(self) -> str:
        return f"{self.interface} {self.channel}"


@dataclass(frozen=True)
class Message:
    """A received message.

    name: as in the DBC; "" for a parameter group that the node takes raw
    values: by signal; of `AddressClaimed` only `device_class`, of a raw group none
    source, destination: addresses
    pgn, data: of a raw group: its number and its bytes
    """

    name: str
    values: Values
    source: int
    destination: int
    pgn: int = 0
    data: bytes = b""


class Node:
    """A control function with a fixed address. Its own frames, which some interfaces echo, are left out.

    raw: parameter groups that are received as they are
    """

    def __init__(
        self, where: Where, address: int, *, device_class: int, raw: frozenset[int] = frozenset()
    ) -> None:
        self.where, self.address, self._raw = where, address, raw
        self.name = j1939.name(device_class=device_class, identity=address)
        self._codec = Codec()
        self._bus = open_bus(where)

    def send(self, name: str, values: Mapping[str, float | None]) -> None:
        """Broadcast a message."""
        pgn, priority = self._codec.header(name)
        self._put(j1939.Header(pgn, priority, self.address), self._codec.encode(name, values))

    def send_raw(self, pgn: int, data: bytes, destination: int = j1939.GLOBAL) -> None:
        """Send 8 bytes as they are."""
        self._put(j1939.Header(pgn, RAW_PRIORITY.get(pgn, 6), self.address, destination), data)

    def claim(self) -> None:
        """Broadcast the address claim. Addresses are fixed: a competing claim is not arbitrated."""
        self._put(j1939.Header(j1939.ADDRESS_CLAIMED, 6, self.address), self.name)

    def request_claims(self) -> None:
        """Request the address claims of all nodes."""
        self._put(j1939.Header(j1939.REQUEST, 6, self.address), j1939.ADDRESS_CLAIMED.to_bytes(3, "little"))

    def receive(self, timeout: float = 0.0) -> Message | None:
        """The next message for us, None when there is none within `timeout` [s].

        Requests for the address claim are answered on the way.
        """
        until = time.monotonic() + timeout
        while True:
            frame = self._get(max(0.0, until - time.monotonic()))
            if frame is None:
                return None
            message = self._read(frame)
            if message is not None:
                return message

    def close(self) -> None:
        """Leave the bus. Calling it again does nothing."""
        bus, self._bus = self._bus, None
        if bus is not None:
            bus.shutdown()

    def _read(self, frame: Any) -> Message | None:
        header, data = j1939.parse(frame.arbitration_id), bytes(frame.data)
        is_other = frame.is_extended_id and not frame.is_error_frame and header.source != self.address
        if not is_other or header.destination not in (self.address, j1939.GLOBAL):
            return None
        if header.pgn == j1939.REQUEST and int.from_bytes(data[:3], "little") == j1939.ADDRESS_CLAIMED:
            self.claim()
            return None
        if header.pgn == j1939.ADDRESS_CLAIMED and len(data) == 8:
            values: Values = {"device_class": float(j1939.device_class(data))}
            return Message(CLAIM, values, header.source, header.destination)
        if header.pgn in self._raw and len(data) == 8:
            return Message("", {}, header.source, header.destination, header.pgn, data)
        decoded = self._codec.decode(header.pgn, data)
        return None if decoded is None else Message(*decoded, header.source, header.destination)

    def _put(self, header: j1939.Header, data: bytes) -> None:
        import can

        frame = can.Message(arbitration_id=header.identifier, data=data, is_extended_id=True)
        try:
            self._open().send(frame)
        except (can.CanError, OSError) as error:
            raise SwathError(f"CAN bus {self.where}: could not send: {error}") from error

    def _get(self, timeout: float) -> Any:
        import can

        try:
            return self._open().recv(timeout)
        except (can.CanError, OSError) as error:
            raise SwathError(f"CAN bus {self.where}: could not receive: {error}") from error

    def _open(self) -> Any:
        if self._bus is None:
            raise SwathError(f"CAN bus {self.where}: it is closed")
        return self._bus


def check_bus(where: Where) -> Where:
    """Return the bus that was given, once it may be opened.

    A virtual bus may. Any other has to be named by the user, and so has each text among its options, which an
    interface may take for a file or a library: NotNamed otherwise. InputError when python-can has no such
    interface, MissingExtra when python-can is not installed.
    """
    if find_spec("can") is None or find_spec("cantools") is None:
        raise MissingExtra("can", "a CAN bus")
    import can

    names = sorted(can.VALID_INTERFACES)
    if where.interface not in names:
        raise InputError("interface", where.interface, f"expected one of {', '.join(names)}")
    if not _is_free(where):
        need_named("channel", f"{where.interface}:{where.channel}", where.interface, where.channel)
    for key, value in where.options.items():
        if isinstance(value, str) or (key == "hop_limit" and value):
            need_named(f"options.{key}", str(value))
    return where


def _is_free(where: Where) -> bool:
    """Whether a bus is virtual, or of datagrams that stay on this machine unless `hop_limit` says else."""
    if where.interface == "socketcan":
        return where.channel.startswith("vcan")
    with suppress(ValueError):
        return where.interface == "virtual" or (
            where.interface == "udp_multicast" and ip_address(where.channel).is_multicast
        )
    return False


def open_bus(where: Where) -> Any:
    """Open the bus with python-can. SwathError with the reason when it cannot be opened."""
    import can

    options: dict[str, Any] = dict(where.options)
    try:
        if where.interface == "udp_multicast":
            from swath.link.can.udp import CheckedUdpBus

            return CheckedUdpBus(where.channel, **options)
        is_in_folder = os.name == "nt"  # where python-can's own settings are looked for there, too
        return can.Bus(where.channel, where.interface, ignore_config=is_in_folder, **options)
    except (can.CanError, OSError, ValueError, TypeError, ImportError) as error:
        raise SwathError(f"CAN bus {where}: could not be opened: {error}") from error
