"""Makes the figures of docs/explanation/steering.md and edge-detection.md."""

import sys
from pathlib import Path

import matplotlib
import numpy as np

matplotlib.use("Agg")
import matplotlib.pyplot as plt

from swath.core.component import Outputs
from swath.field.edges.present_edge import STEP_M, crop_across, edges_of
from swath.runtime.assembly import assemble
from swath.runtime.loop import drive
from swath.scenario.scenario import load_scenario

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parents[1] / "tests" / "control"))

from closed_loop import Course, Loop  # noqa: E402
from otsu_in_numpy import Reach, make_profile  # noqa: E402

CROP, STUBBLE, EDGE, TRUTH = "#2a7f3e", "#b07d2b", "#c2185b", "#333333"


def profile_figure() -> None:
    """A scan of the scenario `straight` after 20 m, with what the detector `otsu` makes of it."""
    world = assemble(load_scenario("straight", sets=["combine.edge=otsu"]))
    seen: Outputs = {}

    def look(slot: str, t: int, outputs: Outputs) -> None:
        seen.update(outputs)

    drive(world, [look], until_s=10.0)
    machine, scan, edge, state = world.leader, seen["scan"], seen["edge"], seen["state"]
    profile = make_profile(scan, machine.mountings["lidar"], 1.0, 1.94, 0.0, Reach())
    near = np.abs(profile.u - edge.offset) < 3.0
    x, y, z = profile.x[near], profile.u[near], profile.z[near]
    begin = edge.offset + 2.0
    line = crop_across(world.field, state.pose, np.array([edge.reference_x]), begin, begin - 4.0)
    true_y = begin - STEP_M * edges_of(line)[0][0]
    rows = machine.parts["edge"].save()["track"]
    used = rows[rows[:, 5] > 0]

    fig, (top, plan) = plt.subplots(1, 2, figsize=(11, 4.2), constrained_layout=True)
    is_crop = z > 0.45
    for mask, colour, name in ((is_crop, CROP, "crop echoes"), (~is_crop, STUBBLE, "stubble and ground")):
        top.scatter(y[mask], z[mask], s=12, color=colour, label=name)
        plan.scatter(y[mask], x[mask], s=12, color=colour)
    for axes in (top, plan):
        axes.axvline(edge.offset, color=EDGE, lw=1.6, label=f"detected {edge.offset:.2f} m")
        axes.axvline(true_y, color=TRUTH, lw=1.2, ls="--", label=f"true {true_y:.2f} m")
        axes.set_xlabel("y, left of the machine's middle [m]")
        axes.invert_xaxis()
        axes.grid(alpha=0.25)
    plan.scatter(-used[:, 1], used[:, 0], s=7, color=EDGE, alpha=0.6, label="edge points of 7.5 m of travel")
    top.set_ylabel("height above the machine's ground plane [m]")
    plan.set_ylabel("x, ahead of the fixed axle [m]")
    top.legend(loc="center left")
    plan.legend(handles=plan.collections[2:3], loc="lower left")
    top.set_title("One scan: a step of two populations of heights")
    plan.set_title("Seen from above: where the echoes lie")
    fig.savefig(HERE / "edge_profile.png", dpi=110)


def steering_figure() -> None:
    """The steering law on the kinematic bench: a step of half a metre, bends, side slip."""
    fig, (step, bend, slip) = plt.subplots(1, 3, figsize=(12, 3.6), constrained_layout=True)
    for speed in (1.0, 1.94, 3.5):
        rows = Loop(speed=speed, start_error=0.5).run(40)
        step.plot(rows[:, 0], 100 * rows[:, 1], label=f"{3.6 * speed:.0f} km/h")
        for radius, style in ((40.0, "-"), (-40.0, "--")):
            rows = Loop(speed=speed, course=Course(radius, 20.0)).run(70)
            name = f"{3.6 * speed:.0f} km/h, {'left' if radius > 0 else 'right'}"
            bend.plot(rows[:, 0], 100 * rows[:, 1], style, lw=1, label=name)
        rows = Loop(speed=speed, crab=np.deg2rad(1.4)).run(70)
        slip.plot(rows[:, 0], 100 * rows[:, 1], label=f"{3.6 * speed:.0f} km/h")
    step.set_title("Start half a metre off")
    bend.set_title("Bend, R = 40 m, from 20 m on")
    slip.set_title("Side slip of 1.4 deg (10 % side slope)")
    for axes in (step, bend, slip):
        axes.set_xlabel("travelled [m]")
        axes.set_ylabel("header end off its line [cm]")
        axes.grid(alpha=0.25)
        axes.axhline(0, color="k", lw=0.6)
        axes.legend(fontsize=8)
    fig.savefig(HERE / "steering.png", dpi=110)


if __name__ == "__main__":
    steering_figure()
    profile_figure()
