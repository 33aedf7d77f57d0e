"""Whether every level of a run was used inside the range in which it was checked.

A level says in which ranges of which quantities it was checked (`core.registry.Checked`), a part may add
those of its own table (`core.abilities.HasRanges`). Once a metre the run looks at what it meets. A look is
beyond a range when more than 2 % of its values are, and more than one of several: one echo decides nothing.
A slot is `outside` with three such looks, or where all of fewer are such, `at the edge` with anything less
beyond its range, else `inside`.

A quantity that changes what a slot does (`runtime.met.Quantity.touches`) and for which its level declares no
range is `not checked` there: it is listed, and a note says so where the run met more than plain values.

A limit rests on the slots that its evaluator sees and on all that feeds these, over the wires of the graph;
one on an identity, as a balance, on none. Where one of these is outside, it is not judged, but for slots of
control: those are what is judged. It is judged, too, where drawn runs beyond the range say by how much the
quantity moves its metric at most (`core.registry.Beyond`), and it comes to the same with the metric moved so
far. What is broken by the event that ended the run is judged: it is why there is no more of the run.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import inf, nan
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.abilities import Ending, HasRanges, Meets, MeetsLater
from swath.core.blocks import samples_of
from swath.core.errors import InputError
from swath.core.estimate import Estimate, held
from swath.core.layout import quantities
from swath.core.number_text import span
from swath.core.packed_state import saved_type
from swath.core.registry import OWN_LAW, Checked, KnownError
from swath.core.schedule import NS
from swath.core.signal import Signal
from swath.core.units import rounded
from swath.judge.catalogue import EvaluatorCatalogue
from swath.judge.evaluator import NEVER, HasEvents, HasSignals, Metric
from swath.judge.waking import Waking
from swath.judge.windows import FIELD
from swath.kernels import Repeated
from swath.runtime.met import EVERY_M, FIXED, QUANTITIES, Where, untold
from swath.runtime.world import Machine, World
from swath.signals import MachineState

SUMMARY = "credibility"
NEVER_CHECKED = "never_checked"  # its key of quantities that levels were met with and never checked for
INSIDE, EDGE, OUTSIDE = "inside", "at the edge", "outside"
Asked = tuple[str, str, Checked, tuple[str, ...]]
Note = tuple[MachineState, dict[str, Any]]  # of a machine, and what its parts say or note of what they meet
STATES = (INSIDE, EDGE, OUTSIDE)
TOLERATED = 0.02  # share of the values of a look that may lie beyond a range
SLACK = 1e-6  # share of a bound that comes of rounding, as of units
TOGETHER = 16  # notes that are judged together where the ground stays as it is; changes no result, estimated
LOOKS = 3  # beyond a range that make a slot outside of it
REST = NS // 10  # between two questions whether a machine has moved on [ns]


class Looks:
    """Values of a quantity in looks, those that are finite.

    each: of every look, a number or several
    values: all of them, one look after the other; counts: how many each has; low, high: of all
    is_plain: whether each has one
    """

    def __init__(self, each: Sequence[Any]) -> None:
        is_single = set(map(type, each)) <= {float}
        sizes = [1 if is_single else np.size(value) for value in each]
        self._ends = np.cumsum(sizes)
        values = (
            np.array(each)
            if is_single
            else np.concatenate([np.ravel(value) for value in each], dtype=np.float64)
        )
        known = np.isfinite(values)
        self.counts = self.count(known)
        self.values = np.where(known, values, nan)
        self.low = float(values.min(initial=inf, where=known))
        self.high = float(values.max(initial=-inf, where=known))
        self.is_plain = is_single and bool(known.all())

    def count(self, some: NDArray[np.bool_]) -> NDArray[np.int64]:
        """How many of the values of each look are among some."""
        found: NDArray[np.int64] = np.diff(np.append(0, np.cumsum(some))[self._ends], prepend=0)
        return found


@saved_type()
@dataclass
class Seen:
    """What was met of a quantity at a slot.

    low, high: of all values
    looks: with a value
    beyond: of these looks, beyond the range
    strays: values beyond it
    """

    low: float = inf
    high: float = -inf
    looks: int = 0
    beyond: int = 0
    strays: int = 0

    def add(self, values: Looks, checked: Checked) -> None:
        """Take in the values of looks."""
        if values.is_plain and checked.low <= values.low and values.high <= checked.high:
            self.looks += len(values.counts)
        elif values.counts.any():
            first, last = _with_slack(checked)
            strays = values.count((values.values < first) | (values.values > last))
            tolerated = np.where(values.counts > 1, np.maximum(1.0, TOLERATED * values.counts), 0.0)
            self.looks += int(np.count_nonzero(values.counts))
            self.beyond += int(np.count_nonzero(strays > tolerated))
            self.strays += int(strays.sum())
        self.low, self.high = min(self.low, values.low), max(self.high, values.high)

    @property
    def state(self) -> str:
        """`inside`, `at the edge` or `outside`; "" where nothing was met."""
        if not self.looks:
            return ""
        if self.beyond >= min(LOOKS, self.looks):
            return OUTSIDE
        return EDGE if self.strays else INSIDE


class Scene:
    """What `Credibility` looks at: the world, and of each machine the ranges by slot."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.ranges: dict[str, dict[str, tuple[Checked, ...]]] = {}
        self.unchecked: dict[str, dict[str, list[str]]] = {}
        self.parts = {m.name: dict(m.parts) for m in world.machines.values()}
        self.slots = {m.name: m.slots for m in world.machines.values()}
        self._fixed: dict[str, dict[str, list[float]]] = {}  # of machines, by quantity: the one value
        self.held: dict[str, list[int]] = {}
        self._meeting: dict[str, list[tuple[str, Any, bool]]] = {}  # its parts that meet, whether later
        self._foreign: dict[str, set[str]] = {}
        self._asked: dict[str, list[tuple[str, str, Checked, tuple[str, ...]]]] = {}  # as `_ask` gives it
        for machine in world.machines.values():
            self._find_ranges(machine)

    def _find_ranges(self, machine: Machine) -> None:
        name = machine.name
        ranges = self.ranges[name] = dict(_ranges_of(machine))
        self.unchecked[name] = _unchecked(machine, ranges)
        self._fixed[name] = {}
        self._asked.pop(name, None)
        self._nodes = {node.slot.name: node for node in self.world.graph.nodes}

    def holds(self, machine: str) -> list[int]:
        """Which levels, parameters and parts it has now; `held`: had when it was looked at last."""
        about = self.world.machines[machine]
        return [*map(id, about.parts.values()), *map(id, about.changed.values())]

    def take_changes(self, machine: str) -> None:
        """Levels, parameters and parts that came in since the last look."""
        about = self.world.machines[machine]
        before, now = self.slots[machine], about.slots
        if changed := [slot for slot, choice in now.items() if choice is not before[slot]]:
            self.slots[machine] = now
            self.parts[machine] |= {slot: about.parts[slot] for slot in changed}
            self._find_ranges(about)
        own = [(slot, part) for slot, part in about.parts.items() if isinstance(part, Meets)]
        self._meeting[machine] = [(slot, part, isinstance(part, MeetsLater)) for slot, part in own]
        # a part from elsewhere may have come into a slot, whose ranges are not its own
        self._foreign[machine] = {s for s, part in about.parts.items() if part is not self.parts[machine][s]}
        self.held[machine] = self.holds(machine)

    def note(self, machine: str, state: MachineState) -> Note:
        """What there is to know of a machine now."""
        told: dict[str, Any] = {}
        for slot, part, is_later in self._meeting[machine]:
            if is_later:
                told[slot] = part.note_met(state)
            else:  # of a part that may use its memory again
                met = part.meets(state).items()
                told[slot] = {n: v if isinstance(v, float) else np.array(v, np.float64) for n, v in met}
        if machine not in self._asked:
            where = self._where(machine, [(state, told)])
            asked = self._asked[machine] = list(self._ask(self.world.machines[machine], where))
            plain = {checked.quantity for *_, checked, tellers in asked if not tellers}
            self._fixed[machine] = {name: where.by_field(name)[:1] for name in FIXED & plain}
        return state, told

    def _where(self, machine: str, notes: Sequence[Note]) -> Where:
        """Where a machine was at the times of notes."""
        told = [dict(told) for _, told in notes]
        for slot, part, is_later in self._meeting[machine]:
            if is_later:
                for all_of_it, met in zip(told, part.met([own[slot] for own in told]), strict=True):
                    all_of_it[slot] = met
        return Where(self.world.machines[machine], self.world.field, [state for state, _ in notes], told)

    def values(self, machine: str, notes: Sequence[Note]) -> Iterator[tuple[str, Checked, Looks]]:
        """What a machine met at the times of notes, for each slot and range; of what no level declares for
        the machine, and for slots that are told something else of it.
        """
        where, fixed = self._where(machine, notes), self._fixed[machine]
        known: dict[tuple[str, str | tuple[str, ...]], Looks] = {}
        each: Sequence[Any]
        for subject, slot, checked, tellers in self._asked[machine]:
            name, of = checked.quantity, slot if slot in tellers else tellers
            if slot in self._foreign[machine]:
                continue
            if (name, of) not in known:
                if not of:
                    each = fixed[name] * len(notes) if name in FIXED else where.by_field(name)
                elif isinstance(of, str):
                    each = [told[of][name] for told in where.told]
                else:
                    each = where.values(name, of)
                known[name, of] = Looks(each)
            yield subject, checked, known[name, of]

    def _ask(self, machine: Machine, where: Where) -> Iterator[Asked]:
        """Whom a value counts for; the slot whose range it is, "" = only plain values are known; the range;
        slots that tell the value, () = the field.
        """
        for slot, ranges in self.ranges[machine.name].items():
            for checked in ranges:
                if checked.quantity not in (known := (*QUANTITIES, *where.told[0].get(slot, ()))):
                    key = f"{machine.name}.{slot}.checked"
                    raise InputError(key, checked.quantity, f"expected one of {', '.join(known)}")
                yield f"{machine.name}.{slot}", slot, checked, self._tellers(where, slot, checked.quantity)
        found = {}
        for slot, names in self.unchecked[machine.name].items():
            for name in names:
                tellers = self._tellers(where, slot, name)
                subject = f"{machine.name}.{slot}" if tellers else machine.name
                found[subject, name] = Checked(name, *QUANTITIES[name].plain, ""), tellers
        for (subject, _), asked in found.items():
            yield subject, "", *asked

    def _tellers(self, where: Where, slot: str, name: str) -> tuple[str, ...]:
        """Who says what a slot meets of a quantity: its part, or of control the nearest that it hears."""
        machine, found = where.machine, dict[str, None]()
        waiting, seen, told = [slot], {slot}, where.told[0]
        while waiting:
            own = waiting.pop()
            if name in told.get(own, ()) and (own == slot or isinstance(told[own][name], float)):
                found[own] = None
            elif machine.slots[slot].kind.is_control:
                wires = self._nodes[f"{machine.name}.{own}"].wires.values()
                of_it = [source.removeprefix(f"{machine.name}.") for source, _ in wires]
                waiting += [n for n in of_it if n in machine.slots and n not in seen]
                seen.update(of_it)
        return tuple(found)


