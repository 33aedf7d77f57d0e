"""A short drive on stems without a LiDAR, whose process and powertrain are what a test puts there."""

import json
from functools import cache
from pathlib import Path

from swath.core.component import Port
from swath.core.foreign_code import allow_code
from swath.core.frames import Pose
from swath.machine.machine_sheet import load_machine
from swath.scenario.scenario import parse_scenario
from swath.signals import CropFlow, EngineState, MachineLoad, MachineState
from swath.signals.setup import ControlSetup, LinkSetup

TEXT = """
format: swath scenario 2
name: fmu
seed: 3
run: {distance_m: 3, max_duration_s: 6}
field:
  terrain: {level: plane}
  stand: {level: uniform, stems_per_m2: 400}
  edge: {shape: straight}
machines:
  combine:
    motion: {level: kinematic, start_speed_kmh: 7}
    lidar: off
    edge: truth
"""
POWERS = ("header", "threshing", "separation", "cleaning", "chopper", "unloading", "propulsion", "auxiliary")
NO_POWERS = {f"engine.{name}_power": 0 for name in POWERS}


def scenario(*sets, process=None, powertrain=None):
    """The drive; process, powertrain: keys of those slots."""
    text = TEXT
    for slot, keys in (("process", process), ("powertrain", powertrain)):
        if keys is not None:
            text += f"    {slot}: {json.dumps(keys)}\n"
    with allow_code(None):
        return parse_scenario(text, sets=list(sets))


@cache
def process_setup():
    """What a part in the process slot is told, without a world around it."""
    signals = {"state": MachineState, "flow": CropFlow, "engine": EngineState}
    ports = tuple(Port(name, signal, optional=True) for name, signal in signals.items())
    control = ControlSetup(load_machine("lexion-700-class"), {"scan": Pose.identity()}, "left", 0.1)
    return LinkSetup("combine", "process", ports, (Port("load", MachineLoad),), control, Path())


def process_part(**keys):
    """An FMU in that slot."""
    from swath.link.levels.fmu import Params, make_part

    with allow_code(None):
        return make_part(Params(**keys), process_setup())
