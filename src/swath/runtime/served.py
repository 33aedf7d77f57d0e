"""How a run is reached: one way to listen, with limits, and websockets over it that know who asks."""

import errno
import hmac
import logging
import re
import secrets
import socket
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from http import HTTPStatus
from typing import Any
from urllib.parse import parse_qs, urlsplit

from swath.core.errors import Extra, SwathError

HOST = "127.0.0.1"
MOST, POLL_S = 32, 0.2  # connections at a time; between looks whether it goes on [s]
LARGEST_TAKEN = 1 << 16  # of a client's message [bytes]
CLOSING_S = 1.0  # that a client has to say farewell [s]
PATIENCE_S = 60.0  # for the page, of a browser that comes before it is there


def resolved(host: str, port: int, kind: socket.SocketKind, who: str) -> tuple[Any, Any]:
    """Family and socket address of a host and port. SwathError, which begins with `who`, if there is none."""
    try:
        found = socket.getaddrinfo(host.strip("[]"), port, type=kind)[0]
    except (OSError, UnicodeError) as error:
        raise SwathError(f"{who}: there is no host {host!r}") from error
    return found[0], found[4]


def bound(host: str, port: int, kind: socket.SocketKind, who: str) -> Any:
    """A socket that has an address; of TCP a `Listener`. SwathError, beginning with `who`."""
    family, at = resolved(host, port, kind, who)
    made = (Listener if kind == socket.SOCK_STREAM else socket.socket)(family, kind)
    try:
        if kind == socket.SOCK_STREAM:
            made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        made.bind(at)
        if kind == socket.SOCK_STREAM:
            made.listen()
            made.settimeout(POLL_S)
    except OSError as error:
        made.close()
        is_taken = "the port is in use, by another run or program" if error.errno == 98 else error.strerror
        raise SwathError(f"{who}: could not listen: {is_taken or error}") from error
    return made


class Listener(socket.socket):
    """Takes `most` connections at a time and closes the others, so that idle ones end nothing.

    refused: called for each that is closed
    """

    most = MOST
    refused: Callable[[str], None] | None = None

    def __init__(self, *args: Any) -> None:
        super().__init__(*args)
        self._taken: list[socket.socket] = []

    def take(self) -> tuple[socket.socket, Any] | None:
        """The next one, None where none comes in time or there is no room for it. OSError once closed."""
        try:
            connection, address = super().accept()
        except TimeoutError:
            return None
        except OSError as error:
            if error.errno not in (errno.EMFILE, errno.ENFILE, errno.ECONNABORTED):
                raise
            time.sleep(POLL_S)  # no file is left for it
            return None
        self._taken = [taken for taken in self._taken if taken.fileno() >= 0]
        if len(self._taken) < self.most:
            self._taken.append(connection)
            return connection, address
        connection.close()
        if self.refused is not None:
            self.refused(f"client {address[0]}:{address[1]} was refused: there are {self.most} already")
        return None

    def accept(self) -> tuple[socket.socket, Any]:
        """The next one that there is room for. OSError once it is closed."""
        while self.fileno() >= 0:
            if (found := self.take()) is not None:
                return found
        raise OSError(errno.EBADF, "closed")

    def cut(self) -> None:
        """End all connections, whatever their clients do."""
        for taken in self._taken:
            with suppress(OSError):
                taken.shutdown(socket.SHUT_RDWR)


class Viewer:
    """A websocket that never holds the run up: a client that does not keep up sees less.

    Messages are sent in order. Of frames, the newest `frames` wait; where the client `answers`, each until it
    has dealt with the one before.
    """

    def __init__(self, connection: Any, *, frames: int = 1, answers: bool = True) -> None:
        self.connection, self._answers = connection, answers
        self._messages: deque[bytes | str] = deque()
        self._frames: deque[bytes] = deque(maxlen=frames)
        self._is_due = threading.Event()
        self._is_over = False
        self.is_free = True  # the client has dealt with its last frame
        self._sender = threading.Thread(target=self._send, name="viewer", daemon=True)
        self._sender.start()

    def put(self, message: bytes | str) -> None:
        """Send a message after those before; comes back at once."""
        self._messages.append(message)
        self._is_due.set()

    def show(self, frame: bytes) -> None:
        """Send a frame, in place of the oldest where too many wait; comes back at once."""
        self._frames.append(frame)
        self._is_due.set()

    def free(self) -> None:
        """The client has dealt with its last frame."""
        self.is_free = True
        self._is_due.set()

    def close(self) -> None:
        """Send what waits, then nothing more."""
        self._is_over = True
        self._is_due.set()
        self._sender.join(CLOSING_S)

    def _send(self) -> None:
        from websockets.exceptions import ConnectionClosed

        try:
            while not self._is_over or self._messages:
                self._is_due.wait()
                self._is_due.clear()
                while self._messages or (self.is_free and self._frames):
                    if self._messages:
                        self.connection.send(self._messages.popleft())
                    else:
                        self.is_free = not self._answers
                        self.connection.send(self._frames.popleft())
        except (ConnectionClosed, OSError):
            return