def _unchecked(machine: Machine, ranges: Mapping[str, Sequence[Checked]]) -> dict[str, list[str]]:
    """For each slot: the quantities that change what it does, and for which its level declares no range."""
    found = {}
    for slot, choice in machine.slots.items():
        names = untold(choice.kind.name, {checked.quantity for checked in ranges.get(slot, ())})
        if names and machine.parts.get(slot) is not None:
            found[slot] = names
    return found


def _ranges_of(machine: Machine) -> Iterator[tuple[str, tuple[Checked, ...]]]:
    for slot, choice in machine.slots.items():
        part = machine.parts.get(slot)
        own = part.checked if isinstance(part, HasRanges) else ()
        if part is not None and (found := (*choice.found.checked, *own)):
            yield slot, found


class Credibility:
    """Watches a run like an evaluator of the field that gives no metrics."""

    METRICS: tuple[Metric, ...] = ()
    OF_FIELD = True
    SIGNALS = (MachineState,)

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.rests_until = 0
        self.next_m = dict.fromkeys(scene.ranges, 0.0)
        self.next_t = dict.fromkeys(scene.ranges, 0)
        self._seen: dict[tuple[str, str], Seen] = {}
        self._notes: dict[str, list[Note]] = {}  # by machine, those that were not judged yet

    @classmethod
    def looking(cls, parts: Sequence["Credibility"], slot: str, kinds: Sequence[type[Signal]]) -> "_Ways":
        """What looks where a machine of these worlds is, compiled."""
        return _Ways(parts, slot.partition(".")[0])

    def see(self, slot: str, t: int, outputs: Mapping[str, Signal]) -> None:
        """Look where a machine has moved on."""
        for state in samples_of(outputs, MachineState):
            ways = _Ways([self], slot.partition(".")[0])
            ways.step(t, 0, {"state": state})
            ways.look()

    def look_at(self, machine: str, state: MachineState) -> None:
        """Note what a machine meets now; many notes are judged together."""
        if self.scene.holds(machine) != self.scene.held.get(machine):
            self._judge(machine)
            self.scene.take_changes(machine)
        notes = self._notes.setdefault(machine, [])
        notes.append(self.scene.note(machine, state))
        if len(notes) == TOGETHER or not self.scene.world.field.is_firm:
            self._judge(machine)

    def _judge(self, machine: str) -> None:
        if notes := self._notes.pop(machine, []):
            for slot, checked, values in self.scene.values(machine, notes):
                self._seen.setdefault((slot, checked.quantity), Seen()).add(values, checked)

    def settle(self) -> None:
        """Judge what waits."""
        for machine in [*self._notes]:
            self._judge(machine)

    @property
    def seen(self) -> dict[tuple[str, str], Seen]:
        """By slot and quantity, what was met so far."""
        self.settle()
        return self._seen

    def metrics(self) -> dict[str, float]:
        """None of its own."""
        return {}

    def entries(self) -> dict[str, Any]:
        """As it stands in summary.json: `slots` with a declared range, and the others as `undeclared`; by
        slot the quantities that are `not_checked` there, and what was `met` of these, by machine; by slot the
        `never_checked` ones of which more than plain values were met, and the `estimates` that it rests on.
        """
        slots, rest = {}, []
        for machine in self.scene.world.machines.values():
            ranges = self.scene.ranges[machine.name]
            for slot, choice in machine.slots.items():
                name = f"{machine.name}.{slot}"
                if slot not in ranges:
                    rest += [] if choice.kind.is_control else [name]
                    continue
                rows = [self._row(name, checked) for checked in ranges[slot]]
                state = max((r["state"] for r in rows if r["state"]), key=STATES.index, default="")
                slots[name] = {"level": choice.level, "state": state, "quantities": rows}
        unchecked = self.scene.unchecked.items()
        named = {f"{machine}.{slot}": names for machine, own in unchecked for slot, names in own.items()}
        met: dict[str, dict[str, list[float]]] = {machine: {} for machine, _ in unchecked}
        for subject, own in unchecked:
            for quantity in dict.fromkeys(q for names in own.values() for q in names):
                among = [self._met(subject, slot, quantity) for slot in own if quantity in own[slot]]
                if ends := [end for seen in among if seen.looks for end in (seen.low, seen.high)]:
                    met[subject][quantity] = [rounded(min(ends), 4), rounded(max(ends), 4)]
        chosen = [choice for m in self.scene.world.machines.values() for choice in m.slots.values()]
        return {
            "slots": slots,
            "undeclared": rest,
            "not_checked": named,
            NEVER_CHECKED: self._never_checked(),
            "met": met,
            "level_errors": {e.metric: e.size for choice in chosen for e in choice.found.errors},
            "estimates": {
                slot: [band.told(key, value) for key, value, band in own]
                for slot, own in self._estimates().items()
            },
            "given": sorted({name for choice in chosen for name in choice.found.given}),
        }

    def untold(self) -> Iterator[str]:
        """Notes on what was met beyond plain values by levels that were not checked for it."""
        for machine in self.scene.unchecked:
            said = []
            for name, slots in self._beyond_plain(machine):
                seen = [self._met(machine, slot, name) for slot in slots]
                met = span((rounded(min(s.low for s in seen), 4), rounded(max(s.high for s in seen), 4)))
                said.append(f"{name} {met} ({', '.join(slots)})")
            if said:
                yield f"{machine}: levels were not checked for {'; '.join(said)}"

    def _unusual(self) -> Iterator[tuple[str, str, str, Seen]]:
        """What was met beyond plain values: machine, slot or "", quantity, and how much."""
        for (name, quantity), seen in self.seen.items():
            low, high = QUANTITIES[quantity].plain if quantity in QUANTITIES else (-inf, inf)
            if seen.looks and not low <= seen.low <= seen.high <= high:
                machine, _, slot = name.partition(".")
                yield machine, slot, quantity, seen

    def _estimates(self) -> dict[str, list[tuple[str, float, Estimate]]]:
        """By slot, or `field.stand`, the keys with a band that changed something: with value and band."""
        world, unusual = self.scene.world, [(m, q) for m, _, q, _ in self._unusual()]
        stand = world.scenario.field.stand
        holders = [("", "field.stand", None if stand is None else stand.params)]
        holders += [(m.name, f"{m.name}.{slot}", choice.params) for m in world.machines.values()
                    for slot, choice in m.slots.items() if m.parts.get(slot) is not None]  # fmt: skip
        found: dict[str, list[tuple[str, float, Estimate]]] = {}
        for machine, slot, params in holders:
            for key, value, band, owner in held(params):
                if (
                    not band.decides
                    or (machine, band.decides) in unusual
                    or getattr(owner, band.decides, False)
                ):
                    found.setdefault(slot, []).append((key, value, band))
        return found

    def rests_on_estimates(self) -> Iterator[str]:
        """Notes on estimates that decide what something did that was met beyond plain values."""
        for slot, own in self._estimates().items():
            said = [
                band.told(f"{slot}.{key}", value) for key, value, band in own if band.decides in QUANTITIES
            ]
            if said:
                decided = dict.fromkeys(band.decides for *_, band in own if band.decides in QUANTITIES)
                yield f"what {', '.join(decided)} does rests on {', '.join(said)}: run both ends, too"

    def own_law(self) -> Iterator[str]:
        """Notes on what was met beyond plain values by levels that were checked for it by their own law."""
        found: dict[tuple[str, str], dict[str, Seen]] = {}
        for machine, slot, quantity, seen in self._unusual():
            own = (c.witness for c in self.scene.ranges[machine].get(slot, ()) if c.quantity == quantity)
            if OWN_LAW in own:
                found.setdefault((machine, quantity), {})[slot] = seen
        for machine in dict.fromkeys(machine for machine, _ in found):
            said = []
            for quantity, slots in ((q, own) for (m, q), own in found.items() if m == machine):
                ends = min(s.low for s in slots.values()), max(s.high for s in slots.values())
                said.append(f"{quantity} {span([rounded(e, 4) for e in ends])} ({', '.join(slots)})")
            yield f"{machine}: levels were checked by their own law alone for {'; '.join(said)}"

    def _beyond_plain(self, machine: str) -> Iterator[tuple[str, list[str]]]:
        """Quantities met beyond plain values, each with the slots whose levels were not checked for it."""
        for name in QUANTITIES:
            slots = [slot for slot, names in self.scene.unchecked[machine].items() if name in names]
            if beyond := [slot for slot in slots if self._met(machine, slot, name).state == OUTSIDE]:
                yield name, beyond

    def _met(self, machine: str, slot: str, quantity: str) -> Seen:
        """What a slot met of a quantity for which its level declares no range."""
        own = self.seen.get((f"{machine}.{slot}", quantity))
        return own or self.seen.get((machine, quantity), Seen())

    def _never_checked(self) -> dict[str, list[str]]:
        found: dict[str, list[str]] = {}
        for machine in self.scene.unchecked:
            for name, slots in self._beyond_plain(machine):
                for slot in slots:
                    found.setdefault(f"{machine}.{slot}", []).append(name)
        return found

    def _row(self, slot: str, checked: Checked) -> dict[str, Any]:
        seen = self.seen.get((slot, checked.quantity), Seen())
        return {
            "quantity": checked.quantity,
            "checked": [checked.low, checked.high],
            "met": [_told(seen.low, checked), _told(seen.high, checked)] if seen.looks else None,
            "state": seen.state,
            "looks": seen.looks,
            "beyond": seen.beyond,
            "source": checked.source,
            "witness": checked.witness,
        }


