"""`swath` and `python -m swath`: the command line, and Ctrl-C while it is loaded."""

import os
import signal
import sys


def main() -> int:
    """Run the command line; returns the exit code.

    While it is loaded nothing is open yet, and Ctrl-C ends it at once: some libraries make errors of their
    own of what is raised in their import.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # its threads spin over small matrices, on all cores
    before = signal.getsignal(signal.SIGINT)
    if before is signal.default_int_handler:
        signal.signal(signal.SIGINT, _quit)
    from swath.commands.main import main as run

    signal.signal(signal.SIGINT, before)
    return run()


def _quit(_number: int, _frame: object) -> None:
    os.write(2, b"swath: stopped\n")
    os._exit(130)


if __name__ == "__main__":
    sys.exit(main())
