"""All evaluators of a run: they watch it as one observer of the graph, and say what it came to."""

import dataclasses
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from functools import partial
from typing import Any, TypeVar

from swath.core.abilities import OTHER, Ending, EndsRun, HasNotes
from swath.core.asked import replaced
from swath.core.blocks import Looker, Seen, no_look
from swath.core.number_text import num
from swath.core.schedule import NS
from swath.judge.catalogue import EvaluatorCatalogue
from swath.judge.evaluator import (
    Evaluator,
    EvaluatorSetup,
    Event,
    HasColumns,
    HasEvents,
    HasLimits,
    HasSignals,
    Rests,
    SeesLive,
    TakesSeen,
    is_among,
)
from swath.judge.header_path import HeaderPath
from swath.judge.limits import NO_SAMPLE, OF_WINDOWS, check_metric, check_samples, entry_of, window_of
from swath.judge.windows import FIELD, EventFeed, WindowedEvaluator, concerns, restore, state_of
from swath.record.message_factory import RecordedMachine
from swath.record.tracks import Column
from swath.scenario.resolved import Expectation
from swath.scenario.sections import Limit
from swath.signals import F64, MachineState, Signal

E = TypeVar("E")
Metrics = dict[str, Any]
See = Callable[[str, int, Mapping[str, Signal]], None]


