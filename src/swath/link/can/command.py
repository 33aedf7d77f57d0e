"""`swath can`: a controller box on a bus, a monitor of its messages, and the message descriptions."""

import argparse
from typing import Any

from swath.terminal.options import add_sets, former, option, verb

PLACE = "connect", 2  # among all commands


def add(parsers: Any) -> None:
    """Add the command and its parts."""
    parser = parsers.add_parser("can", help="a controller box on a CAN bus, a monitor of its messages")
    parts = parser.add_subparsers(metavar="PART", required=True)
    box = verb(parts, "box", "run the controller box of a scenario", run_box, _BOX)
    option(box, "scenario NAME|FILE", "scenario whose steering law runs in the box")
    add_sets(box)
    option(box, "--once", "end when the machine has switched off")
    listen = verb(parts, "listen", "print the messages on a bus", run_listen)
    for each in (box, listen):
        option(each, "--interface NAME", "interface of python-can, e.g. socketcan")
        option(each, "--channel NAME", "its channel, e.g. can0")
        option(each, "--option KEY=VALUE", "further settings of the interface", [])
    option(box, "--address N", "CAN address of the box (default 28)", type=int)
    option(listen, "--duration-s S", "end after S seconds", type=float)
    option(listen, "--count N", "end after N frames", type=int)
    former(listen, duration_s="--for")
    verb(parts, "dbc", "print where the DBC file is", run_dbc)


def run_box(args: argparse.Namespace) -> int:
    """Serve the machine until Ctrl-C, or with `--once` until it has switched off.

    The box is that of the first machine that has the slot `steer`: of level `can`, which says bus and law, or
    a law itself, which then runs every 100 ms on the default bus. It knows the machine's data sheet, not the
    mounting of the sensor.
    """
    from swath.core.errors import InputError
    from swath.documents import j1939
    from swath.documents.validation import adapter_of
    from swath.link.can import box
    from swath.link.can.bus import Node
    from swath.link.can.steering import Params
    from swath.machine.machine_sheet import load_machine
    from swath.scenario.scenario import load_scenario
    from swath.signals.setup import ControlSetup

    scenario = load_scenario(args.scenario, sets=args.sets)
    section = next((m for m in scenario.machines.values() if "steer" in m.slots), None)
    if section is None:
        raise InputError("steer", "off", "expected a steering law for the box to run")
    steer = section.slots["steer"]
    machine = load_machine(section.sheet.as_posix(), header_width_m=section.common.header_width_m)
    params = steer.params if isinstance(steer.params, Params) else Params()
    setup = ControlSetup(machine, {}, section.common.edge_side, params.period * 1e-9)
    if isinstance(steer.params, Params):
        law = params.make_law(setup, None if scenario.file is None else scenario.file.parent)
    else:
        keys = adapter_of(steer.params.__class__).dump_python((steer.params,), mode="json")[0]
        law = box.make_law(steer.level, keys, setup, period=params.period)
    address = args.address or params.box_address or j1939.NAVIGATION
    node = Node(_where(args, params.where), address, device_class=j1939.NO_CLASS)
    served = box.ControllerBox(law, node, period=params.period, wheelbase=machine.wheelbase)
    try:
        box.run_box(served, node, once=args.once, say=lambda text: print(text, flush=True))
    finally:
        node.close()
    return 0


def run_listen(args: argparse.Namespace) -> int:
    """Print every frame: time, source, destination, name or PGN, values."""
    import time

    from swath.documents import j1939
    from swath.link.can.bus import open_bus
    from swath.link.can.codec import Codec
    from swath.link.can.steering import Params

    codec, bus, began, left = Codec(), open_bus(_where(args, Params().where)), time.monotonic(), args.count
    try:
        while left != 0 and (args.duration_s is None or time.monotonic() - began < args.duration_s):
            frame = bus.recv(0.2)
            if frame is None or not frame.is_extended_id:
                continue
            left = None if left is None else left - 1
            header, data = j1939.parse(frame.arbitration_id), bytes(frame.data)
            decoded = codec.decode(header.pgn, data)
            name, values = decoded or (f"PGN {header.pgn}", {})
            numbers = [f"{key} {'-' if v is None else f'{v:g}'}" for key, v in values.items()]
            said = ", ".join(numbers) or data.hex(" ")
            at = time.monotonic() - began
            print(f"{at:9.3f}  {header.source:3d} > {header.destination:3d}  {name}: {said}", flush=True)
    finally:
        bus.shutdown()
    return 0


def run_dbc(args: argparse.Namespace) -> int:
    """Print the path."""
    from swath.documents.j1939 import dbc_file

    print(dbc_file())
    return 0


def _where(args: argparse.Namespace, default: Any) -> Any:
    """The bus that the flags say; what they leave out is the default's."""
    from swath.core.errors import InputError
    from swath.core.typed_numbers import check_text
    from swath.documents.yaml_document import parse_value
    from swath.link.can.bus import Where, check_bus

    options = dict(default.options)
    for text in args.option:
        key, equals, value = text.partition("=")
        if not equals:
            raise InputError(f"--option {text}", None, "expected KEY=VALUE")
        options[key] = parse_value(value, f"--option {text}")
        check_text(f"--option {key}", key, value, options[key])
    return check_bus(Where(args.interface or default.interface, args.channel or default.channel, options))


_BOX = """Runs the controller box of a scenario: its steering law, behind a CAN bus. Where the slot steer has
the level can, bus and law are as written there; where it has a law, that law runs on the bus of the flags."""
