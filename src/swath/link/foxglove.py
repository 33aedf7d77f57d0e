"""A run as a Foxglove WebSocket: what run.mcap gets, live, in the same topics, types and bytes.

    run_job(scenario, out, hooks=[Foxglove()])

Whoever connects can look and change nothing. Foxglove or Lichtblick opens the address as a data source; a
latched topic is sent again to whoever subscribes later. The protocol is foxglove.websocket.v1
(https://github.com/foxglove/ws-protocol/blob/main/docs/spec.md), of which foxglove.sdk.v1 is the newer name.
"""

import json
import re
import struct
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from swath.core.errors import InputError
from swath.core.foreign_code import present_gate
from swath.core.schedule import NS
from swath.core.units import digits_in
from swath.runtime.hooks import ActiveRun, RunHook
from swath.runtime.served import Server, Viewer

ADDRESS = "127.0.0.1:8765"  # the port that Foxglove offers
PROTOCOLS = ("foxglove.sdk.v1", "foxglove.websocket.v1")
ORIGINS = r"https://app\.foxglove\.dev|file://|https?://(localhost|127\.0\.0\.1|\[::1\])(:\d+)?"
TIME_EVERY = NS // 25  # of the run, between two tellings of the time [ns]
BACKLOG = 256  # messages that wait for a client, of which the oldest go first


@dataclass
class Channel:
    """A topic. described: as clients read of it; latched: its newest message, with its time [ns]."""

    number: int
    described: Mapping[str, Any]
    latched: tuple[int, bytes] | None = None


class Client(Viewer):
    """One who looks. wanted: by channel, how its messages begin for him."""

    def __init__(self, connection: Any) -> None:
        super().__init__(connection, frames=BACKLOG, answers=False)
        self.wanted: dict[int, bytes] = {}

    def tell(self, op: str, **more: Any) -> None:
        """Send words of the protocol."""
        self.put(json.dumps({"op": op, **more}))

    def send(self, channel: Channel, t: int, data: bytes) -> None:
        """Send a message where it is wanted."""
        if (head := self.wanted.get(channel.number)) is not None:
            self.show(head + struct.pack("<Q", t) + data)


class Foxglove(RunHook):
    """Run hook. address: host:port to listen at, this machine alone unless another is named.

    count: messages so far. Raises MissingExtra without websockets, SwathError where the port is taken.
    """

    def __init__(self, address: str = ADDRESS) -> None:
        host, _, port = address.rpartition(":")
        if not host or not 0 <= digits_in(port) <= 65_535:
            raise InputError("--foxglove", address, f"expected host:port, such as {ADDRESS}")
        self._channels: dict[str, Channel] = {}
        self._clients: list[Client] = []
        self._lock = threading.Lock()
        self._session = ""
        self._store: Any = None
        self._due = self.count = 0
        self._server = Server(
            self._talk, extra=("foxglove", "the Foxglove WebSocket"), who=f"--foxglove {address}",
            host=host, port=int(port), subprotocols=PROTOCOLS,
            origins="|".join([ORIGINS, *map(re.escape, present_gate().addresses)]),
        )  # fmt: skip
        self.address = self._server.address

    # in the thread of the run

    def begin(self, run: ActiveRun) -> None:
        """Connect to a world at its start; viewers forget what a run before it showed."""
        file = run.recorder.file
        if file is None:
            raise InputError("run.record", "none", "expected messages: --foxglove sends what is recorded")
        self._store, self._due = file.store, 0
        with self._lock:
            self._session = str(time.time_ns())
            for channel in self._channels.values():
                channel.latched = None
            for client in self._clients:
                self._greet(client)
        file.taps.append(self)
        run.world.graph.before_tick.append(self._before_tick)

    def __call__(self, topic: str, t: int, data: bytes, build: Callable[[], Any], is_latched: bool) -> None:
        """Send one message of the recording."""
        if topic not in self._channels:
            self.declare(topic, build(), is_latched)
        with self._lock:
            channel = self._channels[topic]
            if is_latched:
                channel.latched = t, data
            for client in self._clients:
                client.send(channel, t, data)
        self.count += 1

    def declare(self, topic: str, message: Any, is_latched: bool) -> None:
        """Offer a topic whose first message is still to come."""
        if topic in self._channels:
            return
        kind, number = message.__msgtype__, len(self._channels) + 1
        text = self._store.generate_msgdef(kind, ros_version=2)[0]
        offer = {
            "id": number, "topic": topic, "encoding": "cdr",
            "schemaName": kind, "schema": text, "schemaEncoding": "ros2msg",
        }  # fmt: skip
        with self._lock:
            self._channels[topic] = Channel(number, offer)
            for client in self._clients:
                client.tell("advertise", channels=[offer])

    def summarize(self, t: int) -> dict[str, Any]:
        """The entry in summary.json."""
        return {"foxglove": {"messages": self.count}}

    def finish(self, summary: Mapping[str, Any]) -> None:
        """Nothing: viewers keep what they have."""

    def close(self) -> None:
        """No more viewers."""
        self._server.close()

    def _before_tick(self, t: int) -> None:
        if t >= self._due:
            self._due = t + TIME_EVERY
            with self._lock:
                for client in self._clients:
                    client.show(struct.pack("<BQ", 2, t))

    # in the threads of the clients

    def _greet(self, client: Client) -> None:
        client.tell(
            "serverInfo", name="swath", capabilities=["time"], supportedEncodings=[], metadata={},
            sessionId=self._session,
        )  # fmt: skip

    def _talk(self, connection: Any) -> None:
        """Serve a client until it leaves."""
        from websockets.exceptions import ConnectionClosed

        client = Client(connection)
        try:
            with self._lock:
                self._greet(client)
                client.tell("advertise", channels=[c.described for c in self._channels.values()])
                self._clients.append(client)
            for message in connection:
                with suppress(ValueError, LookupError, TypeError, RecursionError, struct.error):  # nonsense
                    self._hear(client, json.loads(message))
        except ConnectionClosed:
            return
        finally:
            with self._lock:
                self._clients.remove(client)
            client.close()

    def _hear(self, client: Client, request: Mapping[str, Any]) -> None:
        """Take what a client wants from now on; what is latched it gets at once."""
        with self._lock:
            known = {channel.number: channel for channel in self._channels.values()}
            if request["op"] == "subscribe":
                for each in request["subscriptions"]:
                    channel = known[each["channelId"]]
                    client.wanted[channel.number] = struct.pack("<BI", 1, each["id"])
                    if channel.latched is not None:
                        client.send(channel, *channel.latched)
            elif request["op"] == "unsubscribe":
                gone = [struct.pack("<BI", 1, number) for number in request["subscriptionIds"]]
                client.wanted = {n: head for n, head in client.wanted.items() if head not in gone}
