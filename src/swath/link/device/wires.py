"""How bytes go out of a run and come into one: TCP, UDP and pseudo terminals, which never hold the run up.

A server listens and answers in a thread of its own; what a run sends goes out at once from the run's thread,
and what a client does not take waits in a buffer of BUFFER bytes, beyond which the client is let go.
"""

import os
import selectors
import socket
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, Protocol

from swath.core.errors import SwathError
from swath.link.device.address import Address
from swath.runtime.served import bound, resolved

BUFFER = 1 << 18  # bytes that wait for a client
MOST_CLIENTS = 8
MOST_EVENTS = 100  # that are kept
POLL_S = 0.5
FLUSH_S = 0.05  # between two tries to send what a client did not take
DATAGRAM = 1 << 16
MOST_WAITING = 4096  # pieces that came in and were not taken

Tell = Callable[[str], None]


class Events:
    """What happened on a wire, for the user: (simulated time [s], text), the first MOST_EVENTS of them."""

    def __init__(self) -> None:
        self.t = 0  # simulated [ns], set by the thread of the run
        self.list: list[tuple[float, str]] = []
        self.left_out = 0
        self._lock = threading.Lock()

    def __call__(self, text: str) -> None:
        """Note one more event, from any thread."""
        with self._lock:
            if len(self.list) < MOST_EVENTS:
                self.list.append((self.t * 1e-9, text))
            else:
                self.left_out += 1


class Session(Protocol):
    """What a server knows of a client: takes its bytes and gives the answer."""

    def feed(self, data: bytes) -> bytes:
        """Answer to the bytes of a client."""


class Client:
    """A connection. waiting: bytes that it has not taken yet."""

    def __init__(self, connection: socket.socket, name: str, session: Any) -> None:
        self.connection, self.name, self.session = connection, name, session
        self.waiting = b""


class TcpServer:
    """Listens, and once it is started serves every client by a session of its own; until then they wait.

    SwathError where the port cannot be had.
    """

    def __init__(self, where: Address, make_session: Callable[[], Session], tell: Tell) -> None:
        self._make, self._tell = make_session, tell
        self._clients: list[Client] = []
        self._lock = threading.RLock()
        self._socket = bound(where.host, where.port, socket.SOCK_STREAM, f"device {where}")
        self._socket.most, self._socket.refused = MOST_CLIENTS, tell
        self.port = int(self._socket.getsockname()[1])
        self._thread = threading.Thread(target=self._accept, name=f"device {where}", daemon=True)

    def start(self) -> None:
        """Serve from now on; again it does nothing."""
        if self._socket.fileno() >= 0 and self._thread.ident is None:
            self._thread.start()

    def send(self, make: Callable[[Any], bytes]) -> int:
        """Give every client what `make(session)` says, nothing where that is empty; how many got some."""
        count = 0
        with self._lock:
            for client in list(self._clients):
                data = make(client.session)
                if data:
                    count += self._put(client, data)
        return count

    def has_client(self, wanted: Callable[[Any], bool] = lambda session: True) -> bool:
        """Whether there is a client of which `wanted(session)` is true."""
        with self._lock:
            return any(wanted(client.session) for client in self._clients)

    def close(self) -> None:
        """Let all clients go."""
        self._socket.close()
        if self._thread.ident is not None:
            self._thread.join(2.0)
        with self._lock:
            for client in self._clients:
                client.connection.close()
            self._clients.clear()

    def _put(self, client: Client, data: bytes) -> bool:
        """Send what waits and more, as far as it goes; False where the client is lost."""
        client.waiting += data
        try:
            while client.waiting:
                sent = client.connection.send(client.waiting)
                client.waiting = client.waiting[sent:]
        except (BlockingIOError, InterruptedError):
            pass
        except OSError as error:
            return self._lose(client, f"is gone ({error.strerror or error})")
        if len(client.waiting) > BUFFER:
            return self._lose(client, f"does not read: let go with {len(client.waiting)} bytes unsent")
        return True

    def _lose(self, client: Client, text: str) -> bool:
        self._tell(f"{client.name} {text}")
        self._clients.remove(client)
        client.connection.close()
        return False

    def _accept(self) -> None:
        with suppress(OSError):  # it is closed
            while True:
                threading.Thread(target=self._serve, args=self._socket.accept(), daemon=True).start()

    def _serve(self, connection: socket.socket, peer: Any) -> None:
        connection.setblocking(False)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        client = Client(connection, f"client {peer[0]}:{peer[1]}", self._make())
        with self._lock:
            self._clients.append(client)
        self._tell(f"{client.name} has connected")
        with (
            suppress(OSError, ValueError),
            selectors.DefaultSelector() as selector,
        ):  # closed by another thread
            selector.register(connection, selectors.EVENT_READ)
            while True:
                is_read = selector.select(FLUSH_S)
                with self._lock:
                    if client not in self._clients or not self._hear(client, bool(is_read)):
                        return

    def _hear(self, client: Client, is_read: bool) -> bool:
        """Take what a client says, and send what waits for it; False where it is lost."""
        try:
            data = client.connection.recv(DATAGRAM) if is_read else None
        except (BlockingIOError, InterruptedError):
            return True
        except OSError as error:
            return self._lose(client, f"is gone ({error.strerror or error})")
        if data == b"":
            return self._lose(client, "has left")
        return self._put(client, client.session.feed(data) if data else b"")


