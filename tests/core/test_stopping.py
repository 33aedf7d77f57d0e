"""A stop that Python drops: nothing is printed of it, and it is raised at the next safe place."""

import os
import signal
import sys

import pytest

from swath.core.process.stopping import Terminated, raise_if_lost, stoppable


class Dropping:
    """Its finalizer does something, as a callback from C does: what is raised in it is dropped by Python."""

    def __init__(self, act):
        self.act = act

    def __del__(self):
        self.act()


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
def test_a_stop_in_a_finalizer_prints_nothing_and_is_raised_later(monkeypatch):
    printed = []
    monkeypatch.setattr(sys, "unraisablehook", printed.append)
    with stoppable():
        thing = Dropping(lambda: os.kill(os.getpid(), signal.SIGTERM))
        del thing
        with pytest.raises(Terminated):
            raise_if_lost()
    assert printed == []


def test_other_errors_in_a_finalizer_are_printed(monkeypatch):
    printed = []
    monkeypatch.setattr(sys, "unraisablehook", lambda dropped: printed.append(dropped.exc_type))
    before = sys.unraisablehook
    with stoppable():
        thing = Dropping(lambda: 1 / 0)
        del thing
    assert printed == [ZeroDivisionError]
    assert sys.unraisablehook is before
