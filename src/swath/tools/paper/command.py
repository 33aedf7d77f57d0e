"""`swath paper`: the paper's figures, each a command of swath and the picture that it leaves."""

import argparse
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from swath.core.process.processes import start_module
from swath.terminal.options import add_folder, verb

PLACE = "start", 1  # among all commands
LEVELS = ("empirical", "plants")  # `replay` plays a recording; `heights` has all three
CASES = ("broken-edge", "tight-curve", "low-density")
FILES = ("index.html", "heights", "edge", *LEVELS, *CASES)
_DESCRIPTION = """Make the figures of the paper that swath implements: each is a command of swath beside
what the paper says. Writes index.html and a folder for each command; takes some minutes."""
_SCAN = ("scan", "straight", "--at-s", "12", "--format", "png")
_PLANTS = ("--set", "combine.lidar.level=plants")
_DRIVE = ("run", "straight", *_PLANTS, "--set", "run.distance_m=60", "--set", "expect={}")
_LAB = ("lab", "stand", "--depression-deg", "30", "--stems-per-m2", "200", "600", "--seeds", "2")
_GAP = "[{start_m: 30, end_m: 33, depth_m: 0.8, stubble_height_m: 0.15}]"
_TEETH = "{amplitude_m: 0.15, wavelength_m: 3, kind: random}"
_BEND = "{shape: curve, run_in_m: 25, radius_m: 16, angle_deg: 70}"
_CHALLENGE = (
    "Broken edges, tight curves and low crop density are named as challenging cases to investigate; there "
    "is no figure of them."
)


@dataclass(frozen=True)
class Shown:
    """A figure of the paper. paper: what it says; commands: by the folder that each of them leaves."""

    title: str
    paper: str
    commands: Mapping[str, tuple[str, ...]]


FIGURES = (
    Shown(
        "Figures 1 and 3: sensor models",
        "Levels of the simulation of a function. Three models of one LiDAR: measured data replayed by "
        "position; primitive bodies with parameters found by measurement; surfaces of single plants, met "
        "by many rays a beam.",
        {level: (*_SCAN, "--set", f"combine.lidar.level={level}") for level in LEVELS},
    ),
    Shown(
        "Figures 4 and 5: lab stands and measured heights",
        "Histograms of the height measured over stands of 200 and 600 plants/m² by two scanners with "
        "beams of different size, real and simulated, printed without numbers. Height and number of "
        "plants influence what is measured, and the size of the spot does so strongly.",
        {"heights": _LAB},
    ),
    Shown(
        "Figures 2 and 6: edge detection",
        "Flow chart of steering along the crop edge by LiDAR, and detection of the edge on the 3D "
        "surfaces of the plants.",
        {"edge": (*_SCAN, *_PLANTS)},
    ),
    Shown(
        "Closed loop: a gap of 3 m and random bites up to 15 cm deep",
        _CHALLENGE,
        {CASES[0]: (*_DRIVE, "--set", f"field.edge.gaps={_GAP}", "--set", f"field.edge.teeth={_TEETH}")},
    ),
    Shown(
        "Closed loop: a bend of 16 m radius, at 4 km/h",
        _CHALLENGE,
        {CASES[1]: (*_DRIVE, "--set", f"field.edge={_BEND}", "--set", "combine.speed.speed_kmh=4")},
    ),
    Shown(
        "Closed loop: low crop density, 100 stems/m²",
        _CHALLENGE,
        {CASES[2]: (*_DRIVE, "--set", "field.stand.stems_per_m2=100")},
    ),
)
LEAD = (
    "Jannik Redenius, Matthias Dingwerth, Arno Ruckelshausen, Joachim Hertzberg, Thilo Krause, Boris "
    "Kettelhoit: A multilevel simulation framework for highly automated harvest processes enabled by "
    "environmental sensor systems. What the paper shows is said here in our words; its pictures are not "
    "copied."
)
NOT_REPRODUCED = (
    "The measured scans: none of a stand of known density are open, and the paper prints its histograms "
    "without numbers. So nothing here says how near `plants` is to a real stand.",
    "How strongly the spot acts: whether a scanner reports the nearest echo, a mean or a low percentile "
    "decides it, and the paper does not say which.",
    "Algorithm and control of the CLAAS Laser Pilot: not published. Detector and steering law are swath's "
    "own, or yours.",
    "Gazebo and MATLAB/Simulink: swath's engine, FMUs and ROS 2 take their places.",
)


def add(parsers: Any) -> None:
    """Add the command."""
    parser = verb(parsers, "paper", "the paper's figures, made here", run, _DESCRIPTION)
    add_folder(parser, "paper", *FILES, text="where to write (default: paper)", required=False)
    parser.set_defaults(out=Path("paper"))


def run(args: argparse.Namespace) -> int:
    """Run the commands, write the page."""
    from subprocess import DEVNULL

    from swath.core.files.place import own_folder
    from swath.terminal.progress import steps

    commands = {name: command for shown in FIGURES for name, command in shown.commands.items()}
    with steps(len(commands)) as step:
        for name, command in commands.items():
            step(name)
            own_folder(args.out / name)
            with start_module("swath", *command, "--out", name, cwd=args.out, stdout=DEVNULL) as job:
                if code := job.wait():
                    return code
    print(write_paper(args.out))
    return 0


def write_paper(out: Path) -> Path:
    """Write the page about the folders that the commands left; returns its path."""
    from swath import __version__
    from swath.core.process.shell import command
    from swath.report.html import Figure, Items, Section, write_page

    sections = []
    for shown in FIGURES:
        parts: list[Any] = [f"The paper: {shown.paper}"]
        for name, words in shown.commands.items():
            parts.append(f"`{command(*words, '--out', name)}`")
            parts += [Figure(name, f"{name}/{file.name}", "") for file in sorted((out / name).glob("*.png"))]
            pages = [p for p in ("report.html", "replay.html") if os.path.isfile(out / name / p)]
            parts.append(", ".join(f"[{name}/{page}]({name}/{page})" for page in pages))
        sections.append(Section(shown.title, parts))
    heading = f"The paper's figures, made by swath {__version__}"
    missing = Section("Not reproduced, and why", [Items(NOT_REPRODUCED)])
    return write_page(out / "index.html", [*sections, missing], heading=heading, title="The paper", lead=LEAD)
