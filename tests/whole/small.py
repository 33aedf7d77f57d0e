"""A small, quick version of the real job: real wheat, few rays, a few metres."""

from swath.scenario.scenario import parse_scenario

TEXT = """
format: swath scenario 2
name: small
seed: 3
run: {distance_m: 4, max_duration_s: 6}
field:
  terrain: {level: formula, slope_percent: 1.0, roughness_class: C}
  stand: {level: uniform, stems_per_m2: 400}
  edge: {shape: straight}
  obstacles: [{kind: post, x_m: -1.5, y_m: 12}]
machines:
  combine:
    motion: {level: single_track, start_speed_kmh: 7}
    lidar: {sub_rays: 7, sector_deg: [-40, 40], step_deg: 1.0}
"""


def small(*sets):
    """The scenario with overrides such as `seed=4`."""
    return parse_scenario(TEXT, sets=list(sets))