class Server:
    """Websockets, and a page where there is one.

    talk: called with each connection, in a thread. page: the HTML, asked for with a patience [s]; who asks
        for it, or for its websocket at `/live`, has to know the token of `address` and come from the page.
    origins: without a page, the pages that may look (regular expression); what is no browser names none.

    Raises MissingExtra without websockets, SwathError, which begins with `who`, where the port cannot be had.
    """

    def __init__(
        self,
        talk: Callable[[Any], None],
        *,
        extra: tuple[str, str],
        who: str,
        host: str = HOST,
        port: int = 0,
        page: Callable[[float], bytes | None] | None = None,
        origins: str = "",
        **more: Any,
    ) -> None:
        with Extra(*extra):
            from websockets.sync.server import serve
        self._page = page
        self._token = secrets.token_urlsafe(24)
        self._listener = bound(host, port, socket.SOCK_STREAM, who)
        self.port = int(self._listener.getsockname()[1])
        self._host = f"{host}:{self.port}"
        self._origins = re.compile(origins if page is None else re.escape(f"http://{self._host}"))
        self.address = f"ws://{self._host}" if page is None else f"http://{self._host}/?token={self._token}"
        quiet = logging.getLogger("swath.live")
        quiet.addHandler(logging.NullHandler())
        quiet.propagate = False
        self._server = serve(
            talk, sock=self._listener, process_request=self._answer, compression=None, max_size=LARGEST_TAKEN,
            close_timeout=1, logger=quiet, **more,
        )  # fmt: skip
        self._thread = threading.Thread(target=self._server.serve_forever, name="live", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Close all connections, of clients that do not answer after CLOSING_S."""
        timer = threading.Timer(CLOSING_S, self._listener.cut)
        timer.start()
        self._server.shutdown()
        timer.cancel()
        self._thread.join(5.0)

    def _answer(self, connection: Any, request: Any) -> Any:
        """A page or a refusal, None for a websocket that is welcome."""
        if refusal := self._refusal(request):
            return connection.respond(HTTPStatus.FORBIDDEN, refusal + "\n")
        path = urlsplit(request.path).path
        if self._page is None or path == "/live":
            return None
        if path != "/":
            return connection.respond(HTTPStatus.NOT_FOUND, "there is only the page\n")
        html = self._page(PATIENCE_S)
        if html is None:
            return connection.respond(HTTPStatus.SERVICE_UNAVAILABLE, "the run has no page yet\n")
        response = connection.respond(HTTPStatus.OK, "")
        response.body = html
        for name, value in {
            "Content-Type": "text/html; charset=utf-8",
            "Content-Length": str(len(html)),
            "Cache-Control": "no-store",
            "Referrer-Policy": "no-referrer",
            "X-Frame-Options": "DENY",
            "Content-Security-Policy": "default-src 'none'; script-src 'unsafe-inline'; img-src data:; "
            f"style-src 'unsafe-inline'; connect-src ws://{self._host}; frame-ancestors 'none'",
        }.items():
            if name in response.headers:
                del response.headers[name]
            response.headers[name] = value
        return response

    def _refusal(self, request: Any) -> str:
        """Why a request is refused, empty where it is not.

        The Host is checked too: a foreign name that resolves to this machine is no way in.
        """
        origins, hosts = (request.headers.get_all(name) for name in ("Origin", "Host"))
        if not all(self._origins.fullmatch(origin) for origin in origins):
            return (
                "expected a page of this run" if self._page else "expected --allow-address with this Origin"
            )
        if self._page is None:
            return ""
        if hosts != [self._host]:
            return "expected the address that swath printed"
        given = parse_qs(urlsplit(request.path).query).get("token", [""])
        if not hmac.compare_digest(given[0].encode(), self._token.encode()):
            return "expected the token of the address that swath printed"
        return ""
