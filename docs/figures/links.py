"""Figures of the pages agopengps, foxglove and isobus: `python -m docs.figures.links [NAME ...]`."""

import json
import math
import socket
import sys
import tempfile
import threading
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from xml.etree import ElementTree

import matplotlib
import numpy as np

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from tests.link.device_rig import free_port
from tests.link.independent_agopengps import HELLO, Position, answer_of, position_of, steer_command

from swath.commands.main import main as swath
from swath.core.frames import Pose
from swath.core.schedule import NS
from swath.field_io.agopengps import read_agopengps
from swath.record.read.fields import number_at
from swath.record.read.files import open_log
from swath.record.read.frames import pose_of_transform
from swath.report import plots
from swath.runtime.job import run_job, run_unrecorded
from swath.scenario.scenario import load_scenario

HERE = Path(__file__).parent
LAYOUT = HERE.parents[1] / "src" / "swath" / "data" / "foxglove" / "swath.json"
WHEELBASE, AHEAD, BESIDE = 3.9, 6.0, 0.5  # m; it aims at the line so far ahead, and begins so far beside it
ANTENNA, INTEGRAL = 3.9, 8.0  # height of the antenna [m]; time in which a constant error is steered out [s]
SMOOTH = 0.8  # of the roll before that stays with each position
FACTOR = 4.0  # simulated seconds per second
DECAY = 2.0  # of a scan in the layout [s]


class Guidance(threading.Thread):
    """What AgOpenGPS does: an AB line, positions in, the angle of the wheels out."""

    def __init__(self, plane: Any, line: np.ndarray) -> None:
        super().__init__(daemon=True)
        self._plane, self._line = plane, line
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(0.5)
        self.port, self.module = self.socket.getsockname()[1], ("127.0.0.1", free_port(socket.SOCK_DGRAM))
        self.positions: list[Position] = []
        self.asked: list[tuple[float, float]] = []
        self.answers: list[tuple[float, float]] = []
        self.places: list[np.ndarray] = []
        self._sum = self._roll = 0.0
        self.is_over = False

    def run(self) -> None:
        while not self.is_over:
            try:
                datagram = self.socket.recv(2048)
            except TimeoutError:
                continue
            if datagram[:1] == b"$":
                self._steer(position_of(datagram))
            elif datagram[3] == 253 and self.positions:
                self.answers.append((self.positions[-1].time_s, answer_of(datagram).angle_deg))

    def _place(self, position: Position) -> np.ndarray:
        """East and north of the field's origin [m] of the ground below the antenna, as AgOpenGPS has them."""
        self._roll += (1.0 - SMOOTH) * ((position.roll or 0.0) - self._roll)
        lean, north = math.radians(self._roll), math.radians(position.heading or 0.0)
        left = np.array([-math.cos(north), math.sin(north)])
        place = self._plane.from_lon_lat(np.array([[position.longitude, position.latitude]]))[0]
        return np.asarray(place + ANTENNA * math.sin(lean) * left)

    def beside(self, place: np.ndarray) -> float:
        """How far left of the line [m]."""
        a, b = self._line[0], self._line[-1]
        along = (b - a) / np.linalg.norm(b - a)
        return float(along[0] * (place - a)[1] - along[1] * (place - a)[0])

    def _steer(self, position: Position) -> None:
        along = self._line[-1] - self._line[0]
        self.places.append(self._place(position))
        off = self.beside(self.places[-1])
        turn = math.atan2(along[1], along[0]) - math.radians(90.0 - (position.heading or 0.0))
        self._sum += 0.1 * off / INTEGRAL
        aim = turn - math.asin(max(-0.9, min(0.9, (off + self._sum) / AHEAD)))
        wheel = math.atan(2.0 * WHEELBASE * math.sin(aim) / AHEAD)
        angle = max(-30.0, min(30.0, -math.degrees(wheel)))
        self.positions.append(position)
        self.asked.append((position.time_s, angle))
        told = steer_command(angle, speed_kmh=position.speed_kmh, is_on=True)
        self.socket.sendto(HELLO if len(self.positions) % 10 == 1 else told, self.module)