class Evaluation:
    """Observer of a graph: it takes what was sent since it looked last, or is called with (slot, t, outputs),
    before the recorder.

    setups: of each machine by its name; the first one's distance counts for windows of the field
    expect: limits of the scenario; those that evaluators bring along are added
    watchers: further evaluators of the field, which know more than a setup says; each has what it knows as
        `scene`, which a saved state leaves out, and takes in what waits before (`settle`)
    """

    def __init__(
        self,
        catalogue: EvaluatorCatalogue,
        setups: Mapping[str, EvaluatorSetup],
        expect: Sequence[Expectation] = (),
        watchers: Sequence[Any] = (),
    ) -> None:
        self.catalogue = catalogue
        self.is_trial = False  # true of a run that is to end before anything is measured
        first = next(iter(setups.values()))
        self._setups = {**setups, FIELD: replaced(first, name="", overlap=0.0, gaps=())}
        self.machines: dict[str, RecordedMachine] = dict(first.machines)
        self._of: dict[str, list[Any]] = {
            subject: [make(setup) for make in catalogue.classes if (subject == FIELD) == make.OF_FIELD]
            for subject, setup in self._setups.items()
        }
        for own in self._of.values():
            every = [e for e in own if isinstance(getattr(e, "shared_path", None), HeaderPath)]
            for e in every[1:]:
                e.shared_path = every[0].shared_path
        self._of[FIELD] += watchers
        self._watchers = watchers
        self._scenes = {f"scene {n}": watcher.scene for n, watcher in enumerate(watchers)}
        self._ending = [(n, e) for n, own in self._of.items() for e in own if isinstance(e, EndsRun)]
        self._noting = [e for own in self._of.values() for e in own if isinstance(e, HasEvents)]
        self.look: Callable[[], None] = no_look
        self._shown: dict[tuple[object, ...], list[Looker]] = {}
        self._takers: dict[tuple[str, type[Signal]], list[Any]] = {}
        self._given: dict[tuple[object, ...], list[tuple[Any, str]]] = {}  # who takes what, of which machine
        self._left_out: set[int] = set()  # evaluators that nobody asks
        self.expect = (*expect, *self._implied(expect))
        self._windows = self._make_windows()
        self._distance = dict.fromkeys(self._setups, 0.0)
        self._first = next(iter(setups))

    def __call__(self, slot: str, t: int, outputs: Mapping[str, Signal]) -> None:
        """Show samples to the evaluators whose business they are."""
        self._give(Seen.of_one(slot, t, outputs))
        kinds = tuple(map(type, outputs.values()))
        if (slot, *kinds) not in self._shown:
            self._shown[slot, *kinds] = self.lookers(slot, kinds)
        for part, see, rests in self._shown[slot, *kinds]:
            if not rests or t >= part.rests_until:
                see(slot, t, outputs)
        if self._windows:
            self._show_windows(slot, t, outputs)

    @property
    def is_late(self) -> bool:
        """Windows begin with events at any time: where there are any, it is called with every sample."""
        return not self._windows

    def take(self, seen: Seen) -> None:
        """Give what was sent to the evaluators that take many samples at once."""
        self._give(seen)

    def lookers(self, slot: str, kinds: tuple[type[Signal], ...]) -> list[Looker]:
        """Who is shown samples of these types from a slot at their time: always, or unless it rests."""
        found = []
        for e in self.interested(slot, kinds):
            if isinstance(e, SeesLive):
                is_live = is_among(kinds, e.live)
                if is_live or isinstance(e, Rests):
                    found.append(Looker(e, e.see_live, not is_live))
            elif not isinstance(e, TakesSeen):
                found.append(Looker(e, e.see, isinstance(e, Rests)))
        return found

    def only_limits(self) -> None:
        """From now on nothing is asked but limits: only what they stand on, and may end the run, looks on."""
        if not self._windows:
            names = {limit.name for limit in self.expect}
            every = [e for own in self._of.values() for e in own if not isinstance(e, EndsRun)]
            self._left_out = {id(e) for e in every if not any(m.name in names for m in e.METRICS)}
            self._shown.clear()
            self._takers.clear()
            self._given.clear()

    def takes(self, slot: str, kind: type[Signal]) -> bool:
        """Whether an evaluator takes samples of a type from a slot."""
        return bool(self._takers_of(slot.partition(".")[0], kind))

    def _takers_of(self, machine: str, kind: type[Signal]) -> list[Any]:
        if (machine, kind) not in self._takers:
            every = self.interested(machine, (kind,))
            self._takers[machine, kind] = [e for e in every if isinstance(e, TakesSeen)]
        return self._takers[machine, kind]

    def _give(self, seen: Seen) -> None:
        if (takers := self._given.get(seen.sent)) is None:
            every = ((slot.partition(".")[0], kind) for slot, kind in seen.sent)
            found = {id(e): (e, "" if e.OF_FIELD else m) for m, k in every for e in self._takers_of(m, k)}
            takers = self._given[seen.sent] = [*found.values()]
        own = {machine: seen.of_machine(machine) for machine in {machine for _, machine in takers}}
        for evaluator, machine in takers:
            evaluator.take(own[machine])

    @property
    def read_columns(self) -> frozenset[str]:
        """Columns of the tracks that limits read."""
        limits = [e for e in self.expect if e.limit.hold is not None]
        return frozenset(c for e in limits for c in (e.name, *e.limit.while_, *OF_WINDOWS))

    @property
    def shared(self) -> dict[str, Any]:
        """What evaluators refer to and a saved state leaves out, by name."""
        found: dict[str, Any] = dict(self._scenes)
        for subject, setup in self._setups.items():
            found[f"setup {subject}"] = setup
            found |= {f"{k} {subject}": v for k, v in vars(setup).items() if _is_object(v)}
        for name, machine in self.machines.items():
            found[f"machine {name}"] = machine
            found |= {f"{k} of {name}": v for k, v in vars(machine).items() if _is_object(v)}
        return found

    def save(self) -> dict[str, Any]:
        """What the evaluators have seen so far; it may refer to what is `shared`."""
        self.look()
        for watcher in self._watchers:
            watcher.settle()
        return {
            "evaluators": {subject: [state_of(e) for e in own] for subject, own in self._of.items()},
            "windows": [watch.save() for watch in self._windows.values()],
            "distance": dict(self._distance),
        }

    def load(self, state: Mapping[str, Any]) -> None:
        """Back to a saved moment, in an evaluation of the same scenario."""
        for subject, saved in state["evaluators"].items():
            for evaluator, own in zip(self._of[subject], saved, strict=True):
                restore(evaluator, own)
        for watch, saved in zip(self._windows.values(), state["windows"], strict=True):
            watch.load(saved)
        self._distance = dict(state["distance"])

    def find(self, subject: str, kind: type[E]) -> E | None:
        """The evaluator of a class for a machine or the field; None where there is none."""
        self.look()
        return next((e for e in self._of[subject] if isinstance(e, kind)), None)

    def columns(self, machine: str) -> tuple[Column, ...]:
        """What the evaluators add to the tracks of a machine."""
        return tuple(c for e in self._of[machine] if isinstance(e, HasColumns) for c in e.columns())

    def events(self, subject: str = FIELD) -> list[Event]:
        """What happened so far to a machine, or in the field to any, in order of time."""
        self.look()
        mine = (e for j in self._noting for e in j.events() if concerns(e, subject))
        return sorted(mine, key=lambda e: (e.t, e.kind, e.machine))

    def notes(self) -> list[str]:
        """What the evaluators want the user to know about the run."""
        self.look()
        every = ((name, e) for name, own in self._of.items() for e in own)
        return [f"{name}: {note}" for name, e in every if isinstance(e, HasNotes) for note in e.notes]

    def metrics(self, subject: str, names: Collection[str] | None = None) -> Metrics:
        """Metrics of a machine, or of `field`. names: only evaluators that have one of these are asked."""
        self.look()
        asked = [e for e in self._of[subject] if names is None or any(m.name in names for m in e.METRICS)]
        return {name: value for e in asked for name, value in e.metrics().items()}

    def end_reason(self, t: int) -> str:
        """Why an evaluator wants the run to end before the tick at t [ns]; "" where none does."""
        for subject, evaluator in self._ending:
            if reason := evaluator.end_reason(t):
                events = evaluator.EVENTS if isinstance(evaluator, HasEvents) else (OTHER,)
                return Ending.by(subject, Ending(reason, events[0]))
        return ""

    def check(
        self, metrics: Mapping[str, Metrics], tracks: Mapping[str, Mapping[str, F64]]
    ) -> list[dict[str, Any]]:
        """Every limit with its value and result, see `judge/limits.py`.

        metrics: by machine, and of `field` with those of the run; tracks: columns by machine
        """
        outcomes = [(e, list(self._outcomes(e, metrics, tracks))) for e in self.expect]
        return [entry_of(e, found, is_trial=self.is_trial) for e, found in outcomes]

    def _outcomes(
        self, e: Expectation, metrics: Mapping[str, Metrics], tracks: Mapping[str, Mapping[str, F64]]
    ) -> Iterator[tuple[float | None, str]]:
        window = window_of(e.limit)
        if e.limit.hold is not None:
            events = [x for x in self.events(e.subject) if window.begins_at(x)] if window.kind else [None]
            for event in events:
                outcome = check_samples(e.limit, tracks[e.subject], e.name, event)
                yield _placed(outcome, event)
        elif e.limit.because is not None:
            yield self._because(e.subject, e.name, e.limit, e.limit.because)
        elif not e.limit.window:
            yield check_metric(e.limit, metrics[e.subject].get(e.name))
        else:
            watch = self._windows[e.subject, self.catalogue.maker_of(e.name), window]
            for stretch in watch.stretches:
                found = stretch.evaluator.metrics() if stretch.count else {}
                outcome = check_metric(e.limit, found.get(e.name))
                if not stretch.count:
                    outcome = None, NO_SAMPLE
                yield _placed(outcome, stretch.event)

    def _because(self, subject: str, name: str, limit: Limit, why: str) -> tuple[float | None, str]:
        """A count of events, of those alone that happened because of something."""
        events = [x for x in self.events(subject) if x.kind == self.catalogue.caused[name]]
        found = [x for x in events if why in x.because]
        value, reason = check_metric(limit, float(len(found)))
        others = dict.fromkeys(other for x in events for other in x.because[:1])
        counted = f"{len(events)} in all, because of {', '.join(others) or 'nothing that is there'}"
        return value, f"{reason} because of {why}; {counted}" if reason else ""

    def interested(self, slot: str, kinds: tuple[type[Signal], ...]) -> list[Evaluator]:
        """Who wants samples of these types from a slot: evaluators of its machine, then of the field."""
        own = self._of.get(slot.partition(".")[0], [])
        return [
            e
            for e in (*own, *self._of[FIELD])
            if id(e) not in self._left_out and (not isinstance(e, HasSignals) or is_among(kinds, e.SIGNALS))
        ]

    def _implied(self, expect: Sequence[Expectation]) -> list[Expectation]:
        """Limits that evaluators bring along, where the scenario sets none on the metric of that subject."""
        named = {(e.subject, e.name) for e in expect}
        return [
            Expectation(subject, name, Limit(min=bounds.get("min"), max=bounds.get("max")))
            for subject, evaluators in self._of.items()
            for evaluator in evaluators
            if isinstance(evaluator, HasLimits)
            for name, bounds in evaluator.LIMITS.items()
            if (subject, name) not in named
        ]

    def _make_windows(self) -> dict[tuple[str, Any, Any], WindowedEvaluator]:
        made: dict[tuple[str, Any, Any], WindowedEvaluator] = {}
        for e in self.expect:
            if e.limit.window and e.limit.hold is None:
                make = self.catalogue.maker_of(e.name)
                setup = dataclasses.replace(self._setups[e.subject], settling_m=0.0)
                window = window_of(e.limit)
                feed = EventFeed(window, [j for j in self._noting if window.kind in j.EVENTS], e.subject)
                made.setdefault(
                    (e.subject, make, window), WindowedEvaluator(window, partial(make, setup), feed)
                )
        return made

    def _show_windows(self, slot: str, t: int, outputs: Mapping[str, Signal]) -> None:
        name = slot.partition(".")[0]
        if name not in self._setups:
            return
        moved = next((s for s in outputs.values() if isinstance(s, MachineState)), None)
        if moved is not None:
            self._distance[name] = moved.distance
            if name == self._first:
                self._distance[FIELD] = moved.distance
        for (subject, _, _), watch in self._windows.items():
            if subject in (name, FIELD):
                if moved is not None:
                    watch.look_for_events()
                watch.see(self._distance[subject], slot, t, outputs)


def _is_object(value: Any) -> bool:
    """Whether a value is one thing that others may hold too, no number or text."""
    return value is not None and not isinstance(value, str | int | float | bool | tuple)


def _placed(outcome: tuple[float | None, str], event: Event | None) -> tuple[float | None, str]:
    """The outcome, its reason with the event that the stretch hangs on."""
    value, reason = outcome
    if not reason or event is None:
        return outcome
    return (
        value,
        f"{reason} ({event.kind} at {num(event.t / NS, places=1)} s, {num(event.distance, places=1)} m)",
    )


def incident(event: Event) -> dict[str, Any]:
    """An event as it stands in `summary.json`."""
    ended = None if event.end_t is None else event.end_t / NS
    lasting = {} if event.end_t == event.t else {"end_t_s": ended, "end_distance_m": event.end_distance}
    other: dict[str, Any] = {"other": event.other} if event.other else {}
    if event.because:
        other["because"] = list(event.because)
    return {
        "t_s": event.t / NS, "kind": event.kind, "machine": event.machine, **other, "x_m": event.x,
        "y_m": event.y, "distance_m": event.distance, **lasting, "text": event.text,
    }  # fmt: skip
