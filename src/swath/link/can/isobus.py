"""A run's machine on the bus, as a terminal sees it: engine, speeds, header, and a task controller's client.

Messages of ISO 11783-7 and J1939 on the clock of the run: EEC1 every 20 ms, EEC2 every 50 ms, wheel- and
ground-based speed and the state of the header (front hitch) every 100 ms; the client is in task_client.py.
Values are what the machine's own sensors and control units send, never the truth; what it does not measure
is `not available` or no part of the description. What `settings: fixed` wants of the organs a task controller
may set, and what has no data identifier a proprietary message: each is a change of the run, kept among its
events.
"""

from collections.abc import Mapping
from contextlib import suppress
from typing import Any, get_args, get_type_hints

from annotated_types import Le

from swath.control.settings.fixed import UNITS, Params
from swath.core.errors import SwathError
from swath.core.schedule import NS
from swath.core.units import DEG, MM
from swath.documents import j1939
from swath.link.can import guidance
from swath.link.can.bus import Node, Where
from swath.link.can.codec import Values
from swath.link.can.task_client import PROCESS_DATA, TP_CONTROL, TP_DATA, Datum, TaskClient
from swath.runtime.hooks import ActiveRun, RunHook
from swath.runtime.world import Machine
from swath.signals import (
    CropFlow,
    EngineState,
    GrainImage,
    GroundSpeed,
    HeaderState,
    LossReading,
    Odometry,
    OrganSettings,
    ReturnsReading,
    Signal,
    YieldReading,
)
from swath.signals.settings import NAMES, own_settings