def agopengps() -> None:
    """The field as AgOpenGPS has it and the way driven on it; wheel angles wanted and had."""
    with tempfile.TemporaryDirectory() as text:
        folder = Path(text)
        _done(swath(["field", "import", "sample-log", "--out", f"{folder}/my-field"]))
        _done(swath(["field", "agopengps", f"{folder}/my-field", "--out", f"{folder}/Fields/My Field"]))
        theirs = read_agopengps(folder / "Fields" / "My Field")
        line = theirs.lines[0].points
        other = Guidance(theirs.plane, line)
        module, reply = (f"127.0.0.1:{port}" for port in (other.module[1], other.port))
        steer = f"{{level: agopengps, listen: '{module}', reply: '{reply}'}}"
        sets = [
            *("combine.lidar=off", "combine.edge=truth", "expect={}", f"combine.steer={steer}"),
            *("combine.gnss.level=error", "combine.gnss.rate_hz=10"),
            "combine.gnss.second_antenna={x_m: 1, y_m: 1.2}",
            *("combine.start.along_edge_m=12", f"combine.start.offset_m={BESIDE}"),
            *("realtime.pace=real_time", f"realtime.factor={FACTOR}", "run.distance_m=300"),
            f"combine.gnss.device=agopengps://{reply}",
        ]
        other.start()
        run_unrecorded(load_scenario(folder / "my-field" / "scenario.yaml", sets=sets))
        other.is_over = True
        other.join()
    figure = plt.figure(figsize=(8.6, 5.4))
    grid = figure.add_gridspec(2, 2, height_ratios=(3.0, 2.0))
    chart = figure.add_subplot(grid[0, :])
    for ring in theirs.rings:
        chart.fill(*_lying(ring), facecolor=plots.SOIL, edgecolor=plots.INK, lw=1.4)
    for each in theirs.lines:
        chart.plot(*_lying(each.points), color=plots.GREY, lw=0.8)
    chart.plot(*_lying(line), color=plots.BLUE, lw=1.2, label="the AB line that is steered along")
    places = np.array(other.places)
    chart.plot(*_lying(places), color=plots.ORANGE, lw=2.4, label="positions, $PAOGI")
    chart.set(aspect="equal", xlabel="north of the field's origin [m]", ylabel="west [m]")
    chart.legend(loc="lower right", fontsize=8)
    begun = other.positions[0].time_s
    beside, wheels = (figure.add_subplot(grid[1, column]) for column in (0, 1))
    off = [100.0 * other.beside(place) for place in places]
    beside.plot([p.time_s - begun for p in other.positions], off, color=plots.ORANGE, lw=1.2)
    beside.axhline(0.0, color=plots.GREY, lw=0.6)
    beside.set(xlabel="time [s]", ylabel="beside the AB line [cm]", ylim=(-20.0, 60.0))
    for rows, colour, width, name in (
        (other.asked, plots.BLUE, 2.2, "wanted, PGN 254"),
        (other.answers, plots.ORANGE, 1.0, "told, PGN 253"),
    ):
        seconds, angle = np.transpose(rows)
        wheels.plot(seconds - begun, angle, color=colour, lw=width, label=name)
    wheels.set(xlabel="time [s]", ylabel="wheel, > 0 right [deg]")
    wheels.legend(frameon=False, fontsize=8)
    _save(figure, "agopengps")


