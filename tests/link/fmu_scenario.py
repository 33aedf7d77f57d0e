"""A short drive on stems without a LiDAR, whose process and powertrain are what a test puts there."""

from swath.sim.scenario import parse_scenario

TEXT = """
name: fmu
seed: 3
run: {distance_m: 3, max_duration_s: 6}
field:
  terrain: {level: plane}
  stand: {level: uniform, stems_per_m2: 400}
  edge: {shape: straight}
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
            text += f"  {slot}: {_flow(keys)}\n"
    return parse_scenario(text, sets=list(sets))


def _flow(value):
    import json

    return json.dumps(value)
