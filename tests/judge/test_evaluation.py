"""All evaluators together: which limits hold, who is shown what, and that it stays cheap."""

import pytest

from swath.core.frames import Pose
from swath.core.packed_state import pack, unpack
from swath.judge.catalogue import load_evaluators
from swath.judge.evaluation import Evaluation
from swath.judge.evaluator import EvaluatorSetup, Event, Later, Metric, is_among
from swath.judge.evaluators.harvest import Harvest
from swath.judge.evaluators.lateral_error import LateralError
from swath.judge.windows import EventFeed, Window
from swath.scenario.resolved import Expectation
from swath.scenario.sections import Limit
from swath.signals import MachineState, Scan, SpeedCommand
from tests.fake_run import ArcEdge, GridField, drive, machine


class Classes:
    """A catalogue of these evaluators alone."""

    def __init__(self, *classes):
        self.classes = classes

    def maker_of(self, metric):
        return next(c for c in self.classes for m in c.METRICS if m.name == metric)


class Counting:
    """Counts what it is shown, and brings a limit along."""

    OF_FIELD = False
    METRICS = (Metric("shown", "", "outputs shown", "Run"),)
    LIMITS = {"shown": {"max": 0.0}}

    def __init__(self, setup):
        self.setup, self.count, self.asked = setup, 0, 0

    def see(self, slot, t, outputs):
        self.count += 1

    def metrics(self):
        return {"shown": float(self.count)}

    def end_reason(self, t):
        self.asked += 1
        return ""


class States(Counting):
    SIGNALS = (MachineState,)
    METRICS = (Metric("states", "", "machine states shown", "Run"),)
    LIMITS = {"states": {"max": 0.0}}


class Resting(States):
    METRICS = (Metric("looks", "", "machine states shown", "Run"),)
    LIMITS = {"looks": {"max": 0.0}}
    rests_until = 0

    def see(self, slot, t, outputs):
        self.count += 1
        self.rests_until = t + 200_000_000


class Taking(Later):
    """Notes the distances that it is given, each once."""

    OF_FIELD = False
    SIGNALS = (MachineState,)
    METRICS = (Metric("taken", "", "states given", "Run"),)

    def __init__(self, setup):
        self.ways = []

    def take(self, seen):
        self.ways += seen.of(MachineState)["distance"].tolist()

    def metrics(self):
        return {"taken": float(len(self.ways))}


def judged(*classes, expect=(), names=("combine",)):
    machines = {name: machine(name=name) for name in names}
    setups = {name: EvaluatorSetup(GridField(ArcEdge()), machines, name) for name in names}
    return Evaluation(Classes(*classes), setups, expect)


def test_a_limit_that_is_brought_along_holds_for_each_machine_unless_that_one_has_its_own():
    own = Expectation("combine", "shown", Limit(max=5.0))
    other = Expectation("combine", "distance_m", Limit(max=5.0))
    evaluation = judged(Counting, States, expect=[own, other], names=("combine", "cart"))
    implied = [(e.subject, e.name, e.limit.max) for e in evaluation.expect[2:]]
    assert implied == [("combine", "states", 0.0), ("cart", "shown", 0.0), ("cart", "states", 0.0)]
    assert evaluation.expect[:2] == (own, other)


def test_an_evaluator_is_shown_the_signals_it_names_and_without_names_all():
    evaluation = judged(Counting, States)
    drive([evaluation], GridField(ArcEdge()), seconds=1.0)
    states, everything = evaluation.find("combine", States).count, evaluation.find("combine", Counting).count
    assert states == 101
    assert everything > 5 * states
    evaluation("cart.speed", 0, {"command": SpeedCommand(0, 1.0)})
    assert evaluation.find("combine", Counting).count == everything


def test_an_evaluator_that_rests_is_shown_nothing_before_its_time():
    evaluation = judged(States, Resting)
    drive([evaluation], GridField(ArcEdge()), seconds=1.0)
    assert evaluation.find("combine", States).count == 101
    assert evaluation.find("combine", Resting).count == 6


def states_until(ways):
    return [MachineState(t, Pose.identity(), *[0.0] * 4, float(way)) for t, way in enumerate(ways)]


@pytest.mark.parametrize("expect", [(), [Expectation("combine", "taken", Limit(max=1.0, to_m=5.0))]])
def test_an_evaluator_that_takes_samples_is_given_each_of_its_machine_once(expect):
    evaluation = judged(Taking, expect=expect, names=("combine", "cart"))
    for state in states_until([1.0, 3.0, 9.0]):
        evaluation("combine.motion", state.t, {"state": state})
        evaluation("combine.speed", state.t, {"command": SpeedCommand(0, 1.0)})
    assert evaluation.find("combine", Taking).ways == [1.0, 3.0, 9.0]
    assert evaluation.find("cart", Taking).ways == []
    if expect:
        assert evaluation.check({"combine": {}}, {})[0]["value"] == 2.0


def test_evaluators_of_a_machine_note_its_way_once_also_after_a_saved_state():
    made, other = (judged(LateralError, Harvest, names=("combine", "cart")) for _ in range(2))
    for state in states_until([1.0, 3.0, 2.0, 9.0]):
        made("combine.motion", state.t, {"state": state})
    other.load(unpack(pack(made.save(), made.shared), other.shared))
    for evaluation in (made, other):
        paths = [evaluation.find("combine", kind).shared_path for kind in (LateralError, Harvest)]
        assert paths[0] is paths[1] is not evaluation.find("cart", Harvest).shared_path
        assert paths[0].arrays()[1].tolist() == [1.0, 3.0, 9.0]


def test_the_end_is_asked_for_once():
    evaluation = judged(Counting)
    for t in range(5):
        assert evaluation.end_reason(t) == ""
    assert evaluation.find("combine", Counting).asked == 5


class Watched(list):
    """Counts how often an event is looked at."""

    looked = 0

    def __getitem__(self, index):
        self.looked += 1
        return super().__getitem__(index)


class Noting:
    EVENTS = ("gap", "other")

    def __init__(self, events):
        self._events = events

    def events(self):
        return self._events


def event(t, end=None, kind="gap", machine="combine"):
    return Event(t, kind, machine, 0.0, 0.0, 0.0, "", end)


def test_events_that_were_told_are_not_looked_at_again():
    """1000 gaps passed and 1000 looks: each gap is looked at once."""
    events = Watched(event(t, t) for t in range(1000))
    feed = EventFeed(Window(after="gap", to_m=1.0), [Noting(events)], "combine")
    assert len(feed.fresh()) == 1000
    for _ in range(1000):
        assert feed.fresh() == []
    assert events.looked == 1000


def test_an_event_is_told_once_when_the_window_may_begin():
    events = [event(1), event(2, 2, "other"), event(3, 3, machine="cart")]
    after = EventFeed(Window(after="gap"), [Noting(events)], "combine")
    before = EventFeed(Window(before="gap"), [Noting(events)], "field")
    assert after.fresh() == []
    assert [e.t for e in before.fresh()] == [1, 3]
    events[0] = event(1, 5)
    events.append(event(7, 7))
    assert [e.t for e in after.fresh()] == [1, 7]
    assert [e.t for e in before.fresh()] == [7]
    assert after.fresh() == []


def test_the_built_in_evaluators_say_what_they_want_to_see():
    assert all(
        is_among(c.SIGNALS, c.SIGNALS) and not is_among((Scan,), c.SIGNALS) for c in load_evaluators().classes
    )
