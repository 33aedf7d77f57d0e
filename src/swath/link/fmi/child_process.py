"""An FMU in a child process: its crash or hang becomes an error that names it.

The child is `python -m swath.link.fmi.child_process FD`; it answers the verbs of `Unit`, one by one.
"""

import ctypes
import os
import pickle
import signal
import socket
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from swath.core.errors import SwathError
from swath.core.files.temporary import TemporaryFolder
from swath.core.process.processes import start_module
from swath.link.fmi.calls import FmuError
from swath.link.fmi.description import Description, Variable
from swath.link.fmi.instance import Numbers, Steps, unpack

START_TIMEOUT_S = 60.0  # of loading Python and the FMU, on a busy machine
CLOSE_TIMEOUT_S = 2.0
PR_SET_PDEATHSIG = 1


class ChildProcess:
    """A unit whose FMU runs in a child process.

    timeout_s: longest wait for an answer [s]; at the start a minute is added
    child: the process, None before the start and after the end
    folder: where the FMU is unpacked
    notes: what the user should know
    """

    def __init__(
        self,
        description: Description,
        name: str,
        inputs: Sequence[Variable],
        outputs: Sequence[Variable],
        timeout_s: float,
        notes: Sequence[str] = (),
    ) -> None:
        self.notes = [*notes]
        self._spec = (replace(description, package=None), name, tuple(inputs), tuple(outputs))
        self._unpacked: TemporaryFolder | None = None  # here, so that it goes even if the child dies
        self.folder: Path | None = None
        self._timeout_s = timeout_s
        self.child: subprocess.Popen[bytes] | None = None
        self._pipe: Connection | None = None

    def start(self, starts: Mapping[str, Any]) -> list[float]:
        """Start the process if there is none, and the FMU in it; outputs at t = 0.

        A start after the first gets a new process where the FMU allows one instance per process, or fails to
        start again in the old one.
        """
        is_first = self.child is None
        if not is_first and self._spec[0].one_per_process:
            self.close()
        try:
            return self._start(starts)
        except FmuError:
            if is_first:
                raise
            self.close()
        found = self._start(starts)
        self._note("it cannot be started again in one process and got a new one")
        return found

    def _start(self, starts: Mapping[str, Any]) -> list[float]:
        if self.child is None:
            self._unpacked = unpack(self._spec[0].file)
            folder = self.folder = self._unpacked.path
            self._launch()
            self._ask("make", *self._spec, folder, doing="being loaded", extra_s=START_TIMEOUT_S)
        found: list[float] = self._ask("start", dict(starts), doing="initialising", extra_s=START_TIMEOUT_S)
        for note in self._ask("all_notes", doing="being asked"):
            self._note(note)
        return found

    def step(self, t: float, h: float, inputs: Numbers) -> list[float]:
        """Step from t to t + h [s]."""
        return self.run([(t, h, inputs)])

    def run(self, steps: Steps) -> list[float]:
        """One step after the other; the outputs after the last."""
        found: list[float] = self._ask("run", steps, doing="its step")
        return found

    def save(self) -> Any:
        """The state of the FMU."""
        return self._ask("save", doing="saving its state")

    def load(self, state: Any) -> None:
        """Take on a state that `save` gave."""
        self._ask("load", state, doing="loading its state")

    def close(self) -> None:
        """Ask the FMU to end; end the process if it does not."""
        child, self.child = self.child, None
        pipe, self._pipe = self._pipe, None
        if pipe is not None:
            pipe.close()  # the child ends when the pipe closes
        if child is not None:
            try:
                child.wait(CLOSE_TIMEOUT_S)
            except subprocess.TimeoutExpired:
                child.kill()
                child.wait()
        if self._unpacked is not None:
            self._unpacked.remove()

    def _note(self, text: str) -> None:
        if text not in self.notes:
            self.notes.append(text)

    def _launch(self) -> None:
        ours, theirs = socket.socketpair()
        with theirs:
            number, nothing = theirs.fileno(), subprocess.DEVNULL
            self.child = start_module(__name__, str(number), pass_fds=[number], stdin=nothing)
        self._pipe = Connection(ours.detach())

    def _ask(self, verb: str, *what: Any, doing: str, extra_s: float = 0.0) -> Any:
        if self._pipe is None:
            raise FmuError("its process has ended")
        limit = self._timeout_s + extra_s
        try:
            self._pipe.send_bytes(pickle.dumps((verb, what), protocol=5))
            if not self._pipe.poll(limit):
                self._kill()
                raise FmuError(f"it gave no answer within {limit:g} s ({doing}); its process was ended")
            is_good, answer = pickle.loads(self._pipe.recv_bytes())
        except (EOFError, OSError) as error:
            raise FmuError(f"its process crashed ({self._ending()}), {doing}") from error
        if not is_good:
            raise FmuError(answer)
        return answer

    def _ending(self) -> str:
        """How the child ended, in words."""
        child = self.child
        assert child is not None
        try:
            code = child.wait(CLOSE_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            self._kill()
            return "it closed its end"
        self.child = None
        self.close()
        if code < 0:
            return signal.Signals(-code).name
        return f"exit code {code}"

    def _kill(self) -> None:
        if self.child is not None:
            self.child.kill()
        self.close()


def serve(pipe: Connection) -> None:
    """The child's side: answer requests until the pipe is closed."""
    from swath.link.fmi.make_instance import make_instance

    instance: Any = None
    reply: tuple[bool, Any]
    try:
        while True:
            verb, what = pickle.loads(pipe.recv_bytes())
            try:
                if verb == "make":
                    instance, reply = make_instance(*what), (True, None)
                else:
                    reply = (True, getattr(instance, verb)(*what))
            except SwathError as error:
                reply = (False, str(error))
            except Exception as error:
                reply = (False, f"{type(error).__name__}: {error}")
            pipe.send_bytes(pickle.dumps(reply, protocol=5))
    except (EOFError, OSError):
        if instance is not None:
            instance.close()


def _main() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent, which then closes the pipe
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    os.dup2(2, 1)  # what an FMU prints must not mix with the results on stdout
    serve(Connection(int(sys.argv[1])))


if __name__ == "__main__":
    _main()