class _Ways(Waking):
    """How far a machine of these worlds has gone."""

    def __init__(self, parts: Sequence[Credibility], machine: str) -> None:
        super().__init__(parts)
        self._machine = machine

    def launches(self) -> Sequence[Repeated]:
        """One launch."""
        from swath.judge.look_kernel import watch_way

        self._next_t = np.array([part.next_t.get(self._machine, NEVER) for part in self.parts])
        self._next_m = np.array([part.next_m.get(self._machine, inf) for part in self.parts])
        seen = self.clock, self.given["state"].arrays["distance"], REST, EVERY_M
        return [self.launch(watch_way, self.needs, self.active, *seen, self._next_t, self._next_m, self.asks)]

    def wake(self, world: int) -> None:
        """Look at what it meets now."""
        self.parts[world].look_at(self._machine, self.given["state"].view(world))

    def look(self) -> None:
        """Tell when to look next."""
        for part, t, way in zip(self.parts, self._next_t.tolist(), self._next_m.tolist(), strict=True):
            if self._machine in part.next_t:
                part.next_t[self._machine], part.next_m[self._machine] = t, way
                part.rests_until = min(part.next_t.values())


def annotate(summary: dict[str, Any], watch: Credibility, catalogue: EvaluatorCatalogue) -> list[str]:
    """Put `credibility` into a summary, and into its limits what they rest on that was outside
    (`rests_outside`) and how far off their metric may be (`level_error`). Returns notes.
    """
    summary[SUMMARY] = watch.entries()
    outside = outside_of(summary)
    errors = _errors(watch.scene.world)
    controls = _controls(watch.scene.world)
    doubtful = []
    for entry in summary["expect"]:
        slots = rests_on(watch.scene.world, catalogue, entry["subject"], entry["name"])
        margin = getattr(catalogue.metrics.get(entry["name"]), "margin", "")
        metrics = {**summary, **summary.get("machines", {}).get(entry["subject"], {})}
        moved = {
            name: _moved(watch.scene, name, outside[name]["quantities"], margin or entry["name"])
            for name in outside
            if name in slots - controls
        }
        beyond = [name for name, by in moved.items() if not _holds(entry, by, margin, metrics)]
        if beyond and not (
            entry["result"] == "fail" and _ended_it(watch.scene.world, catalogue, entry["name"])
        ):
            entry["rests_outside"] = beyond
            doubtful.append(entry["name"])
        if "hold" in entry["limit"]:
            continue
        if found := [(n, e) for n, e in errors if n in slots and e.metric == entry["name"]]:
            slot, error = max(found, key=lambda pair: pair[1].size)
            size = max([error.size, *(by for by in moved.values() if by and not margin and not beyond)])
            entry["level_error"] = {"size": size, "slot": slot, "against": error.against}
    notes = [f"{name}: {why_outside(entry)}" for name, entry in outside.items()]
    notes += [*watch.untold(), *watch.own_law(), *watch.rests_on_estimates()]
    if doubtful:
        notes.append(f"not to be relied on, they rest on that: {', '.join(dict.fromkeys(doubtful))}")
    return notes