class UdpSender:
    """Sends datagrams to one address, whether anybody is there or not."""

    def __init__(self, where: Address, tell: Tell) -> None:
        self._where, self._tell = where, tell
        self._to = resolved(where.host, where.port, socket.SOCK_DGRAM, f"device {where}")
        self._socket = socket.socket(self._to[0], socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._is_told = False

    def send(self, data: bytes) -> int:
        """Send one datagram; returns 1 where it went out."""
        try:
            self._socket.sendto(data, self._to[1])
        except OSError as error:
            if not self._is_told:
                self._tell(
                    f"a datagram could not be sent ({error.strerror or error}); further ones are not reported"
                )
            self._is_told = True
            return 0
        return 1

    def close(self) -> None:
        """Nothing more is sent."""
        self._socket.close()


class Terminal:
    """A pseudo terminal under a link of the user's name; what nobody reads is lost."""

    def __init__(self, where: Address, tell: Tell) -> None:
        import tty

        self._path, self._tell = Path(where.path), tell
        self._ours, self._theirs = os.openpty()
        tty.setraw(self._theirs)
        os.set_blocking(self._ours, False)
        try:
            if os.path.islink(self._path) and not os.path.exists(self._path):  # of a run that was killed
                self._path.unlink()
            self._path.symlink_to(os.ttyname(self._theirs))
        except OSError as error:
            os.close(self._ours)
            os.close(self._theirs)
            raise SwathError(f"device {where}: could not be made: {error.strerror or error}") from error
        self.lost = 0

    def send(self, data: bytes) -> int:
        """Write; returns 1 where it went in."""
        try:
            os.write(self._ours, data)
        except BlockingIOError:
            if not self.lost:
                self._tell("nobody reads the terminal: it is full, what comes is lost until somebody does")
            self.lost += 1
            return 0
        return 1

    def close(self) -> None:
        """Take the terminal and its link away."""
        if self._ours < 0:
            return
        with suppress(OSError):
            self._path.unlink()
        os.close(self._ours)
        os.close(self._theirs)
        self._ours = self._theirs = -1


class Reader:
    """Bytes from outside, each piece with the time of its arrival, taken in by a thread of its own.

    TCP: a client that connects again where it was cut off; `hello` is sent at every connection. UDP: listens.
    pty: a serial port or terminal, as it is set.
    """

    def __init__(self, where: Address, tell: Tell, *, hello: bytes = b"") -> None:
        self._where, self._tell, self._hello = where, tell, hello
        self._pieces: deque[tuple[int, bytes, Any]] = deque(maxlen=MOST_WAITING)
        self._arrived = threading.Event()
        self._is_open = True
        self._socket: socket.socket | None = (
            bound(where.host, where.port, socket.SOCK_DGRAM, f"device {where}")
            if where.transport == "udp"
            else None
        )
        self.port = 0 if self._socket is None else int(self._socket.getsockname()[1])
        run = {"tcp": self._read_tcp, "udp": self._read_udp, "pty": self._read_terminal}[where.transport]
        self._thread = threading.Thread(target=run, name=f"device {where}", daemon=True)
        self._thread.start()

    def take(self) -> list[tuple[int, bytes, Any]]:
        """What has come since the last call: monotonic time [ns], bytes, sender of a datagram."""
        self._arrived.clear()
        found = []
        while self._pieces:
            found.append(self._pieces.popleft())
        return found

    def wait(self, seconds: float) -> bool:
        """Whether something has come within a time [s]."""
        return bool(self._pieces) or self._arrived.wait(seconds)

    def close(self) -> None:
        """Take no more."""
        self._is_open = False
        self._thread.join(2.0 * POLL_S + 1.0)
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _came(self, data: bytes, sender: Any = None) -> None:
        self._pieces.append((time.monotonic_ns(), data, sender))
        self._arrived.set()

    def _read_udp(self) -> None:
        assert self._socket is not None
        self._socket.settimeout(POLL_S)
        while self._is_open:
            try:
                data, sender = self._socket.recvfrom(DATAGRAM)
            except TimeoutError:
                continue
            except OSError:
                return
            self._came(data, sender)

    def _read_tcp(self) -> None:
        is_told = False
        while self._is_open:
            try:
                host, port = self._where.host, self._where.port
                family, where = resolved(host, port, socket.SOCK_STREAM, f"device {self._where}")
                with socket.socket(family, socket.SOCK_STREAM) as connection:
                    connection.settimeout(POLL_S)
                    connection.connect(where)
                    is_told = False
                    self._tell("connected")
                    if self._hello:
                        connection.sendall(self._hello)
                    self._read_connection(connection)
            except (OSError, SwathError) as error:
                if not is_told:
                    self._tell(
                        f"not connected: {getattr(error, 'strerror', None) or error}; it is tried again"
                    )
                is_told = True
            if self._is_open:
                time.sleep(0.2)

    def _read_connection(self, connection: socket.socket) -> None:
        while self._is_open:
            try:
                data = connection.recv(DATAGRAM)
            except TimeoutError:
                continue
            except OSError as error:
                self._tell(f"the connection broke off: {error.strerror or error}")
                return
            if not data:
                self._tell("the device has closed the connection")
                return
            self._came(data)

    def _read_terminal(self) -> None:
        import select

        is_told = False
        while self._is_open:
            try:
                file = os.open(self._where.path, os.O_RDONLY | os.O_NOCTTY | os.O_NONBLOCK)
            except OSError as error:
                if not is_told:
                    self._tell(f"{self._where.path} could not be opened: {error.strerror}; it is tried again")
                is_told = True
                time.sleep(0.2)
                continue
            is_told = False
            try:
                while self._is_open:
                    if select.select([file], [], [], POLL_S)[0]:
                        data = os.read(file, DATAGRAM)
                        if not data:
                            break
                        self._came(data)
            except OSError as error:
                self._tell(f"{self._where.path}: {error.strerror}; it is opened again")
            finally:
                os.close(file)
            time.sleep(0.2)
