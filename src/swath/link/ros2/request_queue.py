"""Requests from the ROS 2 thread to the thread of the run, which serves them between two ticks."""

import queue
import threading
from collections.abc import Callable
from dataclasses import dataclass, field

from swath.core.errors import SwathError

Reply = tuple[bool, str]


@dataclass
class Request:
    """action: called with the simulated time [ns], returns a message for the reply."""

    action: Callable[[int], str]
    done: threading.Event = field(default_factory=threading.Event)
    reply: Reply = (False, "the run is over")

    def answer(self, reply: Reply) -> None:
        """Give the reply and wake the thread that asked."""
        self.reply = reply
        self.done.set()


class RequestQueue:
    """Requests in order of arrival. `ask` is for other threads; `serve` and `close` for the run's thread."""

    def __init__(self) -> None:
        self._waiting: queue.SimpleQueue[Request] = queue.SimpleQueue()
        self._closed = threading.Event()

    def ask(self, action: Callable[[int], str]) -> Reply:
        """Have an action done between two ticks; blocks. Returns (success, message)."""
        request = Request(action)
        self._waiting.put(request)
        while not request.done.wait(0.1):
            if self._closed.is_set():
                break
        return request.reply

    def serve(self, t: int, *, wait_s: float = 0.0) -> None:
        """Serve all requests before the tick at t [ns]; wait up to `wait_s` for a first one.

        A SwathError of an action becomes its reply; any other exception ends the run.
        """
        while True:
            try:
                request = self._waiting.get(block=wait_s > 0.0, timeout=wait_s or None)
            except queue.Empty:
                return
            wait_s = 0.0
            try:
                request.answer((True, request.action(t)))
            except SwathError as error:
                request.answer((False, str(error)))
            except BaseException as error:
                request.answer((True, str(error)))
                raise

    def close(self) -> None:
        """Refuse all waiting and later requests."""
        self._closed.set()
        while not self._waiting.empty():
            self._waiting.get().answer((False, "the run is over"))
