"""The child process of one FMU: `python -m swath.link.fmi.worker FD` answers what `own.py` asks."""

import ctypes
import os
import pickle
import signal
import sys
from multiprocessing.connection import Connection
from typing import Any

from swath.core.errors import SwathError
from swath.link.fmi.instance import Instance
from swath.link.fmi.open_unit import make_instance

PR_SET_PDEATHSIG = 1


def serve(pipe: Connection) -> None:
    """Answer requests until the pipe is closed."""
    instance: Instance | None = None
    try:
        while True:
            verb, what = pickle.loads(pipe.recv_bytes())
            try:
                if verb == "make":
                    instance, answer = make_instance(*what), None
                else:
                    assert instance is not None
                    answer = _answer(instance, verb, what)
                reply = (True, answer)
            except SwathError as error:
                reply = (False, str(error))
            except Exception as error:
                reply = (False, f"{type(error).__name__}: {error}")
            pipe.send_bytes(pickle.dumps(reply, protocol=5))
    except (EOFError, OSError):
        if instance is not None:
            instance.close()


def _answer(instance: Instance, verb: str, what: Any) -> Any:
    if verb == "run":
        return instance.run(what)
    if verb == "start":
        return instance.start(what)
    if verb == "save":
        return instance.save()
    return instance.load(what)


def _main() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent, which then closes the pipe
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    os.dup2(2, 1)  # what an FMU prints must not mix with the results on stdout
    serve(Connection(int(sys.argv[1])))


if __name__ == "__main__":
    _main()
