"""Draws figures/mounting.png: what roll, pitch and yaw of a mounting turn."""

from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from swath.core.frames import Pose

VIEWS = (  # title, angles (roll, pitch, yaw) [rad], axes shown, their names, the sensor's own line
    (
        "roll_deg = 20: left side up\n(from behind)",
        (20, 0, 0),
        (1, 2),
        ("← left", "up →"),
        ((0, -1, 0), (0, 1, 0)),
    ),
    (
        "pitch_deg = 20: nose down\n(from the right)",
        (0, 20, 0),
        (0, 2),
        ("ahead →", "up →"),
        ((0, 0, 0), (1, 0, 0)),
    ),
    (
        "yaw_deg = 20 at: axle, to the left\n(from above)",
        (0, 0, 20),
        (1, 0),
        ("← left", "ahead →"),
        ((0, 0, 0), (1, 0, 0)),
    ),
)


def main() -> None:
    """Draw it."""
    figure, panels = plt.subplots(1, 3, figsize=(9.6, 3.2), layout="constrained")
    for axes, (title, angles, shown, names, line) in zip(panels, VIEWS, strict=True):
        pose = Pose.from_euler((0.0, 0.0, 0.0), *np.radians(angles))
        for turned, style in (
            (False, {"color": "#999999", "ls": "--"}),
            (True, {"color": "#D55E00", "lw": 2.5}),
        ):
            points = np.array(line, dtype=float)
            points = pose.apply(points) if turned else points
            axes.plot(points[:, shown[0]], points[:, shown[1]], **style)
            axes.plot(*points[-1][list(shown)], "o", color=style["color"])
        axes.plot(0, 0, "s", ms=11, color="#222222")
        axes.set(xlim=(-1.2, 1.2), ylim=(-1.2, 1.2), aspect="equal", xlabel=names[0], ylabel=names[1])
        axes.set_title(title, fontsize=10)
        if names[0] == "← left":
            axes.invert_xaxis()
        axes.set_xticks([])
        axes.set_yticks([])
    figure.savefig(Path(__file__).with_name("mounting.png"), dpi=110)


if __name__ == "__main__":
    main()