def foxglove() -> None:
    """What the layout swath.json shows of a run: its scene and its four plots."""
    layout = json.loads(LAYOUT.read_text(encoding="utf-8"))["configById"]
    with tempfile.TemporaryDirectory() as text:
        sets = ["run.distance_m=30", "expect={}"]
        run_job(load_scenario("straight", sets=sets), Path(text) / "run")
        log = open_log(Path(text) / "run")
        rows = [paths for name, paths in layout.items() if name.startswith("Plot!")]
        topics = {each["value"].split(".")[0] for panel in rows for each in panel["paths"]}
        heard: dict[str, list[tuple[float, Any]]] = {}
        shown = {"/tf", "/tf_static", "/robot_description", "/combine/field_markers", "/combine/lidar/scan",
                 "/combine/edge/edge_marker"}  # fmt: skip
        for topic, t, message in log.messages(sorted(topics | shown)):
            heard.setdefault(topic, []).append((t / NS, message))
    with plt.style.context("dark_background"):
        figure = plt.figure(figsize=(10.0, 5.4))
        grid = figure.add_gridspec(4, 2, width_ratios=(62, 38))
        _scene(figure.add_subplot(grid[:, 0], projection="3d"), heard)
        for place, panel in enumerate(rows):
            axes = figure.add_subplot(grid[place, 1])
            for each in panel["paths"]:
                topic, _, path = each["value"].partition(".")
                series = [(t, number_at(message, path)) for t, message in heard.get(topic, ())]
                if series:
                    axes.plot(*np.transpose(series), lw=1.2, label=each["label"])
            axes.set_title(panel["title"], fontsize=8, loc="left")
            axes.tick_params(labelsize=7)
            axes.grid(alpha=0.2)
            axes.legend(fontsize=6, frameon=False, loc="center right", bbox_to_anchor=(1.0, 0.6))
        axes.set_xlabel("time [s]", fontsize=7)
        figure.tight_layout()
        _save(figure, "foxglove")


def _scene(axes: Any, heard: dict[str, list[tuple[float, Any]]]) -> None:
    """Scans of the last seconds, the machine, the edge that it found and the field's, behind the machine."""
    end = heard["/tf"][-1][0]
    poses: dict[str, tuple[str, Pose]] = {}
    scans = list(heard["/combine/lidar/scan"])
    points, strength = [], []
    for t, message in [*heard["/tf_static"], *heard["/tf"]]:
        for tf in message.transforms:
            poses[tf.child_frame_id] = tf.header.frame_id, pose_of_transform(tf.transform)
        while len(poses) > 2 and scans and scans[0][0] <= t:
            at, scan = scans.pop(0)
            ranges = np.asarray(scan.ranges)
            angle = scan.angle_min + scan.angle_increment * np.arange(len(ranges))
            good = np.isfinite(ranges)
            if at < end - DECAY:
                continue
            own = np.stack([ranges * np.cos(angle), ranges * np.sin(angle), 0.0 * angle], axis=1)[good]
            points.append(_in_map(poses, "combine/lidar", own))
            strength.append(np.asarray(scan.intensities)[good])
    cloud = np.concatenate(points)
    base = _in_map(poses, "combine/base_link", np.zeros((1, 3)))[0]
    seen = np.abs(cloud - base).max(axis=1) < 14.0
    axes.scatter(*cloud[seen].T, c=np.concatenate(strength)[seen], cmap="turbo", s=1.5, lw=0)
    for visual in ElementTree.fromstring(heard["/robot_description"][0][1].data).iter("visual"):
        _solid(axes, visual, lambda own: _in_map(poses, "combine/base_link", own))
    for markers, colour in ((heard["/combine/field_markers"][-1][1].markers, plots.BLUE),
                            ([heard["/combine/edge/edge_marker"][-1][1]], plots.ORANGE)):  # fmt: skip
        for marker in markers:
            line = np.array([(p.x, p.y, p.z) for p in marker.points])
            line = _in_map(poses, marker.header.frame_id, line)
            line = line[np.abs(line - base).max(axis=1) < 14.0]
            axes.plot(*line.T, color=colour, lw=2.0)
    axes.set(xlim=base[0] + np.array([-12, 12]), ylim=base[1] + np.array([-8, 16]), zlim=(0.0, 8.0))
    axes.set_box_aspect((24, 24, 8), zoom=1.75)
    axes.view_init(elev=32, azim=-60)
    axes.set_axis_off()


def _solid(axes: Any, visual: Any, placed: Any) -> None:
    """The edges of a box or a wheel of the robot's description."""
    origin = np.array([float(v) for v in visual.find("origin").get("xyz").split()])
    shape = visual.find("geometry")[0]
    if shape.tag == "box":
        x, y, z = (0.5 * float(v) for v in shape.get("size").split())
        low, high = ([(-x, -y, k), (x, -y, k), (x, y, k), (-x, y, k), (-x, -y, k)] for k in (-z, z))
        lines = [low, high, *([a, b] for a, b in zip(low[:4], high[:4], strict=True))]
    else:
        a, r = np.linspace(0.0, 2.0 * np.pi, 25), float(shape.get("radius"))
        lines = [np.stack([r * np.cos(a), 0.0 * a, r * np.sin(a)], axis=1)]
    for line in lines:
        axes.plot(*placed(np.asarray(line, dtype=float) + origin).T, color="#b9c77a", lw=1.0)


