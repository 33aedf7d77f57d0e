"""A kinematic machine that is steered along a path by what its receiver and wheels say: the test bench."""

import math
from dataclasses import dataclass, field

import numpy as np

from swath.control.pose.raw import Params as RawParams
from swath.control.pose.raw import RawPose
from swath.control.steer.path import Params, PathSteer
from swath.core.frames import Pose
from swath.core.random import Stream
from swath.sensing.gnss.error import ErrorGnss
from swath.sensing.gnss.error import Params as GnssParams
from swath.sensing.odometry.error import ErrorOdometry
from swath.sensing.odometry.error import Params as OdometryParams
from swath.signals import MachineState, SteerState
from swath.signals.setup import ControlSetup, MachineGeometry
from tests.control.closed_loop import MACHINE
from tests.sensing import driven_states

FINE, PERIOD, FIX_PERIOD = 10_000_000, 20_000_000, 100_000_000  # ns
COMBINE = MACHINE
TRACTOR = MachineGeometry(
    wheelbase=2.9,
    front_track=1.9,
    rear_track=1.9,
    max_steer=np.deg2rad(38),
    header_width=0.0,
    knife_x=4.0,
    header_y=0.0,
    header_height=0.0,
    header_depth=0.0,
    body=(-1.0, 4.0, 1.2, 0.5, 3.0),
    steers_ahead=True,
)
STEER_RATE, LAG, DEAD_TIME = np.deg2rad(15), 0.2, 0.15


@dataclass
class PathDrive:
    """start: x, y [m], heading [rad]; crab: its direction of travel left of where it looks [rad]

    turned: of the wheels against what is wanted, as understeer does it
    """

    params: Params
    machine: MachineGeometry = COMBINE
    speed: float = 7 / 3.6
    start: tuple = (0.0, 0.0, 0.0)
    crab: float = 0.0
    understeer: float = 0.0
    seed: int = 1
    gnss: dict = field(default_factory=dict)
    odometry: dict = field(default_factory=dict)
    pose: object = RawPose
    pose_params: object = None
    poses: list = field(default_factory=list)

    def nees(self, after):
        """Normalised estimation error squared of every pose known after so many seconds, (n,)."""
        found = []
        for pose, x, y, psi, speed in self.poses:
            if pose.t * 1e-9 > after and np.isfinite(pose.x):
                turn = np.angle(np.exp(1j * (pose.heading - psi)))
                off = np.array([pose.x - x, pose.y - y, turn, pose.speed - speed])
                found.append(off @ np.linalg.solve(pose.covariance, off))
        return np.array(found)

    def run(self, seconds):
        """Rows (t [s], x, y [m], heading [rad], engaged) of every 20 ms, and the last GuidanceState."""
        site = driven_states.setup_of()
        fixes = ErrorGnss(GnssParams(**self.gnss), site)
        wheels = ErrorOdometry(OdometryParams(**self.odometry), site)
        setup = ControlSetup(self.machine, {"fix": fixes.mounting}, "left", PERIOD * 1e-9)
        estimate = self.pose(self.pose_params or RawParams(), setup)
        law = PathSteer(self.params, setup)
        for name, part in {"gnss": fixes, "odometry": wheels, "pose": estimate, "steer": law}.items():
            found = part.reset(Stream(self.seed, name))
            if name == "gnss":
                fix = found["fix"]
        x, y, psi = self.start
        angle, rate, command = 0.0, 0.0, 0.0
        waiting = [0.0] * round(DEAD_TIME / (FINE * 1e-9))
        states, samples, rows, guidance = [], [], [], None
        h = FINE * 1e-9
        for i in range(round(seconds / h)):
            t = (i + 1) * FINE
            waiting.append(math.atan(command * self.machine.wheelbase))
            rate = min(max((waiting.pop(0) - angle) / LAG, -STEER_RATE), STEER_RATE)
            angle += rate * h
            yaw_rate = self.speed * math.tan(angle) / self.machine.wheelbase * (1.0 - self.understeer)
            middle = psi + 0.5 * yaw_rate * h + self.crab
            x, y = x + self.speed * h * math.cos(middle), y + self.speed * h * math.sin(middle)
            psi += yaw_rate * h
            state = MachineState(
                t,
                Pose.from_euler((x, y, 0.0), yaw=psi),
                self.speed,
                0.0,
                yaw_rate,
                angle,
                self.speed * t * 1e-9,
            )
            states.append(state)
            if t % FIX_PERIOD == 0:
                fix = fixes.step(t - FIX_PERIOD, FIX_PERIOD, {"state": tuple(states)})["fix"]
                states = []
            if t % PERIOD:
                continue
            seen = {"state": state, "steering": SteerState(t, angle, rate), "wheels": None}
            samples = (wheels.step(t - PERIOD, PERIOD, seen)["odometry"],)
            pose = estimate.step(t - PERIOD, PERIOD, {"fix": fix, "odometry": samples, "inertial": None})[
                "pose"
            ]
            self.poses.append((pose, x, y, psi, self.speed))
            given = {"pose": pose, "odometry": samples[-1]}
            wanted = law.step(t - PERIOD, PERIOD, given)
            command, guidance = wanted["command"].curvature, wanted["guidance"]
            rows.append((t * 1e-9, x, y, psi, wanted["command"].is_engaged))
        return np.array(rows, dtype=float), guidance