ENGINE, LOAD, HEADER = "ElectronicEngineController1", "ElectronicEngineController2", "FrontHitchStatus"
ORGANS, COMMAND = "OrganStatus", "OrganCommand"
EVERY = {ENGINE: NS // 50, LOAD: NS // 20, guidance.WHEEL: NS // 10, ORGANS: NS}
MOST_HEARD = 1000  # messages between two ticks: a bus that is flooded does not stop the run
ADDRESS = 128  # the first that a control function may choose itself (ISO 11783-5)
IN_WORK_M = 0.5  # a knife lower than that is at work: the standard leaves the threshold to the maker
DIESEL_KG_L = 0.835  # EN 590: 0.820 to 0.845 at 15 degrees
TURN = 2.0 * 3.141592653589793  # [rad]
RPM = 60.0 / TURN
DATA = (  # DDI and scale: ISO 11783-11 as in the public dictionary, isobus.net
    Datum(141, 0, "work state", 1.0, ""),
    Datum(397, 0, "speed", 1e-3, "m/s"),
    Datum(149, 0, "fuel rate", 3.6e-3, "l/h"),
    Datum(67, 1, "working width", 1e-3, "m"),
    Datum(116, 1, "area", 1.0, "m2"),
    Datum(87, 1, "grain flow", 1e-6, "kg/s"),
    Datum(90, 1, "grain", 1.0, "kg"),
    Datum(99, 1, "moisture", 1e-4, "%"),
    Datum(93, 0, "loss per area", 1e-6, "kg/m2"),
    Datum(96, 0, "loss", 1e-6, "kg/s"),
    Datum(98, 0, "loss of the grain", 1e-4, "%"),
    Datum(100, 1, "contamination", 1e-4, "%"),
)
WANTED = {242: "lower_sieve_mm", 246: "upper_sieve_mm", 250: "concave_mm", 254: "fan_rpm"}
"""DDI of a setting as it is wanted -> key of `settings: fixed`; then those of the setting as it is, of the
least and of the greatest that is taken."""
COMMANDED = {"DrumSpeedCommand": "drum_rpm", "VaneAngleCommand": "vane_deg"}
NAME_OF = dict(zip(UNITS, NAMES, strict=True))
NEEDS = {141: CropFlow, 397: Odometry, 149: EngineState, 67: CropFlow, 116: CropFlow, 87: YieldReading,
         90: YieldReading, 99: YieldReading, 93: LossReading, 96: LossReading, 98: LossReading,
         100: GrainImage}  # fmt: skip
TASK_PGNS = frozenset((PROCESS_DATA, TP_CONTROL, TP_DATA))


class IsobusMachine(RunHook):
    """Run hook: the first machine with a header, else the first, is a node of the bus."""

    def __init__(self, where: Where) -> None:
        self._where = where
        self._node: Node | None = None
        self._client: TaskClient | None = None
        self._latest: dict[type[Signal], Any] = {}
        self.count = 0

    def begin(self, run: ActiveRun) -> None:
        """Switch the machine on: claim an address, send with the clock of the run."""
        self.close()
        machines = run.world.machines.values()
        machine = next((m for m in machines if m.cuts), run.world.leader)
        self._run, self._machine, self._latest = run, machine, {}
        self._wanted, self._actual = OrganSettings(0), dict[str, float]()
        self._way = self._grain = self._area = 0.0
        self._before: int | None = None
        self._due = {name: 0 for name in EVERY if name != ORGANS or machine.slots_of("settings")}
        self._has_guidance = any(c.level == "can" for c in machine.section.slots.values())
        self._node = Node(self._where, ADDRESS, device_class=j1939.HARVESTER, raw=TASK_PGNS)
        self._client = TaskClient(
            self._send_raw, data_of(machine), self._node.name, machine.name, *_header_mm(machine), self._put
        )
        self._node.claim()
        run.observers.append(self._see)
        run.world.graph.before_tick.append(self._tick)

    def summarize(self, t: int) -> dict[str, Any]:
        """How many frames were sent, and what became of the task controller."""
        received = [] if self._client is None else self._client.events
        return {"isobus": {"frames": self.count, "task_controller": list(received)}}

    def close(self) -> None:
        """Switch the machine off and leave the bus. Calling it again does nothing."""
        node, client = self._node, self._client
        self._node = self._client = None
        if node is not None and client is not None:
            with suppress(SwathError):  # the bus may be gone already
                self._node = node
                client.leave()
                if not self._has_guidance:
                    off = guidance.speed_values("Wheel", 0.0, self._way)
                    self._send(guidance.WHEEL, {**off, "KeySwitch": 0})
            self._node = None
            node.close()

    def _see(self, slot: str, t: int, outputs: Mapping[str, Signal]) -> None:
        if slot.partition(".")[0] != self._machine.name:
            return
        for output, signal in outputs.items():
            if output == "actual" and isinstance(signal, OrganSettings):
                self._actual |= {n: value for n in NAMES if (value := getattr(signal, n)) == value}
            elif isinstance(signal, OrganSettings):
                self._wanted = signal
            else:
                self._latest[type(signal)] = signal

    def _put(self, ddi: int, value: float) -> bool:
        """Set what is wanted of an organ, in the unit of the value; False where that cannot be."""
        key = WANTED[ddi]
        return self._set(key, value * _unit(key)[0] / UNITS[key])

    def _set(self, key: str, value: float) -> bool:
        """Set a key of the settings; False where that cannot be."""
        (slot,), wanted = self._machine.slots_of("settings"), float(f"{value:.6g}")
        try:
            self._run.changes.set(self._run.world.graph.t, f"{self._machine.name}.{slot}.{key}", wanted)
        except SwathError:
            return False
        return True

    def _tick(self, t: int) -> None:
        self._integrate(t)
        node, client, values = self._node, self._client, self._values()
        assert node is not None
        assert client is not None
        for _ in range(MOST_HEARD):
            message = node.receive()
            if message is None:
                break
            if message.pgn in TASK_PGNS:
                client.hear(message.pgn, message.data, message.source, t, values)
            elif message.name == COMMAND and ORGANS in self._due:
                self._command(message.values)
        client.tick(t, 1000.0 * self._way, values)
        due = [name for name, at in self._due.items() if t >= at]
        self._due |= {name: t + EVERY[name] for name in due}
        engine = self._latest.get(EngineState)
        if ENGINE in due:
            self._send(ENGINE, {} if engine is None else {"EngineSpeed": engine.speed * RPM})
        if LOAD in due:
            share = None if engine is None else 100.0 * engine.load
            self._send(LOAD, {"EnginePercentLoadAtCurrentSpeed": share})
        if ORGANS in due:
            self._send(ORGANS, self._organs())
        if guidance.WHEEL in due:
            self._send_speeds()
            self._send(HEADER, header_values(self._latest.get(HeaderState), self._machine.cuts))

    def _command(self, values: Values) -> None:
        """Set what a command asks for that is not wanted yet."""
        wanted = own_settings(self._machine.sheet.works, self._crop, self._wanted)
        for name, key in COMMANDED.items():
            asked = values.get(name)
            if asked is not None and abs(asked * UNITS[key] - wanted[NAME_OF[key]]) > 1e-9:
                self._set(key, asked)

    def _organs(self) -> Values:
        """What of the organs has no data identifier."""
        wanted = own_settings(self._machine.sheet.works, self._crop, self._wanted)
        returns, image = self._latest.get(ReturnsReading), self._latest.get(GrainImage)
        return {
            "DrumSpeed": self._actual.get("drum", wanted["drum"]) * RPM,
            "VaneAngle": wanted["vane"] / DEG,
            "Returns": None if returns is None else returns.flow,
            "BrokenGrain": None if image is None else 100.0 * image.broken,
        }

    def _send_speeds(self) -> None:
        """Not where a steering level on the bus already does."""
        if self._has_guidance:
            return
        odometry, ground = self._latest.get(Odometry), self._latest.get(GroundSpeed)
        wheel = None if odometry is None else odometry.speed
        over_ground = (wheel, self._way) if ground is None else (ground.speed, ground.distance)
        self._send(guidance.WHEEL, guidance.speed_values("Wheel", wheel, self._way))
        self._send(guidance.GROUND, guidance.speed_values("Ground", *over_ground))

    def _integrate(self, t: int) -> None:
        """Way, area and grain up to t, as a terminal adds them up."""
        dt = 0.0 if self._before is None else (t - self._before) / NS
        self._before = t
        odometry, flow = self._latest.get(Odometry), self._latest.get(CropFlow)
        step = 0.0 if odometry is None else abs(odometry.speed) * dt
        self._way += step
        if flow is not None:
            self._area += step * flow.header_fill * self._machine.sheet.header_width
        grain = self._latest.get(YieldReading)
        if grain is not None:
            self._grain += max(grain.flow, 0.0) * dt

    def _values(self) -> dict[int, float]:
        """What can be reported now, by DDI."""
        found: dict[int, float] = {}
        odometry, flow = self._latest.get(Odometry), self._latest.get(CropFlow)
        engine, grain = self._latest.get(EngineState), self._latest.get(YieldReading)
        if odometry is not None:
            found[397] = abs(odometry.speed)
        if flow is not None:
            width = flow.header_fill * self._machine.sheet.header_width
            found |= {141: float(flow.header_fill > 0.0), 67: width, 116: self._area}
        if engine is not None:
            found[149] = 3600.0 * engine.fuel / DIESEL_KG_L
        if grain is not None:
            found |= {87: grain.flow, 90: self._grain, 99: 100.0 * grain.moisture}
        loss: LossReading | None = self._latest.get(LossReading)
        if loss is not None:
            lost = found[96] = loss.separation + loss.cleaning
            if grain is not None and grain.flow + lost > 0.0:
                found[98] = 100.0 * lost / (grain.flow + lost)
            if (rate := found.get(67, 0.0) * found.get(397, 0.0)) > 0.0:
                found[93] = lost / rate
        image = self._latest.get(GrainImage)
        if image is not None:
            found[100] = 100.0 * image.foreign
        wanted = own_settings(self._machine.sheet.works, self._crop, self._wanted)
        for ddi, key in WANTED.items():
            name, (unit, count, _) = NAME_OF[key], _unit(key)
            greatest = _greatest(key) * UNITS[key] / unit
            found |= {ddi: wanted[name] / unit, ddi + 1: self._actual.get(name, wanted[name]) / unit}
            found |= {ddi + 2: count, ddi + 3: greatest - greatest % count}
        return {ddi: value for ddi, value in found.items() if value == value}

    @property
    def _crop(self) -> str:
        return str(self._run.world.field.stand.crop)

    def _send(self, name: str, values: Values) -> None:
        if self._node is not None:
            self._node.send(name, values)
            self.count += 1

    def _send_raw(self, pgn: int, data: bytes, destination: int) -> None:
        if self._node is not None:
            self._node.send_raw(pgn, data, destination)
            self.count += 1


def data_of(machine: Machine) -> tuple[Datum, ...]:
    """What a machine can report: of what its parts send."""
    ports = {slot: part.outputs for slot, part in machine.parts.items()}
    sent = {port.signal for of in ports.values() for port in of}
    found = [datum for datum in DATA if NEEDS[datum.ddi] in sent]
    for slot in machine.slots_of("settings"):
        is_fixed = machine.section.slots[slot].level == "fixed"
        for ddi, key in WANTED.items():
            name, (_, scale, unit) = NAME_OF[key], _unit(key)
            found.append(Datum(ddi, 0, f"{name} wanted", scale, unit, is_fixed))
            organ = "threshing" if name == "concave" else "cleaning"
            if any(port.name == "actual" for port in ports.get(organ, ())):
                found.append(Datum(ddi + 1, 0, f"{name} as it is", scale, unit))
            if is_fixed:
                found.append(Datum(ddi + 2, 0, f"{name} least", scale, unit))
                found.append(Datum(ddi + 3, 0, f"{name} greatest", scale, unit))
    return tuple(found)


def _unit(key: str) -> tuple[float, float, str]:
    """Of the data of a setting: in SI, its scale, as shown."""
    return (TURN, 1e-3, "1/s") if key == "fan_rpm" else (MM, 1.0, "mm")


def _greatest(key: str) -> float:
    """The greatest value that a key of the settings takes."""
    (hint, _) = get_args(get_type_hints(Params, include_extras=True)[key])
    bound: Any = next(mark.le for mark in hint.__metadata__ if isinstance(mark, Le))
    return float(bound)


def header_values(header: HeaderState | None, has_header: bool) -> Values:
    """Front hitch status. A header without a state of its own is fixed at its cutting height: at work."""
    if not has_header:
        return {}
    return {"FrontHitchInWork": 1 if header is None else int(float(header.heights.mean()) < IN_WORK_M)}


def _header_mm(machine: Machine) -> tuple[int, int]:
    """Width of the header, and how far ahead of the fixed axle its knife is [mm]."""
    sheet = machine.sheet
    return (round(1000 * sheet.header_width), round(1000 * sheet.knife_x)) if machine.cuts else (0, 0)
