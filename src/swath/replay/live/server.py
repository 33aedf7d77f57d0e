"""Serves one page and its websockets on the loopback interface, to whoever knows the token of its address."""

import hmac
import logging
import secrets
import threading
from collections import deque
from collections.abc import Callable
from http import HTTPStatus
from typing import Any
from urllib.parse import parse_qs, urlsplit

from swath.core.errors import MissingExtra

HOST = "127.0.0.1"
PATIENCE_S = 60.0  # for the world, of a browser that comes before it is there


class Viewer:
    """One page that is open. A frame is sent once the page has dealt with the one before, so that a slow page
    sees fewer and neither delays the run nor falls behind; everything else is sent in order.
    """

    def __init__(self, connection: Any) -> None:
        self.connection = connection
        self._messages: deque[bytes | str] = deque()
        self._frame: bytes | None = None
        self._is_due = threading.Event()
        self._is_over = False
        self.is_free = True  # the page has dealt with its last frame
        self._sender = threading.Thread(target=self._send, name="viewer", daemon=True)
        self._sender.start()

    def put(self, message: bytes | str) -> None:
        """Send a message after those before; comes back at once."""
        self._messages.append(message)
        self._is_due.set()

    def show(self, frame: bytes) -> None:
        """Send a frame, in place of one that still waits; comes back at once."""
        self._frame = frame
        self._is_due.set()

    def free(self) -> None:
        """The page has dealt with its last frame."""
        self.is_free = True
        self._is_due.set()

    def close(self) -> None:
        """Send what waits, then nothing more."""
        self._is_over = True
        self._is_due.set()
        self._sender.join(1.0)

    def _send(self) -> None:
        from websockets.exceptions import ConnectionClosed

        try:
            while not self._is_over or self._messages:
                self._is_due.wait()
                self._is_due.clear()
                while self._messages:
                    self.connection.send(self._messages.popleft())
                if self.is_free and self._frame is not None:
                    frame, self._frame, self.is_free = self._frame, None, False
                    self.connection.send(frame)
        except (ConnectionClosed, OSError):
            return


class Server:
    """page: the HTML, asked for once somebody opens the address; talk: called with each viewer, in a thread.

    Raises MissingExtra without websockets.
    """

    def __init__(self, page: Callable[[float], bytes | None], talk: Callable[[Viewer], None]) -> None:
        try:
            from websockets.sync.server import serve
        except ImportError as error:
            raise MissingExtra("view", "the live page") from error
        self._page, self._talk = page, talk
        self._token = secrets.token_urlsafe(24)
        quiet = logging.getLogger("swath.live")
        quiet.addHandler(logging.NullHandler())
        quiet.propagate = False
        self._server = serve(
            self._serve,
            HOST,
            0,
            process_request=self._answer,
            compression=None,
            max_size=16_384,
            close_timeout=1,
            logger=quiet,
        )
        self.port = int(self._server.socket.getsockname()[1])
        self.origin = f"http://{HOST}:{self.port}"
        self.address = f"{self.origin}/?token={self._token}"
        self._thread = threading.Thread(target=self._server.serve_forever, name="live", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Close all viewers."""
        self._server.shutdown()
        self._thread.join(5.0)

    def _serve(self, connection: Any) -> None:
        viewer = Viewer(connection)
        try:
            self._talk(viewer)
        finally:
            viewer.close()

    def _answer(self, connection: Any, request: Any) -> Any:
        """A page or a refusal, None for a websocket that is welcome."""
        if refusal := self._refusal(request):
            return connection.respond(HTTPStatus.FORBIDDEN, refusal + "\n")
        path = urlsplit(request.path).path
        if path == "/live":
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
            f"style-src 'unsafe-inline'; connect-src ws://{HOST}:{self.port}; frame-ancestors 'none'",
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
        if any(origin != self.origin for origin in origins):
            return "expected a page of this run"
        if hosts != [f"{HOST}:{self.port}"]:
            return "expected the address that swath printed"
        given = parse_qs(urlsplit(request.path).query).get("token", [""])
        if not hmac.compare_digest(given[0].encode(), self._token.encode()):
            return "expected the token of the address that swath printed"
        return ""
