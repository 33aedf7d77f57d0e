"""CAN over UDP multicast that stays on this machine, unless it is stated who else is on the bus.

python-can hands on a frame from whoever sends to its port. Here a frame counts when its sender is on this
machine or one of the `peers`; what is no CAN frame is dropped. Frames leave this machine only where there are
peers (hop limit 1 instead of 0). An address proves little on a network that others share.
"""

import socket
from functools import lru_cache
from typing import Any

from can.interfaces.udp_multicast import UdpMulticastBus
from can.interfaces.udp_multicast.utils import unpack_message


class CheckedUdpBus(UdpMulticastBus):  # type: ignore[misc]
    """A bus of classic CAN frames.

    peers: addresses of other machines on it, separated by spaces or commas
    """

    def __init__(self, channel: str, *, peers: str = "", **options: Any) -> None:
        self._peers = frozenset(str(peers).replace(",", " ").split())
        super().__init__(channel, **{"fd": False, "hop_limit": 1 if self._peers else 0, **options})

    def _recv_internal(self, timeout: float | None) -> tuple[Any, bool]:
        """One frame, None for one that does not count; as python-can asks for it."""
        received = self._multicast.recv(timeout)
        if received is None:
            return None, False
        data, sender, t = received
        if sender[0] not in self._peers and not is_local(sender[0], *sender[2:]):
            return None, False
        try:
            message = unpack_message(data, replace={"timestamp": t}, check=True)
        except Exception:  # whatever msgpack and python-can say about a foreign datagram
            return None, False
        return (None if message.is_fd else message), False


@lru_cache(maxsize=256)
def is_local(host: str, *scope: int) -> bool:
    """Whether an address is one of this machine: only those can be bound. scope: flow and scope of IPv6."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        with socket.socket(family, socket.SOCK_DGRAM) as probe:
            probe.bind((host, 0, *scope))
    except OSError:
        return False
    return True