def _moved(scene: Scene, name: str, quantities: Sequence[Mapping[str, Any]], metric: str) -> float | None:
    """By how much a slot outside its range moves a metric at most; None where nobody measured it.

    quantities: that are outside, as `outside_of` gives them
    """
    machine, _, slot = name.partition(".")
    slots, sizes = scene.world.machines[machine].slots, [0.0]
    heard_by = {
        node.slot.name
        for node in scene.world.graph.nodes
        if name in {source for source, _ in node.wires.values()}
    }
    known = {checked.quantity: checked.beyond for checked in scene.ranges[machine][slot]}
    for row in quantities:
        beyond = known[row["quantity"]]
        if beyond is None or metric not in beyond.moved:
            return None
        listening = [slots.get(other.removeprefix(f"{machine}.")) for other in heard_by]
        is_heard = all(own and beyond.heard_by.get(own.kind.name) == own.level for own in listening)
        if not is_heard or not beyond.low <= row["met"][0] <= row["met"][1] <= beyond.high:
            return None
        sizes.append(beyond.moved[metric])
    return sum(sizes)


def _holds(entry: Mapping[str, Any], moved: float | None, margin: str, metrics: Mapping[str, Any]) -> bool:
    """Whether a limit on the whole run comes to the same with its metric, or its margin, moved so far."""
    limit, value = entry["limit"], entry["value"]
    if moved is None or value is None or "window" in entry or "hold" in limit:
        return False
    if margin:
        return value == 0.0 and float(metrics.get(margin, inf)) > moved
    ends = (value - moved, value + moved)
    kept = [limit.get("min", -inf) <= end <= limit.get("max", inf) for end in ends]
    return all(kept) if entry["result"] == "pass" else not any(kept)


