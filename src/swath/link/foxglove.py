"""A run as a Foxglove WebSocket: what run.mcap gets, live, in the same topics, types and bytes.

    run_job(scenario, out, hooks=[Foxglove()])

Whoever connects can look and change nothing. Foxglove or Lichtblick opens the address as a data source; a
latched topic is sent again to whoever subscribes later.
"""

import threading
from collections.abc import Callable, Mapping
from typing import Any

from swath.core.errors import InputError, MissingExtra, SwathError
from swath.core.schedule import NS
from swath.runtime.hooks import ActiveRun, RunHook

ADDRESS = "127.0.0.1:8765"  # the port that Foxglove offers
TIME_EVERY = NS // 25  # of the run, between two tellings of the time [ns]
BACKLOG = 256  # messages that wait for a client, of which the oldest go first


class Foxglove(RunHook):
    """Run hook. address: host:port to listen at, this machine alone unless another is named.

    count: messages so far. Raises MissingExtra without foxglove-sdk, SwathError where the port is taken.
    """

    def __init__(self, address: str = ADDRESS) -> None:
        try:
            import foxglove
            from foxglove.websocket import Capability
        except ImportError as error:
            raise MissingExtra("foxglove", "the Foxglove WebSocket") from error
        host, _, port = address.rpartition(":")
        if not host or not port.isdigit() or int(port) > 65_535:
            raise InputError("--foxglove", address, f"expected host:port, such as {ADDRESS}")
        self._sdk, self._context = foxglove, foxglove.Context()
        foxglove.set_log_level("ERROR")
        self._channels: dict[str, Any] = {}
        self._latched: dict[int, tuple[Any, bytes, int]] = {}  # by channel id: channel, newest message, time
        self._lock = threading.Lock()
        self._store: Any = None
        self._due = self.count = 0
        try:
            self._server = foxglove.start_server(
                name="swath", host=host, port=int(port), capabilities=[Capability.Time],
                server_listener=self, context=self._context, message_backlog_size=BACKLOG,
            )  # fmt: skip
        except Exception as error:  # of a kind that the package does not name
            raise SwathError(f"--foxglove {address}: could not listen: {error}") from error
        self.address = f"ws://{host}:{self._server.port}"

    # in the thread of the run

    def begin(self, run: ActiveRun) -> None:
        """Connect to a world at its start; viewers forget what a run before it showed."""
        file = run.recorder.file
        if file is None:
            raise InputError("run.record", "none", "expected messages: --foxglove sends what is recorded")
        self._store, self._due = file.store, 0
        with self._lock:
            self._latched.clear()
        self._server.clear_session()
        file.taps.append(self)
        run.world.graph.before_tick.append(self._before_tick)

    def __call__(self, topic: str, t: int, data: bytes, build: Callable[[], Any], is_latched: bool) -> None:
        """Send one message of the recording."""
        channel = self._channels.get(topic)
        if channel is None:
            channel = self._declare(topic, build().__msgtype__)
        if is_latched:
            with self._lock:
                self._latched[channel.id()] = (channel, data, t)
        channel.log(data, log_time=t)
        self.count += 1

    def declare(self, topic: str, message: Any, is_latched: bool) -> None:
        """Offer a topic whose first message is still to come."""
        if topic not in self._channels:
            self._declare(topic, message.__msgtype__)

    def summarize(self, t: int) -> dict[str, Any]:
        """The entry in summary.json."""
        return {"foxglove": {"messages": self.count}}

    def finish(self, summary: Mapping[str, Any]) -> None:
        """Nothing: viewers keep what they have."""

    def close(self) -> None:
        """No more viewers."""
        self._server.stop()

    def _declare(self, topic: str, msgtype: str) -> Any:
        text = self._store.generate_msgdef(msgtype, ros_version=2)[0].encode()
        schema = self._sdk.Schema(name=msgtype, encoding="ros2msg", data=text)
        channel = self._sdk.Channel(topic, schema=schema, message_encoding="cdr", context=self._context)
        self._channels[topic] = channel
        return channel

    def _before_tick(self, t: int) -> None:
        if t >= self._due:
            self._due = t + TIME_EVERY
            self._server.broadcast_time(t)

    # in a thread of the server

    def on_unsubscribe(self, client: Any, channel: Any) -> None:
        """Nothing is kept for a viewer."""

    def on_subscribe(self, client: Any, channel: Any) -> None:
        """A viewer that comes later gets the newest message of a latched topic."""
        with self._lock:
            known = self._latched.get(channel.id)
        if known is not None:
            own, data, t = known
            own.log(data, log_time=t)
