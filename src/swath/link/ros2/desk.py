"""Where requests from the thread of ROS 2 wait for the thread of the run, which serves them between ticks."""

import queue
import threading
from collections.abc import Callable
from dataclasses import dataclass, field

from swath.core.errors import SwathError

Reply = tuple[bool, str]


@dataclass
class Request:
    """What is wanted. action: does it at a simulated time [ns] and says how it went."""

    action: Callable[[int], str]
    done: threading.Event = field(default_factory=threading.Event)
    reply: Reply = (False, "the run is over")

    def answer(self, reply: Reply) -> None:
        """Let who asked go on."""
        self.reply = reply
        self.done.set()


class Desk:
    """Requests, in the order they came. `ask` is for other threads, `serve` and `close` are for the run's."""

    def __init__(self) -> None:
        self._waiting: queue.SimpleQueue[Request] = queue.SimpleQueue()
        self._closed = threading.Event()

    def ask(self, action: Callable[[int], str]) -> Reply:
        """Have something done between two ticks; (it worked, what there is to say). Waits for it."""
        request = Request(action)
        self._waiting.put(request)
        while not request.done.wait(0.1):
            if self._closed.is_set():
                break
        return request.reply

    def serve(self, t: int, *, wait_s: float = 0.0) -> None:
        """Do what is asked before the tick at t [ns]; wait up to `wait_s` for a first request.

        What an action raises on purpose (SwathError) is the answer; anything else ends the run.
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
        """Turn away everybody who waits or comes."""
        self._closed.set()
        while not self._waiting.empty():
            self._waiting.get().answer((False, "the run is over"))