def _ended_it(world: World, catalogue: EvaluatorCatalogue, name: str) -> bool:
    """Whether an event of the evaluator of a metric ended the run."""
    maker, why = catalogue.maker_of(name), world.graph.ended
    return isinstance(why, Ending) and isinstance(maker, HasEvents) and why.kind in maker.EVENTS


def outside_of(summary: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Slots of a summary whose level was outside its range: `level`, and `quantities` with `quantity`, `met`
    and `checked`.
    """
    slots = summary.get(SUMMARY, {}).get("slots", {})
    return {
        name: {
            "level": slot["level"],
            "quantities": [
                {key: row[key] for key in ("quantity", "met", "checked")}
                for row in slot["quantities"]
                if row["state"] == OUTSIDE
            ],
        }
        for name, slot in slots.items()
        if slot["state"] == OUTSIDE
    }


def why_outside(entry: Mapping[str, Any]) -> str:
    """Reason why a slot of `outside_of` is outside, in words."""
    what = [f"{q['quantity']} {span(q['met'])}, checked {span(q['checked'])}" for q in entry["quantities"]]
    return f"outside the range in which level {entry['level']} was checked: {'; '.join(what)}"


def rests_on(world: World, catalogue: EvaluatorCatalogue, subject: str, name: str) -> set[str]:
    """Full names of the slots on which a metric rests, or a column of the tracks: those whose samples its
    evaluator sees, and all that feed these.
    """
    if getattr(catalogue.metrics.get(name), "is_identity", False):
        return set()
    nodes = {node.slot.name: node for node in world.graph.nodes}
    maker = catalogue.maker_of(name)
    kinds = maker.SIGNALS if isinstance(maker, HasSignals) else _with_column(nodes.values(), name)
    waiting = [
        slot
        for slot, node in nodes.items()
        if subject in (FIELD, slot.partition(".")[0])
        and (kinds is None or any(issubclass(port.signal, kinds) for port in node.component.outputs))
    ]
    found: set[str] = set()
    while waiting:
        slot = waiting.pop()
        if slot in nodes and slot not in found:
            found.add(slot)
            waiting += [source for source, _ in nodes[slot].wires.values()]
    return found


def _with_column(nodes: Iterable[Any], name: str) -> tuple[type[Signal], ...] | None:
    """Signals that are sent and of which a number is this column of the tracks; None where nobody says it."""
    kinds = {port.signal for node in nodes for port in node.component.outputs}
    return (
        tuple(k for k in kinds if any(c.name == name for q in quantities(k).values() for c in q.tracks))
        or None
    )


def _errors(world: World) -> Sequence[tuple[str, KnownError]]:
    return [
        (f"{machine.name}.{slot}", error)
        for machine in world.machines.values()
        for slot, choice in machine.slots.items()
        for error in choice.found.errors
    ]


def _controls(world: World) -> set[str]:
    """Full names of slots of control: what they do is judged wherever they are used, they model nothing."""
    of_each = ((m.name, slot, choice) for m in world.machines.values() for slot, choice in m.slots.items())
    return {f"{name}.{slot}" for name, slot, choice in of_each if choice.kind.is_control}


def _told(value: float, checked: Checked) -> float:
    """Four digits of it, or as many as say whether it lies in a range."""
    forms = [rounded(value, digits) for digits in (4, 6, 9, 17)]
    return next(form for form in forms if holds(checked, form) == holds(checked, value))


def _with_slack(checked: Checked) -> tuple[float, float]:
    """Ends of a range, apart by what rounding leaves open, and by what is too little to change anything."""
    low, high = checked.low, checked.high
    little = QUANTITIES[checked.quantity].little if checked.quantity in QUANTITIES else 0.0
    return low - max(SLACK * abs(low), little), high + max(SLACK * abs(high), little)


def holds(checked: Checked, value: float) -> bool:
    """Whether a value lies in a range."""
    first, last = _with_slack(checked)
    return first <= value <= last
