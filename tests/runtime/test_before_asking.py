"""Messages that a paced run puts off are out before somebody acts on them."""

import threading

from swath.core.schedule import NS
from swath.runtime.hooks import RunHook
from swath.runtime.job import run_job
from swath.runtime.run_control import RunControl
from swath.scenario.scenario import parse_scenario

TEXT = """
format: swath scenario 2
name: paused
run: {distance_m: 100, max_duration_s: 1}
realtime: {factor: 20, grace_s: 0}
field: {edge: {shape: straight}}
machines:
  combine: {lidar: off, edge: truth, header: off, process: off}
"""


class Listener(RunHook):
    """Hears all messages: topic -> time of the last one [ns]."""

    def __init__(self):
        self.last = {}

    def begin(self, run):
        run.recorder.file.taps.append(lambda topic, t, *_: self.last.__setitem__(topic, t))


def test_a_paused_run_has_sent_all_messages_up_to_where_it_stands(tmp_path):
    control, listener = RunControl(is_paused=True), Listener()
    scenario = parse_scenario(TEXT)
    run = threading.Thread(
        target=run_job, args=(scenario, tmp_path / "run"), kwargs={"hooks": [listener, control]}
    )
    run.start()
    try:
        heard = []
        for _ in range(5):
            done, told = control.step(0.1)
            assert done, told
            heard.append((told, listener.last["/combine/motion/state"]))
        assert [t for _, t in heard] == [k * NS // 10 for k in range(1, 6)], heard
    finally:
        control.pause(False)
        run.join()
