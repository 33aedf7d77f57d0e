"""Requests from other threads to the thread of the run, which serves them between two ticks."""

import queue
import threading
from collections.abc import Callable
from concurrent.futures import Future

from swath.core.errors import SwathError

Action = Callable[[int], str]  # called with the simulated time [ns], returns a message for the reply
Reply = tuple[bool, str]
OVER: Reply = (False, "the run is over")


class RequestQueue:
    """Requests in order of arrival. `ask` is for other threads; `serve` and `close` for the run's thread."""

    def __init__(self) -> None:
        self._waiting: queue.SimpleQueue[tuple[Action, Future[Reply]]] = queue.SimpleQueue()
        self._closed = threading.Event()

    def ask(self, action: Action) -> Reply:
        """Have an action done between two ticks; blocks. Returns (success, message)."""
        reply: Future[Reply] = Future()
        self._waiting.put((action, reply))
        while not self._closed.is_set():
            try:
                return reply.result(0.1)
            except TimeoutError:
                continue
        return reply.result() if reply.done() else OVER

    def serve(self, t: int, *, wait_s: float = 0.0) -> None:
        """Serve all requests before the tick at t [ns]; wait up to `wait_s` for a first one.

        A SwathError of an action becomes its reply; any other exception ends the run.
        """
        while True:
            try:
                action, reply = self._waiting.get(block=wait_s > 0.0, timeout=wait_s or None)
            except queue.Empty:
                return
            wait_s = 0.0
            try:
                reply.set_result((True, action(t)))
            except SwathError as error:
                reply.set_result((False, str(error)))
            except BaseException as error:
                reply.set_result((True, str(error)))
                raise

    def close(self) -> None:
        """Refuse all waiting and later requests."""
        self._closed.set()
        while not self._waiting.empty():
            self._waiting.get()[1].set_result(OVER)