def _in_map(poses: dict[str, tuple[str, Pose]], frame: str, points: np.ndarray) -> np.ndarray:
    while frame != "map":
        frame, pose = poses[frame]
        points = pose.apply(points)
    return points


def isobus() -> None:
    """What a terminal and a task controller hear of the scenario feed-rate."""
    import cantools
    from tests.link.can_rig import own_bus
    from tests.link.test_isobus import Controller

    from swath.documents.j1939 import dbc_file
    from swath.link.can.bus import open_bus
    from swath.link.can.isobus import IsobusMachine
    from swath.runtime.assembly import assemble
    from swath.runtime.loop import drive

    where = own_bus()
    listener, hook = open_bus(where), IsobusMachine(where)
    script = [(4, 1, 87, 1000), (4, 0, 149, 1000)]  # grain flow and fuel rate each second
    controller = Controller(where, script)
    database = cantools.database.load_file(str(dbc_file()))
    names = {message.frame_id >> 8 & 0x3FFFF: message for message in database.messages}
    heard: dict[str, list[tuple[float, float]]] = {}
    told = 0

    def listen(t: int) -> None:
        nonlocal told
        time.sleep(0.001)
        while (frame := listener.recv(0.0)) is not None:
            message = names.get(frame.arbitration_id >> 8 & 0x3FFFF)
            if message is not None and len(frame.data) == message.length:
                for key, value in message.decode(bytes(frame.data), decode_choices=False).items():
                    heard.setdefault(key, []).append((t / NS, float(value)))
        for _, _, ddi, value in controller.values[told:]:
            heard.setdefault(str(ddi), []).append((t / NS, float(value)))
        told = len(controller.values)

    world = assemble(load_scenario("feed-rate"))
    observers: list[Any] = []
    try:
        hook.begin(SimpleNamespace(world=world, observers=observers))  # type: ignore[arg-type]
        world.graph.before_tick.append(listen)
        drive(world, observers)
    finally:
        hook.close()
        world.close()
        controller.close()
        listener.shutdown()
    figure, rows = plt.subplots(4, 1, figsize=(8.0, 6.4), sharex=True)
    wanted = (
        ("EngineSpeed", 1.0, 8031.0, "engine speed [rpm]\nEEC1"),
        ("EnginePercentLoadAtCurrentSpeed", 1.0, 125.0, "engine load [%]\nEEC2"),
        ("WheelBasedSpeed", 3.6, 100.0, "speed [km/h]\nPGN 65096"),
        ("87", 3.6e-6, math.inf, "grain [t/h]\nprocess data 87"),
    )
    for axes, (key, factor, top, label) in zip(rows, wanted, strict=True):
        t, values = np.transpose([(t, v) for t, v in heard[key] if v <= top])
        axes.plot(t, factor * values, color=plots.BLUE, lw=1.2)
        axes.set_ylabel(label, fontsize=8)
        axes.spines[["top", "right"]].set_visible(False)
    rows[-1].set_xlabel("time [s]")
    _save(figure, "isobus")
    print({key: len(series) for key, series in heard.items()})


def _lying(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """East and north as a map that lies on its side: north to the right, west up."""
    return points[:, 1], -points[:, 0]


def _save(figure: Any, name: str) -> None:
    figure.tight_layout()
    figure.savefig(HERE / f"{name}.png", dpi=110)
    plt.close(figure)


def _done(code: int) -> None:
    if code:
        raise SystemExit(code)


DRAWN = {"agopengps": agopengps, "foxglove": foxglove, "isobus": isobus}

if __name__ == "__main__":
    for each in sys.argv[1:] or DRAWN:
        DRAWN[each]()
